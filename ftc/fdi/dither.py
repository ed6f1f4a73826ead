"""A small motion in the null space of the task, which distinguishes similar failures.

While all actuators work, the task does not see it. An actuator that does not follow leaves its own
column of the task Jacobian uncancelled.
"""

from dataclasses import dataclass

import numpy as np

from argument_checks import Array


@dataclass(frozen=True)
class Dither:
    """A sinusoid along one direction of actuator displacements.

    Attributes:
        amplitude: Of each actuator, in units of `direction`.
        frequency_hz: Its frequency.
        direction: Shape (n,); the mapping keeps the part that leaves the task alone.
        offset: Displacements about which it swings, shape (n,), or one for all.
    """

    amplitude: float
    frequency_hz: float
    direction: tuple[float, ...]
    offset: tuple[float, ...] | float = 0.0

    def at(self, time_s: float) -> Array:
        """Desired actuator displacements, shape (n,)."""
        swing = np.sin(2 * np.pi * self.frequency_hz * time_s)
        return np.array(self.offset) + self.amplitude * swing * np.array(self.direction)
