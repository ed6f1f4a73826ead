"""The closed loop as a whole and in parts, and its ticks with recorded measurements: no plant."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from experiments.benchmark.measurement import Contender
from experiments.rig.hexapod.choices import JacobianChoice
from experiments.rig.hexapod.columns import COLUMNS
from experiments.rig.hexapod.controller import controller_for
from experiments.rig.hexapod.fault_tolerance import nominal_model
from experiments.rig.hexapod.simulation import SpiralRun, Trajectory, track_path, track_spiral
from experiments.rig.hexapod.testbed import Testbed
from ftc.controller import Measurement, PrioritizedController
from ftc.fdi.diagnosis import DEFAULT_CONFIG
from ftc.fdi.monitor import Monitor, MonitorState, monitor
from sim import Array, Plant, Pose, hexapod

GOAL = COLUMNS[0].goal
"""W_a, all struts sound."""
_SAMPLED = 64
"""Ticks of the monitor in one sample."""


@dataclass(frozen=True)
class ClosedLoop:
    """The run that is timed: `seconds` of the spiral after settling, noise of this seed."""

    testbed: Testbed
    seconds: float
    seed: int

    @property
    def ticks(self) -> int:
        """Of control."""
        return len(self.testbed.bench.time_s(self.seconds))

    @property
    def steps(self) -> int:
        """Of physics, those of settling too."""
        seconds = self.testbed.bench.settling_s + self.seconds
        return round(seconds / self.testbed.model.opt.timestep)

    def run(self, jacobian: JacobianChoice) -> None:
        """The whole closed loop, its log kept in memory."""
        run = SpiralRun(GOAL, jacobian=jacobian, seed=self.seed, duration_s=self.seconds)
        track_spiral(self.testbed, run)

    def step(self) -> None:
        """MuJoCo alone, in one call."""
        model = self.testbed.model
        mujoco.mj_step(model, mujoco.MjData(model), self.steps)


def whole(loop: ClosedLoop) -> list[Contender]:
    """Times per control tick: bare physics, and the loop with either Jacobian."""
    return [
        Contender("mj_step", loop.step, lambda: [()], loop.ticks),
        Contender("closed_loop", loop.run, lambda: [("analytic",)], loop.ticks),
        Contender("closed_loop_constant", loop.run, lambda: [("constant",)], loop.ticks),
    ]


def parts(loop: ClosedLoop) -> list[Contender]:
    """Times of what a control tick is made of, each part alone, 0.2 s after the start of a run."""
    model, bench = loop.testbed.model, loop.testbed.bench
    controller = controller_for(loop.testbed, GOAL)
    _, state = track_path(loop.testbed, controller, seed=loop.seed, duration_s=0.2)
    mapping, amplifier = controller.mapping, controller.drives
    command_m, asked_rad = amplifier.displacements(state.inputs), state.asked.demand
    detector, strut_sensors = bench.detector(), bench.strut_sensors()
    rng, plant, bare = np.random.default_rng(loop.seed), Plant(model), mujoco.MjData(model)
    period_s = bench.control_period_s
    # Without what the estimate has already computed from this pose.
    bare_pose = Pose(state.pose.rotation, state.pose.translation_m)

    def sense() -> Measurement:
        plant.closure_residual_m()
        return Measurement(
            output=detector.read(plant.pose().rotation, rng),
            displacement=strut_sensors.read(plant.displacements(), rng),
        )

    timed: dict[str, tuple[Callable[..., Any], *tuple[Any, ...]]] = {
        "mj_step": (mujoco.mj_step, model, bare, round(period_s / model.opt.timestep)),
        "plant_step": (plant.step, command_m, period_s),
        "sensors": (sense,),
        "controller": (controller.step, state, asked_rad, sense()),
        "estimate": (mapping.estimate, command_m, state.pose),
        "mapping": (mapping.displacements, asked_rad, state.pose),
        "jacobian": (hexapod(model).inverse_jacobian, bare_pose),
        "converter": (amplifier.inputs, command_m),
    }
    return [
        Contender(f"part_{name}", call, lambda given=tuple(given): [given] * 32, 32, samples=5)
        for name, (call, *given) in timed.items()
    ]


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
        held_m = self.controller.drives.displacements(run.strut_input_percent)
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


def recorded(testbed: Testbed, seed: int) -> Recorded:
    """A run as long as the diagnosis looks back, so that its history is full, and a little more."""
    controller = controller_for(testbed, GOAL)
    seconds = DEFAULT_CONFIG.look_back_s + 2 * _SAMPLED * testbed.bench.control_period_s
    run, _ = track_path(testbed, controller, seed=seed, duration_s=seconds)
    return Recorded(testbed, controller, run)
