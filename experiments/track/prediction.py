"""What the linear model predicts of a run: errors before and after the failures."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from experiments.robot.rig import Rig
from ftc.fdi.fault_model import Fault, fault_model
from ftc.goal import Goal
from ftc.linear_loop import Stage, steps
from sim import Array

_PULSE_S = 3.0
"""How long the response to a sample of noise is followed, in periods of the crossover."""


@dataclass(frozen=True)
class Known:
    """A fault, and from which tick on the mapping knows of it.

    Attributes:
        fault: What fails.
        tick: When.
        goal: Of the mapping from then on.
    """

    fault: Fault
    tick: int
    goal: Goal


def predicted_rms(rig: Rig, path: Array, known: Sequence[Known]) -> tuple[Array, Array]:
    """RMS of desired minus true before the first failure and from it on, (m1,) each.

    The plant is linear about its start and changes with each fault; the mapping is that of the
    start, and reconfigured at the same tick; the actuators go on from where they stand, and their
    secondary motion does not fade. Noise is white.
    """
    model, gain = fault_model(rig.nominal), rig.mapping(rig.goal).pointing_gain()
    stages, faults = [Stage(model.A, model.B, gain=gain, drift=model.drift)], []
    for each in known:
        faults.append(each.fault)
        after = fault_model(rig.nominal, faults)
        gain, goes_on = rig.mapping(each.goal).pointing_gain(), np.ones(rig.nominal.actuators)
        goes_on[[*each.goal.locked_m, *each.goal.free]] = 0.0
        stages.append(Stage(after.A, after.B, each.tick, after.onset, gain, goes_on, after.drift))
    C = rig.nominal.plant.C
    ticks = list(steps(stages, C, rig.loops, path, feedforward=rig.feedforward))
    error = path - np.array([tick.output for tick in ticks])
    cut = known[0].tick if known else len(path)
    variances = [_noise_variance(rig, stage) for stage in (stages[0], stages[-1])]
    halves = zip((error[:cut], error[cut:]), variances, strict=True)
    before, after = (
        np.sqrt((half**2).mean(axis=0) + variance) if len(half) else np.full(path.shape[1], np.nan)
        for half, variance in halves
    )
    return before, after


def _noise_variance(rig: Rig, stage: Stage) -> Array:
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
