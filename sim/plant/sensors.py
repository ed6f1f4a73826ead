"""Sensors of a machine in a loop: of the task frame, or encoders alone."""

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np

import argument_checks as check
from sim.array import Array
from sim.kinematics.mechanism import JointPosture, Mechanism
from sim.kinematics.pose import Pose


class Reading(NamedTuple):
    """Reading at one tick, as :class:`ftc.Measurement`: major task (m1,) and actuators (n,)."""

    output: Array
    displacement: Array


class Sensors(Protocol):
    """Protocol of the sensors of a machine."""

    def read(self, pose: Pose, displacements: Array) -> Reading:
        """Read at a pose of the task frame and displacements (n,) of the actuators."""
        ...


class TaskSensor:
    """A sensor of the task frame itself, such as a camera or a tracker, beside encoders."""

    def __init__(
        self, rows: Sequence[int], noise: float, encoder_noise: float, seed: int | Sequence[int]
    ) -> None:
        """Measure rows of [rotation vector; translation] of the task frame.

        Noise is a standard deviation of one sample of each row, and of each actuator's
        displacement, [rad] or [m].
        """
        self._rows = check.indices("rows", rows, 6)
        self._noise = check.number("noise", noise, 0.0)
        self._encoder_noise = check.number("encoder_noise", encoder_noise, 0.0)
        self._rng = _generator(seed)

    def read(self, pose: Pose, displacements: Array) -> Reading:
        """The rows and the displacements, with noise."""
        displacements, m1 = _seen(pose, displacements), len(self._rows)
        noise = self._rng.standard_normal(m1 + len(displacements))
        output = pose.displacement().take(self._rows) + self._noise * noise[:m1]
        return Reading(output, displacements + self._encoder_noise * noise[m1:])


class JointSensors:
    """Encoders alone: the task follows from the forward kinematics of a model, loops closed."""

    def __init__(
        self,
        mechanism: Mechanism,
        rows: Sequence[int],
        encoder_noise: float,
        seed: int | Sequence[int],
    ) -> None:
        """Start at the nominal posture of the mechanism; arguments as :class:`TaskSensor`."""
        self._mechanism = check.instance("mechanism", mechanism, Mechanism)
        self._rows = check.indices("rows", rows, 6)
        self._noise = check.number("encoder_noise", encoder_noise, 0.0)
        self._rng = _generator(seed)
        self._posture: JointPosture = mechanism.nominal
        self._all = np.arange(len(mechanism.nominal.displacements))

    def read(self, pose: Pose, displacements: Array) -> Reading:
        """The task as the encoders have it, and what they read; the true pose stays unknown."""
        displacements = _seen(pose, displacements)
        seen = displacements + self._noise * self._rng.standard_normal(len(displacements))
        self._posture = self._mechanism.moved(self._posture, seen, self._all)
        return Reading(self._mechanism.task(self._posture)[self._rows], seen)


def _seen(pose: Pose, displacements: Array) -> Array:
    check.instance("pose", pose, Pose)
    return check.array("displacements", displacements, None)


def _generator(seed: int | Sequence[int]) -> np.random.Generator:
    """Of one integer that is not negative, or of a list of some; numpy crashes at other things."""
    listed = seed if isinstance(seed, list | tuple) and seed else [seed]
    return np.random.default_rng([check.integer("seed", each) for each in listed])
