"""Plant of any MJCF robot with sensors and drives, and a mismatch to the controller's model."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import ClassVar

import numpy as np

from fjh.rig.mismatch import EXACT, Mismatch, sampled_model, without
from fjh.rig.random_streams import RandomStreams
from fjh.rig.robot import Robot
from sim import Array, Bench, Failure, Pose
from sim.plant import JointSensors, Reading, Sensors, TaskSensor

ALL = Mismatch(gain=0.03, damping=0.2, inertia=0.02, delay_ticks=1, drift_per_s=0.1, steps=2)
"""Mismatch of all kinds at once: gains, dampers, inertias and delay as for the hexapod."""

SIZES = ("gain", "damping", "inertia", "delay_ticks", "drift_per_s", "steps")
"""Sizes that apply to a robot of a file, which states no floor and no preload of springs."""


@dataclass(frozen=True)
class RobotMachine:
    """Simulated machine of a robot, whose plant differs from the controller's model.

    Attributes:
        robot: The robot.
        sizes: Sizes of the differences between plant and model.
        seed: Seed of the sampled plant.
    """

    everything: ClassVar[Mismatch] = ALL
    unknown: ClassVar[tuple[str, ...]] = without(SIZES)

    robot: Robot
    sizes: Mismatch = EXACT
    seed: int = 0

    def with_mismatch(self, sizes: Mismatch, seed: int) -> "RobotMachine":
        """Return the same robot with another plant."""
        return replace(self, sizes=sizes, seed=seed)

    def bench(
        self, time_s: Array, failures: Sequence[Failure], seed: int, events: object = None
    ) -> Bench:
        """Return the machine for times (N,), with sensor noise of this seed.

        The controls are those that the controller's model needs for the commanded displacements, so
        that the plant's own gains and springs are not compensated. The plant is at rest at the
        start.
        """
        robot, sizes = self.robot, self.sizes
        streams = RandomStreams(self.seed, sizes.family)
        model, gains = sampled_model(robot.model, robot.nominal_plant.drives, sizes, streams)
        plant = robot.plant(model)
        per_command = gains * robot.nominal_plant.stiffness / plant.stiffness
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
        """Return the sensors, of the task or encoders, whose zeros drift at sampled rates."""
        robot, rows, streams = self.robot, self.robot.options.major, RandomStreams(self.seed)
        per_tick = self.sizes.drift_per_s * robot.period_s
        noise, encoder_noise, n = robot.noise, robot.encoder_noise, len(robot.nominal_plant.drives)
        of_task = per_tick * noise * streams.uniform("task drift", len(rows))
        of_encoders = per_tick * encoder_noise * streams.uniform("drift", n)
        sensors: Sensors = TaskSensor(rows, noise, encoder_noise, seed)
        if robot.options.sense == "joints":
            # The task is computed from the encoders, and drifts with them.
            sensors = JointSensors(robot.mechanism, rows, encoder_noise, seed)
            of_task = 0 * of_task
        if not (of_task.any() or of_encoders.any()):
            return sensors
        return DriftingSensors(sensors, of_task, of_encoders)


class DriftingSensors:
    """Sensors whose zeros drift at constant rates from the first reading on."""

    def __init__(self, sensors: Sensors, of_task: Array, of_encoders: Array) -> None:
        """Take the sensors, and the drift per tick of task (m1,) and encoder (n,) zeros."""
        self._sensors, self._rates, self._ticks = sensors, (of_task, of_encoders), 0

    def read(self, pose: Pose, displacements: Array) -> Reading:
        """Return the reading with zeros shifted by the drift so far."""
        of_task, of_encoders = (rate * self._ticks for rate in self._rates)
        self._ticks += 1
        reading = self._sensors.read(pose, displacements + of_encoders)
        return reading._replace(output=reading.output + of_task)
