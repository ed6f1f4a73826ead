"""The plant of any MJCF robot with its sensors and drives, as it differs from the model."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import ClassVar

import numpy as np

from fjh.rig.draw import Draw
from fjh.rig.mismatch import EXACT, Mismatch, sampled_model, without
from fjh.rig.robot import Robot
from sim import Array, Bench, Failure, Pose
from sim.plant import JointSensors, Reading, Sensors, TaskSensor

ALL = Mismatch(gain=0.03, damping=0.2, inertia=0.02, delay_ticks=1, drift_per_s=0.1, steps=2)
"""Everything at once: gains, dampers, inertias and delay as of the hexapod's testbed."""

SIZES = ("gain", "damping", "inertia", "delay_ticks", "drift_per_s", "steps")
"""Sizes that a robot of a file has: it tells nothing of a floor, or of springs preloaded anew."""


@dataclass(frozen=True)
class RobotMachine:
    """A robot at its start, and how its plant differs from it.

    Attributes:
        robot: The robot.
        sizes: How far the plant is from the model.
        seed: Of what is sampled of it.
    """

    everything: ClassVar[Mismatch] = ALL
    unknown: ClassVar[tuple[str, ...]] = without(SIZES)

    robot: Robot
    sizes: Mismatch = EXACT
    seed: int = 0

    def drawn(self, sizes: Mismatch, seed: int) -> "RobotMachine":
        """The same robot on another plant."""
        return replace(self, sizes=sizes, seed=seed)

    def bench(
        self, time_s: Array, failures: Sequence[Failure], seed: int, events: object = None
    ) -> Bench:
        """The machine for times (N,), with noise of this seed.

        A plant is commanded by displacements, and balances its own gains and springs; the controls
        of a robot are made by the model that its controller has. At the start both stand still: a
        robot is held there before a run.
        """
        robot, sizes = self.robot, self.sizes
        draw = Draw(self.seed, sizes.family)
        model, gains = sampled_model(robot.model, robot.known.drives, sizes, draw)
        plant = robot.plant(model)
        per_command = gains * robot.known.stiffness / plant.stiffness
        return Bench(
            plant,
            self._sensors(seed),
            time_s=time_s,
            period_s=robot.period_s,
            failures=failures,
            drives=partial(np.multiply, per_command),
            delay_ticks=sizes.delay_ticks,
            log_qpos=True,
            events=events,
        )

    def _sensors(self, seed: int) -> Sensors:
        """Of the task, or encoders alone; zeros drift up to so many standard deviations."""
        robot, rows, draw = self.robot, self.robot.options.major, Draw(self.seed)
        per_tick = self.sizes.drift_per_s * robot.period_s
        noise, encoder_noise = robot.noise, robot.encoder_noise
        of_task = per_tick * noise * draw.uniform("task drift", len(rows))
        of_encoders = per_tick * encoder_noise * draw.uniform("drift", len(robot.known.drives))
        sensors: Sensors = TaskSensor(rows, noise, encoder_noise, seed)
        if robot.options.sense == "joints":
            # The task is computed from the encoders, and drifts with them.
            sensors = JointSensors(robot.mechanism, rows, encoder_noise, seed)
            of_task = 0 * of_task
        if not (of_task.any() or of_encoders.any()):
            return sensors
        return DriftingSensors(sensors, of_task, of_encoders)


class DriftingSensors:
    """Sensors whose zeros move at constant rates from the first reading on."""

    def __init__(self, sensors: Sensors, of_task: Array, of_encoders: Array) -> None:
        """Take the sensors, and how far each zero moves in a tick, (m1,) and (n,)."""
        self._sensors, self._rates, self._ticks = sensors, (of_task, of_encoders), 0

    def read(self, pose: Pose, displacements: Array) -> Reading:
        """What they read, their zeros where they are by now."""
        of_task, of_encoders = (rate * self._ticks for rate in self._rates)
        self._ticks += 1
        reading = self._sensors.read(pose, displacements + of_encoders)
        return reading._replace(output=reading.output + of_task)
