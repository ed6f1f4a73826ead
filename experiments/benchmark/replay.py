"""Ticks of controller and diagnosis as in a closed loop, with recorded measurements: no plant."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from experiments.benchmark.measurement import Contender
from experiments.rig.hexapod.controller import controller_for
from experiments.rig.hexapod.fault_tolerance import nominal_model
from experiments.rig.hexapod.simulation import Trajectory, track_path
from experiments.rig.hexapod.testbed import Testbed
from ftc.controller import Measurement, PrioritizedController
from ftc.fdi.diagnosis import DEFAULT_CONFIG
from ftc.fdi.monitor import Monitor, MonitorState, monitor
from ftc.goal import Goal
from sim import Array, Pose

_SAMPLED = 64
"""Ticks of the monitor in one sample."""


@dataclass(frozen=True)
class Recorded:
    """A run of the hexapod in closed loop, all struts sound, and the controller that made it."""

    testbed: Testbed
    controller: PrioritizedController[Pose]
    run: Trajectory

    def controlling(self) -> Callable[[], None]:
        """A call is one control tick: with the inputs of the run, after the last over again."""
        pilot, run = self.controller, self.run
        at_rest = np.zeros(pilot.mapping.actuators)
        given = [
            (desired, Measurement(output=measured, displacement=at_rest))
            for desired, measured in zip(run.desired_rad, run.measured_rad, strict=True)
        ]
        state, k = pilot.start(), 0

        def tick() -> None:
            nonlocal state, k
            state = pilot.step(state if k else pilot.start(), *given[k])
            k = (k + 1) % len(given)

        return tick

    def watched(self) -> tuple[Monitor, list[tuple[MonitorState, Array, Array]]]:
        """A monitor, and the arguments of its last ticks: state, outputs, displacements.

        Raises:
            RuntimeError: The monitor raised an alarm, and would do more work than without.
        """
        bench, run = self.testbed.bench, self.run
        watch = monitor(nominal_model(self.testbed.model, bench))
        held_m = self.controller.amplifier.displacement_m(run.strut_input_percent)
        commanded_m = np.vstack([np.zeros((1, held_m.shape[1])), held_m[:-1]])
        state, arguments = watch.start(), []
        for given in zip(run.measured_rad, commanded_m, strict=True):
            arguments.append((state, *given))
            state = watch.step(state, *given)
        if state.alarm_ticks:
            raise RuntimeError("the monitor raised an alarm in a run without failures")
        return watch, arguments[-_SAMPLED:]

    def diagnosis(self) -> Contender:
        """What the diagnosis adds to a control tick while nothing has failed."""
        watch, arguments = self.watched()
        return Contender("diagnosis", watch.step, lambda: arguments, len(arguments), samples=5)


def recorded(testbed: Testbed, goal: Goal, seed: int) -> Recorded:
    """A run as long as the diagnosis looks back, so that its history is full, and a little more."""
    controller = controller_for(testbed, goal)
    seconds = DEFAULT_CONFIG.look_back_s + 2 * _SAMPLED * testbed.bench.control_period_s
    run, _ = track_path(testbed, controller, seed=seed, duration_s=seconds)
    return Recorded(testbed, controller, run)
