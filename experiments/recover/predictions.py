"""Predictions of the linear model of the hexapod: isolability, dithers, stability."""

from collections.abc import Sequence
from itertools import product

import control
import numpy as np
import scipy.linalg

from argument_checks.ties import greatest, least
from experiments.recover.plan import BEFORE_S, BENCH, Case, exact_rig
from experiments.study import Row
from fjh.rig.hexapod.closed_form import hexapod
from fjh.rig.hexapod.fault_tolerance import DITHER, STILL, fault_text
from fjh.rig.prediction import linear_run
from fjh.rig.rig import Rig
from ftc import WEAKEST, Goal
from ftc.control import sensitivity_peak
from ftc.fdi import (
    ACCURACY,
    KINDS,
    Dither,
    Fault,
    FaultKind,
    NominalModel,
    fault_model,
    isolability,
)
from sim import NOMINAL, Array

AMBIGUOUS = 6.18
"""Distance d of two hypotheses with an error rate of Phi(-d / 2) = 1e-3."""
ISOLABLE = 10.0
"""Least distance of isolable failures, chosen before the study: in the linear model, outputs of
half a second differ by this from those of every other hypothesis (mean odds e^50). The isolation
rate counts only isolable failures."""
EVIDENCE_S, DITHER_EVIDENCE_S = 0.5, 0.1
"""Durations [s] of the evidence, and of that for the dither's design, which reduces delays."""

DIRECTIONS = {"gamma": 2, "t_x": 3, "t_y": 4, "t_z": 5}
"""Columns of the twist for payload motions that do not change pointing."""
FREQUENCIES_HZ = (5.0, 10.0, 20.0, 30.0)
AMPLITUDES_M = (0.125e-6, 0.25e-6, 0.5e-6, 1e-6)
SETTINGS = {"angles": STILL, "angles, dither": DITHER}
"""Dithers by name of the setting."""

_RIGID: tuple[FaultKind, ...] = ("locked", "free")
_HALF = 0.5
"""Assumed effectiveness of a weak coil."""
_START_S, _EARLIEST_S = 6.0, 1.5


def separations(case: Case) -> tuple[float, float]:
    """Return a failure's distance from other struts and no failure, and from other kinds.

    Distances are between outputs of the detector, with the dither of the case.
    """
    rig, fault = exact_rig(), Fault.of(case.failures[0])
    path, onset = case.path(rig), round(BEFORE_S / rig.period_s)
    distances, from_none = _distances(rig, path, case.dither or STILL, fault, onset, EVIDENCE_S)
    others = min(float(np.delete(distances, fault.actuator, axis=0).min()), from_none)
    return others, float(np.delete(distances[fault.actuator], KINDS.index(fault.kind)).min())


def _distances(
    rig: Rig, path: Array, dither: Dither, fault: Fault, onset: int, evidence_s: float
) -> tuple[Array, float]:
    """Return the distances of a fault from all faults, (6, 3), and from no fault."""
    states, commanded = linear_run(rig, path, dither, [fault], onset)
    until = onset + round(evidence_s / rig.period_s)
    return isolability(rig.nominal, fault, onset, states[:until], commanded[:until])


def ambiguity_rows(setting: str, struts: Sequence[int]) -> list[Row]:
    """Return rows with the nearest hypotheses for each kind of failure of these struts.

    Failures are within half a turn of the spiral from 7.5 s on, where the strut is at its centre
    and farthest from it. `setting` is one of `SETTINGS`. The column `alike` is the number of
    hypotheses closer than :data:`AMBIGUOUS`.
    """
    rig, half_turn_s, dither = exact_rig(), BENCH.spiral_period_s / 2, SETTINGS[setting]
    duration_s = _EARLIEST_S + half_turn_s + EVIDENCE_S + rig.period_s
    path = BENCH.spiral_rad(duration_s, _START_S)
    first, half_turn = round(_EARLIEST_S / rig.period_s), round(half_turn_s / rig.period_s)
    gain = rig.mapping(rig.goal).major_gain()
    displacement_m = np.abs(path @ gain.T)[first : first + half_turn]
    places, rows = {"centre": least, "off centre": greatest}, []
    for strut, kind, where in product(struts, KINDS, places):
        onset = first + places[where](displacement_m[:, strut])
        fault, own_kind = Fault(strut, kind, _HALF * (kind == "weak")), KINDS.index(kind)
        distances, from_none = _distances(rig, path, dither, fault, onset, EVIDENCE_S)
        others = np.delete(distances, strut, axis=0).min(axis=1)
        kinds = np.delete(distances[strut], own_kind)
        row = {"setting": setting, "actuator": rig.actuators[strut], "kind": kind, "where": where}
        row |= {"from_healthy": from_none, "from_other_actuators": float(others.min())}
        row["from_other_kinds"] = float(kinds.min())
        nearest = np.delete(rig.actuators, strut)[least(others, ACCURACY)]
        row["nearest_other_actuator"] = nearest.item()
        row["nearest_other_kind"] = np.delete(KINDS, own_kind)[least(kinds, ACCURACY)].item()
        row["alike"] = int((distances < AMBIGUOUS).sum() - (distances[strut, own_kind] < AMBIGUOUS))
        rows.append(row)
    return rows


def dither_design(struts: Sequence[int] = (0, 1, 2)) -> list[Row]:
    """Return rows with the least distance of a locked or free strut from other hypotheses.

    There is a row for each direction and frequency of the dither, then for each amplitude.
    """
    rig, sizes = exact_rig(), list(product(DIRECTIONS, FREQUENCIES_HZ, [DITHER.amplitude]))
    sizes += [("t_z", DITHER.frequency_hz, size) for size in AMPLITUDES_M]
    per_twist, rows = hexapod(rig.model).inverse_jacobian(NOMINAL), []
    path = BENCH.spiral_rad(_EARLIEST_S + DITHER_EVIDENCE_S, _START_S)
    onset, faults = round(_EARLIEST_S / rig.period_s), list(product(struts, _RIGID))
    for name, hz, size in sizes:
        column = per_twist[:, DIRECTIONS[name]]
        direction = tuple((column / np.abs(column).max()).tolist())
        candidate, distances = Dither(size, hz, direction), list[float]()
        for strut, kind in faults:
            fault = Fault(strut, kind)
            by_strut, _ = _distances(rig, path, candidate, fault, onset, DITHER_EVIDENCE_S)
            distances.append(float(np.delete(by_strut, strut, axis=0).min()))
        dither = {"direction": name, "frequency_hz": hz, "amplitude_m": size}
        rows.append(dither | {"separation": min(distances)})
    return rows


def stability_rows(struts: Sequence[int], rig: Rig | None = None) -> list[Row]:
    """Return rows on the loop's stability for each true fault of these struts and each diagnosis.

    Rows have the largest magnitude of a closed-loop pole (stable below 1), and the peak of the
    largest singular value of the sensitivity. A `rig` of None is that with the exact plant.
    """
    rig = exact_rig() if rig is None else rig
    compensators = control.append(*(loop.discrete for loop in rig.control.testbed.loops))
    truths = [None, *(Fault(k, kind, _HALF) for kind, k in product(KINDS, struts))]
    weak: tuple[FaultKind, ...] = ("locked", "weak")
    diagnoses = [None, *(Fault(k, kind, WEAKEST) for kind, k in product(weak, range(6)))]
    gains, rows = [_gain(rig, assumed) for assumed in diagnoses], []
    for truth in truths:
        P = _plant(rig.nominal, [] if truth is None else [truth])
        for assumed, gain in zip(diagnoses, gains, strict=True):
            L = control.ss(P.A, P.B @ gain, P.C, 0, P.dt) * compensators
            pole = float(np.abs(control.feedback(L, np.eye(2)).poles()).max())
            row = {"truth": fault_text(truth), "belief": fault_text(assumed), "largest_pole": pole}
            rows.append(row | {"sensitivity_peak": sensitivity_peak(L)})
    return rows


def _gain(rig: Rig, diagnosed: Fault | None) -> Array:
    """Return the commanded strut displacements per (alpha, beta), shape (6, 2)."""
    goal, effectiveness = rig.goal, np.ones(6)
    if diagnosed is not None and diagnosed.kind == "weak":
        effectiveness[diagnosed.actuator] = diagnosed.effectiveness
    elif diagnosed is not None:
        goal = Goal(goal.joint_weight, locked_at={diagnosed.actuator: 0.0})
    return rig.mapping(goal).major_gain() / effectiveness[:, None]


def _plant(nominal: NominalModel, faults: Sequence[Fault]) -> control.StateSpace:
    """Return the plant with faults from commands to pointing."""
    model, k = fault_model(nominal, faults), nominal.plant.nstates // 2
    locked = [fault.actuator for fault in faults if fault.kind == "locked"]
    basis = scipy.linalg.null_space(nominal.displacement[locked, :k]) if locked else np.eye(k)
    Q = scipy.linalg.block_diag(basis, basis)
    return control.ss(Q.T @ model.A @ Q, Q.T @ model.B, nominal.plant.C @ Q, 0, nominal.period_s)
