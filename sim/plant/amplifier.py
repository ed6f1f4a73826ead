"""Digital-to-analog converter, current amplifier and voice coil: from command to displacement."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

import argument_checks as check
from kernels import Struct, lib, pointer
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

    def inputs(self, displacement_m: Array) -> Array:
        """Normalized input 100 * DAC input / largest DAC input; quantized, clipped at +-100 %."""
        return _converted("displacement_m", displacement_m, self._to_input)

    def current_a(self, input_percent: Array) -> Array:
        """Coil current; the amplifier saturates."""
        return _converted("input_percent", input_percent, self._current(1.0))

    def displacements(self, input_percent: Array) -> Array:
        """Strut displacement at which the suspension balances the coil."""
        return _converted("input_percent", input_percent, self._to_displacement)

    @cached_property
    def _to_input(self) -> Struct:
        half = 2.0 ** (self.bits - 1)
        per_m = half / (self.full_input_a * self.newton_per_a / self.newton_per_m)
        return _conversion(per_m, -half, half - 1.0, 100.0 / half, whole=True)

    @cached_property
    def _to_displacement(self) -> Struct:
        return self._current(self.newton_per_a / self.newton_per_m)

    def _current(self, per_a: float) -> Struct:
        limit_a = self.limit_a
        return _conversion(self.full_input_a / 100.0, -limit_a, limit_a, per_a, whole=False)


def _conversion(factor: float, lower: float, upper: float, gain: float, *, whole: bool) -> Struct:
    """Numbers times a factor, rounded if `whole`, within limits; times a gain."""
    limits = {"lower": lower, "upper": upper}
    return Struct("conversion", factor=factor, gain=gain, whole=whole, **limits)


def _converted(name: str, value: Array, conversion: Struct) -> Array:
    x = check.finite(name, value)
    y = np.empty(x.shape)
    lib.convert(conversion.pointer, x.size, pointer(np.ascontiguousarray(x)), pointer(y))
    return y
