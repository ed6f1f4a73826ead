"""The sensors of a loop: that of the major task, and the encoders of the actuators."""

from dataclasses import dataclass
from typing import Any

import numpy as np

import argument_checks as check
from argument_checks import Array
from ftc.controller import Measurement
from ftc.sensor_check import SensorCheck, SensorState, numbers


@dataclass(frozen=True, slots=True)
class Sensors:
    """What is known of the sensors after a tick.

    Attributes:
        task: Of the major task.
        encoders: Of the actuators; without rows where they are not used.
        estimates: Whether the major task is estimated from the encoders.
    """

    task: SensorState
    encoders: SensorState
    estimates: bool = False

    @property
    def failed(self) -> bool:
        """Whether a reading was missing or repeated so far."""
        return any(each.held_ticks or each.repeated for each in (self.task, self.encoders))

    def sentence(self, period_s: float) -> str:
        """What the sensors read, and what is done about it."""
        if not self.failed:
            return "all readings are usable"
        instead = "the commands are held"
        if self.estimates:
            instead = "the task is estimated from the encoders"
        said = [self.task.sentence(period_s, "the sensor of the task", instead)]
        if self.encoders.held_ticks or self.encoders.repeated:
            done = "what needs them waits"
            said.append(self.encoders.sentence(period_s, "the set of encoders", done))
        return "; ".join(said)


@dataclass(frozen=True)
class SensorChecks:
    """When the readings of a loop are usable.

    Attributes:
        task: Of the major task.
        encoders: Of the actuators; None: they are not used, and not checked.

    Raises:
        TypeError: Of another kind than that.
    """

    task: SensorCheck
    encoders: SensorCheck | None = None

    def __post_init__(self) -> None:
        check.instance("task", self.task, SensorCheck)
        if self.encoders is not None:
            check.instance("encoders", self.encoders, SensorCheck)

    def start(self, rows: int, actuators: int) -> Sensors:
        """Before the first reading."""
        check, used = self.encoders or self.task, self.encoders is not None
        return Sensors(self.task.start(rows), check.start(actuators if used else 0))

    def step(
        self, state: Sensors, measurement: Any, sent: Array, *, estimable: bool = False
    ) -> Sensors:
        """The state after a measurement; whatever that is, nothing is raised.

        Args:
            state: Before it.
            measurement: What should have the attributes of a :class:`ftc.Measurement`.
            sent: Inputs of the drives since the measurement before, shape (n,).
            estimable: Whether encoders can stand in for a task's sensor that is lost.
        """
        task = self.task.step(state.task, getattr(measurement, "output", None), sent)
        encoders = state.encoders
        if self.encoders is not None:
            displacement = getattr(measurement, "displacement", None)
            encoders = self.encoders.step(encoders, displacement, sent)
        estimates = estimable and task.lost and not encoders.gap_ticks
        return Sensors(task, encoders, estimates)


def in_numbers(measurement: Any, rows: int, actuators: int) -> Measurement:
    """The measurement itself, or one of vectors: NaN where a reading is none, or a masked one."""
    output, displacement = (getattr(measurement, name, None) for name in ("output", "displacement"))
    if _is_vector(output, rows) and _is_vector(displacement, actuators):
        return measurement
    return Measurement(_vector(output, rows), _vector(displacement, actuators))


def _is_vector(reading: Any, size: int) -> bool:
    return check.is_plain(reading) and reading.shape == (size,)


def _vector(reading: Any, size: int) -> Array:
    if _is_vector(reading, size):
        return reading
    seen = numbers(reading, size)
    return np.full(size, np.nan) if seen is None else np.array(seen, dtype=float)
