"""A small motion in the null space of the task, which distinguishes similar failures.

While all actuators work, the task does not see it. An actuator that does not follow leaves its own
column of the task Jacobian uncancelled.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

import argument_checks as check
from argument_checks import Array


@dataclass(frozen=True)
class Dither:
    """A sinusoid along one direction of actuator displacements.

    Attributes:
        amplitude: Of each actuator, in units of `direction`.
        frequency_hz: Its frequency.
        direction: Shape (n,); the mapping keeps the part that leaves the task alone.
        offset: Displacements about which it swings, shape (n,), or one for all.

    Raises:
        ValueError: Not finite numbers, or of other shapes.
    """

    amplitude: float
    frequency_hz: float
    direction: tuple[float, ...]
    offset: tuple[float, ...] | float = 0.0

    def __post_init__(self) -> None:
        check.number("amplitude", self.amplitude)
        check.number("frequency_hz", self.frequency_hz)
        direction = check.series("direction", self.direction)
        offset = check.finite("offset", self.offset)
        if offset.shape not in ((), direction.shape):
            raise ValueError(
                f"offset must be one number or {len(direction)}, got shape {offset.shape}"
            )
        swings_about = tuple(offset.tolist()) if offset.ndim else float(offset)
        vars(self).update(direction=tuple(direction.tolist()), offset=swings_about)

    def at(self, time_s: float) -> Array:
        """Desired actuator displacements, shape (n,).

        Raises:
            ValueError: Not one finite time.
        """
        swing = np.sin(2 * np.pi * self.frequency_hz * check.signed("time_s", time_s))
        offset, direction = self._arrays
        return offset + self.amplitude * swing * direction

    @cached_property
    def _arrays(self) -> tuple[Array, Array]:
        return np.array(self.offset), np.array(self.direction)
