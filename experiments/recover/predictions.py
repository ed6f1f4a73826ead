"""What the linear model predicts, before any noise: isolability, dithers, wrong beliefs."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import control
import numpy as np
import scipy.linalg

from argument_checks.ties import ascending, greatest, least
from experiments.recover.flight import DITHER, STRUCK, Flight
from experiments.rig.hexapod.controller import StrutMapping
from experiments.rig.hexapod.fault_tolerance import STILL, fault_entry, fault_text, nominal_model
from experiments.rig.hexapod.prediction import linear_loop, peak_of_sensitivity
from experiments.rig.hexapod.rig import HexapodRig
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

EVIDENCE_S = 0.5
"""How long evidence is collected; a dither is for speed, and has less:"""
DITHER_EVIDENCE_S = 0.1

DIRECTIONS = {"gamma": 2, "t_x": 3, "t_y": 4, "t_z": 5}
"""Payload motions that pointing does not see, by the column of strut displacements per twist."""
FREQUENCIES_HZ = (5.0, 10.0, 20.0, 30.0)
AMPLITUDES_M = (0.125e-6, 0.25e-6, 0.5e-6, 1e-6)

HALF = 0.5
"""Effectiveness of a weak coil."""

_BEGIN_S, _EARLIEST_S = 6.0, 1.5
_RIGID: tuple[FaultKind, ...] = ("locked", "free")


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


def from_others_and_kinds(rig: HexapodRig, flight: Flight) -> tuple[float, float]:
    """Distance from other struts and no failure, and from other kinds of the same strut.

    Of the flight's failure, by the detector and the dither.
    """
    loop = _loop(rig, flight.dither(), flight.begin_s, flight.duration_s)
    fault = flight.fault
    distance, from_none = _distances(loop, loop.nominal, fault, STRUCK, EVIDENCE_S)
    from_others = min(float(np.delete(distance, fault.actuator, axis=0).min()), from_none)
    return from_others, float(_other_kinds(distance, fault).min())


def lookalikes(rig: HexapodRig, setting: Setting, struts: Sequence[int]) -> list[dict[str, Any]]:
    """One entry, ready for JSON, for each kind of failure of these struts, centred and off centre.

    Each within half a turn of the spiral from 7.5 s on.
    """
    testbed, period_s = rig.testbed, rig.period_s
    half_turn_s = testbed.bench.spiral_period_s / 2
    duration_s = _EARLIEST_S + half_turn_s + EVIDENCE_S + period_s
    loop = _loop(rig, setting.dither, _BEGIN_S, duration_s)
    watched = nominal_model(testbed.model, testbed.bench, strut_sensors=setting.strut_sensors)
    first, half_turn = round(_EARLIEST_S / period_s), round(half_turn_s / period_s)
    moved_m = (loop.reference @ loop.gain.T)[first : first + half_turn]
    entries = []
    for fault in [Fault(k, kind, HALF * (kind == "weak")) for k in struts for kind in KINDS]:
        for where, choose in _PLACES.items():
            onset = first + choose(moved_m[:, fault.actuator])
            distance, from_none = _distances(loop, watched, fault, onset, EVIDENCE_S)
            seen = {"setting": setting.name, "failure": fault_entry(fault), "where": where}
            seen["from_soundness"] = from_none
            entries.append(seen | _nearest(distance, fault))
    return entries


_PLACES: dict[Literal["centre", "off centre"], Callable[[Array], int]] = {
    "centre": lambda strut_m: least(np.abs(strut_m)),
    "off centre": lambda strut_m: greatest(np.abs(strut_m)),
}


def _nearest(distance: Array, fault: Fault) -> dict[str, Any]:
    """The nearest other strut and kind, and all that is alike, the nearest first."""
    own, strut = KINDS.index(fault.kind), fault.actuator
    others = np.delete(distance, strut, axis=0).min(axis=1)
    kinds = _other_kinds(distance, fault)
    alike = [
        fault_entry(Fault(k, kind)) | {"separation": float(distance[k, column])}
        for k in range(len(distance))
        for column, kind in enumerate(KINDS)
        if (k, kind) != (strut, fault.kind) and distance[k, column] < ALIKE
    ]
    return {
        "nearest_other_strut": int(np.delete(np.arange(6), strut)[least(others, ACCURACY)]) + 1,
        "from_other_struts": float(others.min()),
        "nearest_other_kind": np.delete(KINDS, own)[least(kinds, ACCURACY)].item(),
        "from_other_kinds": float(kinds.min()),
        "alike": [alike[k] for k in ascending([one["separation"] for one in alike])],
    }


def _other_kinds(distance: Array, fault: Fault) -> Array:
    return np.delete(distance[fault.actuator], KINDS.index(fault.kind))


def dither_design(
    rig: HexapodRig, struts: Sequence[int], frequencies_hz: Sequence[float]
) -> list[dict[str, Any]]:
    """Least distance of a locked or free strut from the others, an entry for each dither.

    Each direction at each frequency; then the amplitudes of the one that is chosen.
    """
    per_twist = hexapod(rig.model).inverse_jacobian(NOMINAL)
    onset = round(_EARLIEST_S / rig.period_s)

    def entry(name: str, frequency_hz: float, amplitude_m: float) -> dict[str, Any]:
        column = per_twist[:, DIRECTIONS[name]]
        direction = tuple((column / np.abs(column).max()).tolist())
        dither = Dither(amplitude_m, frequency_hz, direction)
        loop = _loop(rig, dither, _BEGIN_S, _EARLIEST_S + DITHER_EVIDENCE_S)
        apart: list[float] = []
        for fault in [Fault(strut, kind) for strut in struts for kind in _RIGID]:
            distance, _ = _distances(loop, loop.nominal, fault, onset, DITHER_EVIDENCE_S)
            apart.append(np.delete(distance, fault.actuator, axis=0).min())
        named = {"direction": name, "frequency_hz": frequency_hz, "amplitude_m": amplitude_m}
        return named | {"separation": float(min(apart))}

    entries = [entry(name, hz, DITHER.amplitude) for name in DIRECTIONS for hz in frequencies_hz]
    return entries + [entry("t_z", DITHER.frequency_hz, size) for size in AMPLITUDES_M]


def _loop(rig: HexapodRig, dither: Dither, begin_s: float, duration_s: float) -> LinearLoop:
    span = {"begin_s": begin_s, "duration_s": duration_s}
    return linear_loop(rig.testbed, rig.goal, dither, **span)


def _distances(
    loop: LinearLoop, watched: NominalModel, fault: Fault, onset: int, evidence_s: float
) -> tuple[Array, float]:
    states, commanded = simulate(loop, [fault], onset)
    until = onset + round(evidence_s / loop.nominal.period_s)
    return isolability(watched, fault, onset, states[:until], commanded[:until])


def beliefs(rig: HexapodRig, struts: Sequence[int]) -> list[dict[str, Any]]:
    """The loop under each failure of one of these struts or none, under each belief about a strut.

    Entries of the faults in words, the largest size of a closed-loop pole (below 1 is stable), and
    the peak of the largest singular value of the sensitivity.
    """
    nominal = rig.nominal
    compensators = control.append(*(loop.discrete for loop in rig.testbed.loops))
    truths = [None, *(Fault(k, kind, HALF) for kind in KINDS for k in struts)]
    possible = [None, *(Fault(k, kind, WEAKEST) for kind in ("locked", "weak") for k in range(6))]
    gains = [_gain(rig, believed) for believed in possible]
    found = []
    for truth in truths:
        P = _plant(nominal, truth)
        for believed, gain in zip(possible, gains, strict=True):
            L = control.ss(P.A, P.B @ gain, P.C, 0, P.dt) * compensators
            pole = float(np.abs(control.feedback(L, np.eye(2)).poles()).max())
            pair = {"truth": fault_text(truth), "believed": fault_text(believed)}
            peak = peak_of_sensitivity(L)
            found.append(pair | {"largest_pole": pole, "sensitivity_peak": peak})
    return found


def _gain(rig: HexapodRig, believed: Fault | None) -> Array:
    """Commanded strut displacements per (alpha, beta), shape (6, 2)."""
    goal, effectiveness = rig.goal, np.ones(6)
    if believed is not None and believed.kind == "weak":
        effectiveness[believed.actuator] = believed.effectiveness
    elif believed is not None:
        goal = Goal(goal.joint_weight, locked_at={believed.actuator: 0.0})
    mapping = StrutMapping(hexapod(rig.model), goal, "constant")
    return mapping.major_gain() / effectiveness[:, None]


def _plant(nominal: NominalModel, truth: Fault | None) -> control.StateSpace:
    """From commands to pointing, on the coordinates that a lock leaves."""
    faults = [] if truth is None else [truth]
    model = fault_model(nominal, faults)
    stuck = [fault.actuator for fault in faults if fault.kind == "locked"]
    k = nominal.plant.nstates // 2
    left = scipy.linalg.null_space(nominal.displacement[stuck, :k]) if stuck else np.eye(k)
    Q = scipy.linalg.block_diag(left, left)
    return control.ss(Q.T @ model.A @ Q, Q.T @ model.B, nominal.plant.C @ Q, 0, nominal.period_s)
