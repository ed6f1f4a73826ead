"""Digital-to-analog converter and current amplifier in front of a voice coil."""

from dataclasses import dataclass

import numpy as np

from sim.array import Array


@dataclass(frozen=True)
class Amplifier:
    """Commanded strut displacement to normalized coil current.

    100 % is the largest DAC input allowed: there the amplifier gives its largest current, and the
    coil force holds the suspension spring at full stroke.

    Attributes:
        full_scale_m: Strut displacement at 100 % input.
        bits: Resolution of the two's-complement DAC.
        current_limit_a: Largest current, at 100 %.
    """

    full_scale_m: float
    bits: int
    current_limit_a: float

    def input_percent(self, displacement_m: Array) -> Array:
        """Normalized current 100 * DAC input / largest DAC input; quantized and saturated."""
        half = 2 ** (self.bits - 1)
        code = np.rint(displacement_m / self.full_scale_m * half)
        return np.clip(code, -half, half - 1) * (100.0 / half)

    def displacement_m(self, input_percent: Array) -> Array:
        """Strut displacement that an input holds at rest, [m]."""
        return input_percent * (self.full_scale_m / 100.0)

    def current_a(self, input_percent: Array) -> Array:
        """Coil current, [A]."""
        return input_percent * (self.current_limit_a / 100.0)
