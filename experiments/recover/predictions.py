"""Beside the runs of the hexapod: what its linear model predicts, and runs on its exact plant."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import control
import numpy as np
import scipy.linalg

from argument_checks.ties import ascending, greatest, least
from experiments.recover.case import BENCH, Case, exact_rig
from experiments.recover.plan import AFTER_S, BEFORE_S, of_hexapod
from experiments.recover.simulate import distance, errors, informed, tick_of, unaware
from experiments.rig.hexapod.fault_tolerance import DITHER, STILL, fault_entry, fault_text
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
from sim import NOMINAL, Array, Failure, hexapod

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
LATE_S = (0.03, 0.1, 0.3, 1.0)
"""How late a diagnosis may come."""

_HALF = 0.5
"""Effectiveness of a weak coil."""
_BEGIN_S, _EARLIEST_S = 6.0, 1.5
_FAILS_S = 8.25


@dataclass(frozen=True)
class Setting:
    """What there is to see a failure with: a dither, and whether there are gauges on the struts."""

    name: str
    dither: Dither
    strut_sensors: bool


SETTINGS = (
    Setting("angles", STILL, strut_sensors=False),
    Setting("angles, dither", DITHER, strut_sensors=False),
    Setting("angles and struts", STILL, strut_sensors=True),
    Setting("angles and struts, dither", DITHER, strut_sensors=True),
)


def separations(case: Case) -> tuple[float, float]:
    """Distance from other struts and no failure, and from other kinds of the same strut.

    Of the failure of a case, by the detector and the dither.
    """
    rig, fault = exact_rig(), Fault.of(case.failures[0])
    loop, tick = linear_loop(rig, case.path(rig), case.dither or STILL), round(BEFORE_S / 1e-3)
    distance, from_none = _distances(loop, loop.nominal, fault, tick, EVIDENCE_S)
    from_others = min(float(np.delete(distance, fault.actuator, axis=0).min()), from_none)
    return from_others, float(_other_kinds(distance, fault).min())


def lookalikes(setting: Setting, struts: Sequence[int]) -> list[dict[str, Any]]:
    """One entry, ready for JSON, for each kind of failure of these struts, centred and off centre.

    Each within half a turn of the spiral from 7.5 s on.
    """
    rig, half_turn_s = exact_rig(), BENCH.spiral_period_s / 2
    duration_s = _EARLIEST_S + half_turn_s + EVIDENCE_S + rig.period_s
    loop = _loop(rig, setting.dither, duration_s)
    watched = loop.nominal
    if setting.strut_sensors:
        noise = np.concatenate([watched.noise, np.full(6, rig.encoder_noise)])
        watched = watched.measured(np.vstack([watched.plant.C, watched.displacement]), noise)
    first, half_turn = round(_EARLIEST_S / rig.period_s), round(half_turn_s / rig.period_s)
    moved_m = (loop.reference @ loop.gain.T)[first : first + half_turn]
    entries = []
    for fault in [Fault(k, kind, _HALF * (kind == "weak")) for k in struts for kind in KINDS]:
        for where, choose in _PLACES.items():
            onset = first + choose(np.abs(moved_m[:, fault.actuator]))
            distance, from_none = _distances(loop, watched, fault, onset, EVIDENCE_S)
            seen = {"setting": setting.name, **_named(rig, fault), "where": where}
            entries.append(seen | {"from_healthy": from_none} | _nearest(rig, distance, fault))
    return entries


_PLACES: dict[str, Callable[[Array], int]] = {"centre": least, "off centre": greatest}


def _named(rig: Rig, fault: Fault) -> dict[str, Any]:
    return {"actuator": rig.actuators[fault.actuator], "kind": fault.kind}


def _nearest(rig: Rig, distance: Array, fault: Fault) -> dict[str, Any]:
    """The nearest other strut and kind, and all that is alike, the nearest first."""
    own, strut = KINDS.index(fault.kind), fault.actuator
    others = np.delete(distance, strut, axis=0).min(axis=1)
    kinds = _other_kinds(distance, fault)
    alike = [
        _named(rig, Fault(k, kind)) | {"separation": float(distance[k, column])}
        for k in range(len(distance))
        for column, kind in enumerate(KINDS)
        if (k, kind) != (strut, fault.kind) and distance[k, column] < ALIKE
    ]
    return {
        "nearest_other_actuator": np.delete(rig.actuators, strut)[least(others, ACCURACY)].item(),
        "from_other_actuators": float(others.min()),
        "nearest_other_kind": np.delete(KINDS, own)[least(kinds, ACCURACY)].item(),
        "from_other_kinds": float(kinds.min()),
        "alike": [alike[k] for k in ascending([one["separation"] for one in alike])],
    }


def _other_kinds(distance: Array, fault: Fault) -> Array:
    return np.delete(distance[fault.actuator], KINDS.index(fault.kind))


def dither_design(struts: Sequence[int], frequencies_hz: Sequence[float]) -> list[dict[str, Any]]:
    """Least distance of a locked or free strut from the others, an entry for each dither.

    Each direction at each frequency; then the amplitudes of the one that is chosen.
    """
    rig, rigid = exact_rig(), ("locked", "free")
    per_twist = hexapod(rig.model).inverse_jacobian(NOMINAL)
    onset = round(_EARLIEST_S / rig.period_s)

    def entry(name: str, frequency_hz: float, amplitude_m: float) -> dict[str, Any]:
        column = per_twist[:, DIRECTIONS[name]]
        direction = tuple((column / np.abs(column).max()).tolist())
        dither = Dither(amplitude_m, frequency_hz, direction)
        loop = _loop(rig, dither, _EARLIEST_S + DITHER_EVIDENCE_S)
        apart: list[float] = []
        for fault in [Fault(strut, kind) for strut in struts for kind in rigid]:
            distance, _ = _distances(loop, loop.nominal, fault, onset, DITHER_EVIDENCE_S)
            apart.append(float(np.delete(distance, fault.actuator, axis=0).min()))
        named = {"direction": name, "frequency_hz": frequency_hz, "amplitude_m": amplitude_m}
        return named | {"separation": min(apart)}

    entries = [entry(name, hz, DITHER.amplitude) for name in DIRECTIONS for hz in frequencies_hz]
    return entries + [entry("t_z", DITHER.frequency_hz, size) for size in AMPLITUDES_M]


def _loop(rig: Rig, dither: Dither, duration_s: float) -> LinearLoop:
    return linear_loop(rig, BENCH.spiral_rad(duration_s, _BEGIN_S), dither)


def _distances(
    loop: LinearLoop, watched: NominalModel, fault: Fault, onset: int, evidence_s: float
) -> tuple[Array, float]:
    states, commanded = simulate(loop, [fault], onset)
    until = onset + round(evidence_s / loop.nominal.period_s)
    return isolability(watched, fault, onset, states[:until], commanded[:until])


def beliefs(struts: Sequence[int], rig: Rig | None = None) -> dict[str, Any]:
    """The loop under each failure of one of these struts or none, under each belief about a strut.

    The largest size of a closed-loop pole (below 1 is stable), and the peak of the largest singular
    value of the sensitivity, of all these pairs. None is the usual rig.
    """
    rig = exact_rig() if rig is None else rig
    compensators = control.append(*(loop.discrete for loop in rig.control.testbed.loops))
    truths = [None, *(Fault(k, kind, _HALF) for kind in KINDS for k in struts)]
    possible = [None, *(Fault(k, kind, WEAKEST) for kind in ("locked", "weak") for k in range(6))]
    gains = [_gain(rig, believed) for believed in possible]
    poles, peaks, pairs = [], [], list(product(truths, possible))
    for truth in truths:
        P = _plant(rig.nominal, truth)
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


def _plant(nominal: NominalModel, truth: Fault | None) -> control.StateSpace:
    """From commands to pointing, on the coordinates that a lock leaves."""
    faults = [] if truth is None else [truth]
    model = fault_model(nominal, faults)
    locked = [fault.actuator for fault in faults if fault.kind == "locked"]
    k = nominal.plant.nstates // 2
    left = scipy.linalg.null_space(nominal.displacement[locked, :k]) if locked else np.eye(k)
    Q = scipy.linalg.block_diag(left, left)
    return control.ss(Q.T @ model.A @ Q, Q.T @ model.B, nominal.plant.C @ Q, 0, nominal.period_s)


def _centred(kind: FaultKind, effectiveness: float) -> Case:
    """Strut 1 fails at the same point of the spiral, without a secondary displacement."""
    failures, begin_s = (Failure(0, kind, _FAILS_S, effectiveness),), _FAILS_S - BEFORE_S
    return of_hexapod("failure", 0, (0, 0), begin_s, BEFORE_S + AFTER_S, 0.0, failures)


INFORMED_LATE = (_centred("locked", 0.0), _centred("free", 0.0), _centred("weak", 1.0))
"""Of these the controller is informed late or wrongly; the last is no failure at all."""


def informed_late(case: Case) -> list[dict[str, Any]]:
    """One entry for each run: the truth, later and later; then, at once, that another strut locked.

    Ready for JSON, errors in sizes of the path.
    """
    rig, truth = exact_rig(), Fault.of(case.failures[0])
    run, tick = unaware(rig, case), tick_of(rig, case, case.happens_s)
    told_nothing = errors(rig, case, run, "unaware")
    news = [(truth, late_s) for late_s in LATE_S]
    news += [(Fault(k, "locked"), 0.0) for k in range(6) if k != truth.actuator]
    entries = []
    for fault, late_s in news:
        stood = float(run.displacement[tick, fault.actuator])
        found = errors(rig, case, informed(rig, case, fault, stood, late_s), "informed")
        named = {"truth": fault_text(None if truth.is_sound else truth), "told": fault_text(fault)}
        entries.append(
            named
            | {"late_s": late_s, "rms_unaware_after": told_nothing["rms_unaware_after"]}
            | {key: found[f"{key}"] for key in _TOLD}
        )
    return entries


_TOLD = ("peak_informed_during", "rms_informed_after", "peak_informed_after")


def dither_cost(case: Case, duration_s: float) -> dict[str, Any]:
    """RMS errors (m1,) without failures on the exact plant, and their changes by dither and seed.

    And how far the dither moves the major rows, all together, on a plant that is not the model:
    there the actuators do not cancel. In sizes of the path.
    """
    rig, at = exact_rig(), {"begin_s": 0.0, "duration_s": duration_s, "failures": ()}
    case, mixed = replace(case, **at), exact_rig().drawn("all", case.plant_seed)
    still = replace(case.dither or STILL, amplitude=0.0)

    def rms(dither: Dither | None, seed: int) -> Array:
        return unaware(rig, replace(case, seed=seed), dither).rms() / rig.size

    quiet, moved = (unaware(mixed, case, dither) for dither in (still, None))
    apart = distance(rig, replace(quiet, desired=moved.true))
    alone = rms(still, case.seed)
    return {
        "rms": alone.tolist(),
        "change": (rms(None, case.seed) - alone).tolist(),
        "reseeded": (rms(still, case.seed + 1) - alone).tolist(),
        "moved": float(np.sqrt((apart**2).mean())),
    }
