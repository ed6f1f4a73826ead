"""What the linear model predicts of a flight: errors before and after the failures."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from argument_checks.ties import greatest
from ftc.fdi.diagnosis import Diagnosis
from ftc.fdi.fault_model import Fault, fault_model
from ftc.linear_loop import Stage, steps
from ftc.supervisor import goal_after
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


def predicted(
    rig: "Rig",
    path: Array,
    failures: Sequence[Failure],
    *,
    told: bool,
    noise: Array | None = None,
) -> Prediction:
    """The prediction of a flight; see :meth:`experiments.rig.Rig.predict`.

    The plant is linear about its start and changes with each fault; the mapping is that of the
    start, and where the controller is told reconfigured at the same tick; the actuators go on from
    where they stand, and their secondary motion does not fade. Noise that is not known is white.
    """
    model, goal = fault_model(rig.nominal), rig.goal
    gain = rig.mapping(goal).major_gain()
    stages, faults, first = [Stage(model.A, model.B, gain=gain, drift=model.drift)], [], len(path)
    for failure in sorted(failures, key=lambda each: each.time_s):
        tick = math.ceil(failure.time_s / rig.period_s - 1e-6)
        first = min(first, tick)
        faults.append(Fault.of(failure))
        after = fault_model(rig.nominal, faults)
        if told:
            goal = goal_after(goal, [Diagnosis.told(faults[-1])], rig.unused)
        gain, goes_on = rig.mapping(goal).major_gain(), np.ones(rig.nominal.actuators)
        goes_on[[*goal.locked_at, *goal.free]] = 0.0
        stages.append(Stage(after.A, after.B, tick, after.onset, gain, goes_on, after.drift))
    C = rig.nominal.plant.C
    reference, demands = path if noise is None else path - noise, rig.feedforward_demands(path)
    ticks = list(steps(stages, C, rig.loops, reference, feedforward=demands))
    error = path - np.array([tick.output for tick in ticks])
    halves, leaves = [], None
    for part, stage in ((slice(first), stages[0]), (slice(first, None), stages[-1])):
        leaves = leaves or _leaving(rig, [tick.x for tick in ticks[part]])
        rms = np.full(path.shape[1], np.nan)
        if leaves is None and len(error[part]):
            of_noise = _noise_variance(rig, stage) if noise is None else 0.0
            rms = np.sqrt((error[part] ** 2).mean(axis=0) + of_noise)
        halves.append(rms)
    return Prediction(halves[0], halves[1], leaves)


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
