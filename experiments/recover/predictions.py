"""What the linear model of the hexapod predicts: isolability, dithers, stability."""

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

ALIKE = 6.18
"""Distance below which one of a thousand pairs is mistaken: Phi(-d / 2) = 1e-3."""
ISOLABLE = 10.0
"""Fixed beforehand: a failure counts in the isolation rate if the linear model puts half a second
of its outputs this far from every other explanation: odds of e^50 on average."""
EVIDENCE_S, DITHER_EVIDENCE_S = 0.5, 0.1
"""How long evidence is collected; and to choose a dither, which is for speed."""

DIRECTIONS = {"gamma": 2, "t_x": 3, "t_y": 4, "t_z": 5}
"""Payload motions that pointing does not see, by the column of strut displacements per twist."""
FREQUENCIES_HZ = (5.0, 10.0, 20.0, 30.0)
AMPLITUDES_M = (0.125e-6, 0.25e-6, 0.5e-6, 1e-6)
SETTINGS = {"angles": STILL, "angles, dither": DITHER}
"""What there is to see a failure with."""

_RIGID: tuple[FaultKind, ...] = ("locked", "free")
_HALF = 0.5
"""Effectiveness of a weak coil."""
_BEGIN_S, _EARLIEST_S = 6.0, 1.5


def separations(case: Case) -> tuple[float, float]:
    """Distance from other struts and no failure, and from other kinds of the same strut.

    Of the failure of a case, by the detector and the dither.
    """
    rig, fault = exact_rig(), Fault.of(case.failures[0])
    path, onset = case.path(rig), round(BEFORE_S / rig.period_s)
    apart, from_none = _distances(rig, path, case.dither or STILL, fault, onset, EVIDENCE_S)
    others = min(float(np.delete(apart, fault.actuator, axis=0).min()), from_none)
    return others, float(np.delete(apart[fault.actuator], KINDS.index(fault.kind)).min())


def _distances(
    rig: Rig, path: Array, dither: Dither, fault: Fault, onset: int, evidence_s: float
) -> tuple[Array, float]:
    """Distances by strut and kind (6, 3), and from no failure, of a failure at a tick."""
    states, commanded = linear_run(rig, path, dither, [fault], onset)
    until = onset + round(evidence_s / rig.period_s)
    return isolability(rig.nominal, fault, onset, states[:until], commanded[:until])


def lookalikes(setting: str, struts: Sequence[int]) -> list[Row]:
    """A row for each kind of failure of these struts, centred and off centre: what is most alike.

    Each within half a turn of the spiral from 7.5 s on; `setting` is one of `SETTINGS`; `alike` is
    how many explanations are nearer than :data:`ALIKE`.
    """
    rig, half_turn_s, dither = exact_rig(), BENCH.spiral_period_s / 2, SETTINGS[setting]
    duration_s = _EARLIEST_S + half_turn_s + EVIDENCE_S + rig.period_s
    path = BENCH.spiral_rad(duration_s, _BEGIN_S)
    first, half_turn = round(_EARLIEST_S / rig.period_s), round(half_turn_s / rig.period_s)
    gain = rig.mapping(rig.goal).major_gain()
    moved_m = np.abs(path @ gain.T)[first : first + half_turn]
    places, rows = {"centre": least, "off centre": greatest}, []
    for strut, kind, where in product(struts, KINDS, places):
        onset = first + places[where](moved_m[:, strut])
        fault, own = Fault(strut, kind, _HALF * (kind == "weak")), KINDS.index(kind)
        apart, from_none = _distances(rig, path, dither, fault, onset, EVIDENCE_S)
        others, kinds = np.delete(apart, strut, axis=0).min(axis=1), np.delete(apart[strut], own)
        row = {"setting": setting, "actuator": rig.actuators[strut], "kind": kind, "where": where}
        row |= {"from_healthy": from_none, "from_other_actuators": float(others.min())}
        row["from_other_kinds"] = float(kinds.min())
        nearest = np.delete(rig.actuators, strut)[least(others, ACCURACY)]
        row["nearest_other_actuator"] = nearest.item()
        row["nearest_other_kind"] = np.delete(KINDS, own)[least(kinds, ACCURACY)].item()
        row["alike"] = int((apart < ALIKE).sum() - (apart[strut, own] < ALIKE))
        rows.append(row)
    return rows


def dither_design(struts: Sequence[int] = (0, 1, 2)) -> list[Row]:
    """Least distance of a locked or free strut from the others, a row for each dither.

    Each direction at each frequency; then the amplitudes of the one that is chosen.
    """
    rig, sizes = exact_rig(), list(product(DIRECTIONS, FREQUENCIES_HZ, [DITHER.amplitude]))
    sizes += [("t_z", DITHER.frequency_hz, size) for size in AMPLITUDES_M]
    per_twist, rows = hexapod(rig.model).inverse_jacobian(NOMINAL), []
    path = BENCH.spiral_rad(_EARLIEST_S + DITHER_EVIDENCE_S, _BEGIN_S)
    onset, faults = round(_EARLIEST_S / rig.period_s), list(product(struts, _RIGID))
    for name, hz, size in sizes:
        column = per_twist[:, DIRECTIONS[name]]
        direction = tuple((column / np.abs(column).max()).tolist())
        shaken, apart = Dither(size, hz, direction), list[float]()
        for strut, kind in faults:
            fault = Fault(strut, kind)
            own, _ = _distances(rig, path, shaken, fault, onset, DITHER_EVIDENCE_S)
            apart.append(float(np.delete(own, strut, axis=0).min()))
        dither = {"direction": name, "frequency_hz": hz, "amplitude_m": size}
        rows.append(dither | {"separation": min(apart)})
    return rows


def beliefs(struts: Sequence[int], rig: Rig | None = None) -> list[Row]:
    """A row for each failure of one of these struts or none, under each belief about a strut.

    The largest size of a closed-loop pole (below 1 is stable), and the peak of the largest singular
    value of the sensitivity. None is the usual rig.
    """
    rig = exact_rig() if rig is None else rig
    compensators = control.append(*(loop.discrete for loop in rig.control.testbed.loops))
    truths = [None, *(Fault(k, kind, _HALF) for kind, k in product(KINDS, struts))]
    weak: tuple[FaultKind, ...] = ("locked", "weak")
    possible = [None, *(Fault(k, kind, WEAKEST) for kind, k in product(weak, range(6)))]
    gains, rows = [_gain(rig, believed) for believed in possible], []
    for truth in truths:
        P = _plant(rig.nominal, [] if truth is None else [truth])
        for believed, gain in zip(possible, gains, strict=True):
            L = control.ss(P.A, P.B @ gain, P.C, 0, P.dt) * compensators
            pole = float(np.abs(control.feedback(L, np.eye(2)).poles()).max())
            row = {"truth": fault_text(truth), "belief": fault_text(believed), "largest_pole": pole}
            rows.append(row | {"sensitivity_peak": sensitivity_peak(L)})
    return rows


def _gain(rig: Rig, believed: Fault | None) -> Array:
    """Commanded strut displacements per (alpha, beta), shape (6, 2)."""
    goal, effectiveness = rig.goal, np.ones(6)
    if believed is not None and believed.kind == "weak":
        effectiveness[believed.actuator] = believed.effectiveness
    elif believed is not None:
        goal = Goal(goal.joint_weight, locked_at={believed.actuator: 0.0})
    return rig.mapping(goal).major_gain() / effectiveness[:, None]


def _plant(nominal: NominalModel, faults: Sequence[Fault]) -> control.StateSpace:
    """From commands to pointing, on the coordinates that a lock leaves."""
    model, k = fault_model(nominal, faults), nominal.plant.nstates // 2
    locked = [fault.actuator for fault in faults if fault.kind == "locked"]
    left = scipy.linalg.null_space(nominal.displacement[locked, :k]) if locked else np.eye(k)
    Q = scipy.linalg.block_diag(left, left)
    return control.ss(Q.T @ model.A @ Q, Q.T @ model.B, nominal.plant.C @ Q, 0, nominal.period_s)
