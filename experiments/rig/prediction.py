"""What the linear model predicts of a flight: errors before and after the failures."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

import argument_checks as check
from argument_checks.ties import greatest
from ftc.fdi.diagnosis import Diagnosis
from ftc.fdi.dither import Dither
from ftc.fdi.fault_model import Fault, fault_model
from ftc.linear_loop import Stage, steps
from ftc.reconfiguration import goal_after
from sim import Array, Failure

if TYPE_CHECKING:
    from experiments.rig.rig import Rig

_PULSE_S = 3.0
"""How long the response to a sample of noise is followed, in periods of the crossover."""


class Prediction(NamedTuple):
    """RMS of desired minus true, before the first failure and from it on, (m1,) each.

    NaN where there is no such time, and where the linear model does not hold.

    Attributes:
        rms_before: (m1,).
        rms_after: (m1,).
        leaves: The actuator that leaves its range in the linear model, which then says nothing any
            more; None is none.
    """

    rms_before: Array
    rms_after: Array
    leaves: str | None = None


Learns = bool | Sequence[float | None]
"""When a controller learns of failures: at once, never, or at a time [s] each; None is never."""


def predicted(
    rig: "Rig",
    path: Array,
    failures: Sequence[Failure],
    *,
    told: Learns,
    noise: Array | None = None,
    dither: Dither | None = None,
    bent: Array | float = 0.0,
) -> Prediction:
    """The prediction of a flight; see :meth:`experiments.rig.Rig.predict`.

    `bent` is what the task deviates by from the linear model besides, of the shape of the path.

    The plant is linear about its start and changes with each fault; the mapping is that of the
    start, and is reconfigured at the tick at which the controller learns of a fault; the actuators
    go on from where they stand, and their secondary motion does not fade. Noise that is not known
    is white.
    """
    model, goal = fault_model(rig.nominal), rig.goal
    mapping = rig.mapping(goal)
    start = {"gain": mapping.major_gain(), "drift": model.drift, "rubbing": model.rubbing}
    stages = [Stage(model.A, model.B, **start)]
    swings, swing = _swings(rig, dither, len(path)), np.zeros((len(path), rig.nominal.actuators))
    swing += swings @ mapping.secondary_gain().T
    faults, first = list[Fault](), len(path)
    for tick, changes in _changes(rig, failures, told):
        struck = [fault for fault, is_known in changes if not is_known]
        first, faults = min(first, tick), [*faults, *struck]
        after, goes_on = fault_model(rig.nominal, faults), None
        if known := [Diagnosis.told(fault) for fault, is_known in changes if is_known]:
            goal = goal_after(goal, known, rig.nominal, rig.unused)
            mapping = rig.mapping(goal)
            goes_on = np.ones(rig.nominal.actuators)
            goes_on[[*goal.locked_at, *goal.free]] = 0.0
            swing[tick:] = swings[tick:] @ mapping.secondary_gain().T
        onset = after.onset if struck else None
        gain = mapping.major_gain()
        then = onset, gain, goes_on, after.drift, after.rubbing
        stages.append(Stage(after.A, after.B, tick, *then))
    C = rig.nominal.plant.C
    reference, demands = path if noise is None else path - noise, rig.feedforward_demands(path)
    reference = reference - bent
    ticks = list(steps(stages, C, rig.loops, reference, secondary=swing, feedforward=demands))
    error = path - bent - np.array([tick.output for tick in ticks])
    halves, leaves = [], None
    for part, stage in ((slice(first), stages[0]), (slice(first, None), stages[-1])):
        leaves = leaves or _leaving(rig, [tick.x for tick in ticks[part]])
        rms = np.full(path.shape[1], np.nan)
        if leaves is None and len(error[part]):
            of_noise = _noise_variance(rig, stage) if noise is None else 0.0
            rms = np.sqrt((error[part] ** 2).mean(axis=0) + of_noise)
        halves.append(rms)
    return Prediction(halves[0], halves[1], leaves)


def _changes(
    rig: "Rig", failures: Sequence[Failure], told: Learns
) -> list[tuple[int, list[tuple[Fault, bool]]]]:
    """At each tick at which something changes: faults that strike, and those that get known."""
    times: Sequence[float | None] = [each.time_s if told else None for each in failures]
    if not isinstance(told, bool):
        check.instance("told", told, bool, list, tuple, np.ndarray)
        times = told
    if len(times) != len(failures):
        raise ValueError(f"told must be a time for each of {len(failures)} failures, got {told}")
    changes = dict[int, list[tuple[Fault, bool]]]()
    for failure, known_s in zip(failures, times, strict=True):
        for at_s, is_known in ((failure.time_s, False), (known_s, True)):
            if at_s is not None:
                if check.signed("told", at_s) < failure.time_s:
                    raise ValueError(f"told must be no times before the failures, got {told}")
                tick = math.ceil(at_s / rig.period_s - 1e-6)
                changes.setdefault(tick, []).append((Fault.of(failure), is_known))
    return sorted(changes.items())


def _swings(rig: "Rig", dither: Dither | None, ticks: int) -> Array:
    """What the dither asks of the actuators at each tick, (N, n)."""
    if dither is None:
        return np.zeros((ticks, rig.nominal.actuators))
    return np.array([dither.at(tick * rig.period_s) for tick in range(ticks)])


def _leaving(rig: "Rig", states: list[Array]) -> str | None:
    """The actuator that leaves its range furthest in these states (s,); None where none does."""
    if not states:
        return None
    (lower, upper), moved = rig.travel, np.array(states) @ rig.nominal.displacement.T
    beyond = np.maximum(lower - moved, moved - upper).max(axis=0)
    return rig.actuators[greatest(beyond)] if beyond.max() > 0.0 else None


def _noise_variance(rig: "Rig", stage: Stage) -> Array:
    """Variance (m1,) of the true task that the white noise of the sensors causes."""
    m1 = len(rig.loops)
    slowest_hz = min(each.crossover_hz for each in rig.margins)
    pulses = np.zeros((m1, round(_PULSE_S / slowest_hz / rig.period_s), m1))
    pulses[range(m1), 0, range(m1)] = 1.0  # a reference of the compensators alone is such a noise
    first = Stage(stage.A, stage.B, gain=stage.gain)
    outputs = np.array(
        [tick.output for tick in steps([first], rig.nominal.plant.C, rig.loops, pulses)]
    )
    return np.einsum("tsk,s->k", outputs**2, rig.nominal.noise**2)
