"""What the linear model of the hexapod predicts: isolability, dithers, stability."""

from collections.abc import Sequence
from itertools import product
from typing import Any

import control
import numpy as np
import scipy.linalg

from argument_checks.ties import ascending, greatest, least
from experiments.recover.plan import BEFORE_S, BENCH, Case, exact_rig
from experiments.rig.hexapod.fault_tolerance import DITHER, STILL, fault_text
from experiments.rig.prediction import linear_loop
from experiments.rig.rig import Rig
from ftc.control.compensator import sensitivity_peak
from ftc.fdi.design.isolability import isolability
from ftc.fdi.dither import Dither
from ftc.fdi.fault_model import KINDS, Fault, FaultKind, NominalModel, fault_model
from ftc.fdi.separation import ACCURACY
from ftc.goal import Goal
from ftc.linear_loop import LinearLoop, simulate
from ftc.reconfiguration import WEAKEST
from sim import NOMINAL, Array, hexapod

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
SETTINGS = {
    "angles": (STILL, False),
    "angles, dither": (DITHER, False),
    "angles and struts": (STILL, True),
    "angles and struts, dither": (DITHER, True),
}
"""What there is to see a failure with: a dither, and whether there are gauges on the struts."""

_RIGID: tuple[FaultKind, ...] = ("locked", "free")
_HALF = 0.5
"""Effectiveness of a weak coil."""
_BEGIN_S, _EARLIEST_S = 6.0, 1.5


def separations(case: Case) -> tuple[float, float]:
    """Distance from other struts and no failure, and from other kinds of the same strut.

    Of the failure of a case, by the detector and the dither.
    """
    rig, fault = exact_rig(), Fault.of(case.failures[0])
    loop = linear_loop(rig, case.path(rig), case.dither or STILL)
    onset = round(BEFORE_S / rig.period_s)
    apart, from_none = _distances(loop, loop.nominal, fault, onset, EVIDENCE_S)
    others = min(float(np.delete(apart, fault.actuator, axis=0).min()), from_none)
    return others, float(np.delete(apart[fault.actuator], KINDS.index(fault.kind)).min())


def _distances(
    loop: LinearLoop, watched: NominalModel, fault: Fault, onset: int, evidence_s: float
) -> tuple[Array, float]:
    """Distances by strut and kind (6, 3), and from no failure, of a failure at a tick."""
    states, commanded = simulate(loop, [fault], onset)
    until = onset + round(evidence_s / loop.nominal.period_s)
    return isolability(watched, fault, onset, states[:until], commanded[:until])


def lookalikes(setting: str, struts: Sequence[int]) -> list[dict[str, Any]]:
    """One entry, ready for JSON, for each kind of failure of these struts, centred and off centre.

    Each within half a turn of the spiral from 7.5 s on; `setting` is one of `SETTINGS`.
    """
    rig, half_turn_s, (dither, gauges) = exact_rig(), BENCH.spiral_period_s / 2, SETTINGS[setting]
    duration_s = _EARLIEST_S + half_turn_s + EVIDENCE_S + rig.period_s
    loop = linear_loop(rig, BENCH.spiral_rad(duration_s, _BEGIN_S), dither)
    watched = loop.nominal
    if gauges:
        noise = np.concatenate([watched.noise, np.full(6, rig.encoder_noise)])
        watched = watched.measured(np.vstack([watched.plant.C, watched.displacement]), noise)
    first, half_turn = round(_EARLIEST_S / rig.period_s), round(half_turn_s / rig.period_s)
    moved_m = np.abs(loop.reference @ loop.gain.T)[first : first + half_turn]
    places, entries = {"centre": least, "off centre": greatest}, []
    for strut, kind, where in product(struts, KINDS, places):
        onset = first + places[where](moved_m[:, strut])
        fault = Fault(strut, kind, _HALF * (kind == "weak"))
        apart, from_none = _distances(loop, watched, fault, onset, EVIDENCE_S)
        seen = {"setting": setting, "actuator": rig.actuators[strut], "kind": kind, "where": where}
        entries.append(seen | {"from_healthy": from_none} | _nearest(rig, apart, strut, kind))
    return entries


def _nearest(rig: Rig, apart: Array, strut: int, kind: FaultKind) -> dict[str, Any]:
    """The nearest other strut and kind, and all that is alike, by distances (6, 3)."""
    own = KINDS.index(kind)
    others, kinds = np.delete(apart, strut, axis=0).min(axis=1), np.delete(apart[strut], own)
    alike = [
        {"actuator": rig.actuators[k], "kind": KINDS[column], "separation": float(apart[k, column])}
        for k, column in np.argwhere(apart < ALIKE)
        if (k, column) != (strut, own)
    ]
    return {
        "nearest_other_actuator": np.delete(rig.actuators, strut)[least(others, ACCURACY)].item(),
        "from_other_actuators": float(others.min()),
        "nearest_other_kind": np.delete(KINDS, own)[least(kinds, ACCURACY)].item(),
        "from_other_kinds": float(kinds.min()),
        "alike": [alike[k] for k in ascending([each["separation"] for each in alike])],
    }


def dither_design(struts: Sequence[int], frequencies_hz: Sequence[float]) -> list[dict[str, Any]]:
    """Least distance of a locked or free strut from the others, an entry for each dither.

    Each direction at each frequency; then the amplitudes of the one that is chosen.
    """
    rig, sizes = exact_rig(), list(product(DIRECTIONS, frequencies_hz, [DITHER.amplitude]))
    sizes += [("t_z", DITHER.frequency_hz, size) for size in AMPLITUDES_M]
    per_twist, entries = hexapod(rig.model).inverse_jacobian(NOMINAL), []
    path = BENCH.spiral_rad(_EARLIEST_S + DITHER_EVIDENCE_S, _BEGIN_S)
    onset, faults = round(_EARLIEST_S / rig.period_s), list(product(struts, _RIGID))
    for name, hz, size in sizes:
        column = per_twist[:, DIRECTIONS[name]]
        direction = tuple((column / np.abs(column).max()).tolist())
        loop, apart = linear_loop(rig, path, Dither(size, hz, direction)), list[float]()
        for strut, kind in faults:
            fault = Fault(strut, kind)
            own, _ = _distances(loop, loop.nominal, fault, onset, DITHER_EVIDENCE_S)
            apart.append(float(np.delete(own, strut, axis=0).min()))
        dither = {"direction": name, "frequency_hz": hz, "amplitude_m": size}
        entries.append(dither | {"separation": min(apart)})
    return entries


def beliefs(struts: Sequence[int], rig: Rig | None = None) -> dict[str, Any]:
    """The loop under each failure of one of these struts or none, under each belief about a strut.

    The largest size of a closed-loop pole (below 1 is stable), and the peak of the largest singular
    value of the sensitivity, of all these pairs. None is the usual rig.
    """
    rig = exact_rig() if rig is None else rig
    compensators = control.append(*(loop.discrete for loop in rig.control.testbed.loops))
    truths = [None, *(Fault(k, kind, _HALF) for kind, k in product(KINDS, struts))]
    weak: tuple[FaultKind, ...] = ("locked", "weak")
    possible = [None, *(Fault(k, kind, WEAKEST) for kind, k in product(weak, range(6)))]
    gains = [_gain(rig, believed) for believed in possible]
    poles, peaks, pairs = [], [], list(product(truths, possible))
    for truth in truths:
        P = _plant(rig.nominal, [] if truth is None else [truth])
        for gain in gains:
            L = control.ss(P.A, P.B @ gain, P.C, 0, P.dt) * compensators
            poles.append(float(np.abs(control.feedback(L, np.eye(2)).poles()).max()))
            peaks.append(sensitivity_peak(L))
    truth, believed = pairs[worst := greatest(peaks)]
    return {
        "pairs_of_truth_and_belief": len(pairs),
        "unstable": sum(pole >= 1 for pole in poles),
        "largest_pole": max(poles),
        "sensitivity_peak_nothing_failed": peaks[0],
        "sensitivity_peak_worst": peaks[worst],
        "worst_truth": fault_text(truth),
        "worst_belief": fault_text(believed),
    }


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
