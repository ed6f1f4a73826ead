"""A small motion that pointing does not see while all struts are sound.

All six struts lengthen and shorten together: the payload heaves along the line of sight. The
columns of J_m of the six struts add up to zero, statically and, by the threefold symmetry of the
machine, at any frequency. A strut that does not follow leaves its own column uncancelled: six
directions in the plane of (alpha, beta), 60 degrees apart, and each strut has one to itself.
"""

from dataclasses import dataclass

import numpy as np

from sim import Array

HEAVE = (1.0,) * 6


@dataclass(frozen=True)
class Dither:
    """A sinusoid along one direction of strut displacements, about a point of rest.

    Attributes:
        amplitude_m: Of each strut, in units of `direction`.
        frequency_hz: Its frequency.
        direction: Shape (6,); the mapping keeps the part that leaves pointing alone.
        rest_m: Strut displacements about which it swings, shape (6,).
    """

    amplitude_m: float
    frequency_hz: float
    direction: tuple[float, ...] = HEAVE
    rest_m: tuple[float, ...] = (0.0,) * 6

    def at(self, time_s: float) -> Array:
        """Desired strut displacements, shape (6,)."""
        swing = np.sin(2 * np.pi * self.frequency_hz * time_s)
        return np.array(self.rest_m) + self.amplitude_m * swing * np.array(self.direction)


STILL = Dither(amplitude_m=0.0, frequency_hz=0.0)
