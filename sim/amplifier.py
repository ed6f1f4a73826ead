"""Digital-to-analog converter, current amplifier and voice coil: from command to displacement."""

from dataclasses import dataclass

import numpy as np

import argument_checks as check
from sim.array import Array


@dataclass(frozen=True)
class Amplifier:
    """One strut's drive chain: DAC input, coil current, coil force on the suspension spring.

    Attributes:
        bits: Resolution of the two's-complement DAC.
        full_input_a: Current that the amplifier is asked for at the largest DAC input, 100 %.
        limit_a: Current at which the amplifier saturates.
        newton_per_a: Motor constant of the coil.
        newton_per_m: Coil force per commanded strut displacement: the suspension's stiffness.

    Raises:
        ValueError: Fewer than 2 or more than 53 bits, or another number that is not positive.
    """

    bits: int
    full_input_a: float
    limit_a: float
    newton_per_a: float
    newton_per_m: float

    def __post_init__(self) -> None:
        """Check the arguments."""
        if not 2 <= check.index("bits", self.bits) <= 53:
            raise ValueError(f"bits must lie in 2..53, got {check.shown(self.bits)}")
        for name in ("full_input_a", "limit_a", "newton_per_a", "newton_per_m"):
            check.positive(name, getattr(self, name))

    def input_percent(self, displacement_m: Array) -> Array:
        """Normalized input 100 * DAC input / largest DAC input; quantized, clipped at +-100 %."""
        half = 2 ** (self.bits - 1)
        full_input_m = self.full_input_a * self.newton_per_a / self.newton_per_m
        displacement_m = check.finite("displacement_m", displacement_m)
        code = np.rint(displacement_m * (half / full_input_m))
        return code.clip(-half, half - 1) * (100.0 / half)

    def current_a(self, input_percent: Array) -> Array:
        """Coil current; the amplifier saturates."""
        asked_a = check.finite("input_percent", input_percent) * (self.full_input_a / 100.0)
        return asked_a.clip(-self.limit_a, self.limit_a)

    def displacement_m(self, input_percent: Array) -> Array:
        """Strut displacement at which the suspension balances the coil."""
        return self.current_a(input_percent) * (self.newton_per_a / self.newton_per_m)
