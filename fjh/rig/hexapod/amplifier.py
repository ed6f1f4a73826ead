"""Digital-to-analog converter, current amplifier and voice coil: from command to displacement."""

from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np
from numpy.typing import ArrayLike

import argument_checks as check
from argument_checks import Array
from kernels import Struct, lib, pointer
from sim import Plant


@dataclass(frozen=True)
class Amplifier:
    """Drive of one strut: DAC input [%], coil current, coil force, displacement of the suspension.

    Attributes:
        bits: Resolution of the two's-complement DAC.
        full_input_a: Current that the amplifier commands at the largest DAC input, 100 %.
        limit_a: Current at which the amplifier saturates.
        newton_per_a: Motor constant of the coil.
        newton_per_m: Coil force per commanded strut displacement: the suspension's stiffness.

    Raises:
        ValueError: `bits` is not from 2 to 53, or another number is not positive.
    """

    bits: int
    full_input_a: float
    limit_a: float
    newton_per_a: float
    newton_per_m: float

    def __post_init__(self) -> None:
        if not 2 <= check.integer("bits", self.bits) <= 53:
            raise ValueError(f"bits must be from 2 to 53, got {check.short_repr(self.bits)}")
        for name in ("full_input_a", "limit_a", "newton_per_a", "newton_per_m"):
            check.number(name, getattr(self, name), check.SMALLEST)

    def inputs(self, displacement_m: Array) -> Array:
        """Return the DAC input [%] of displacements [m], quantized and clipped at +-100 %."""
        return _converted("displacement_m", displacement_m, self._to_input)

    def current_a(self, input_percent: Array) -> Array:
        """Return the coil current [A], saturated by the amplifier."""
        return _converted("input_percent", input_percent, self._current(1.0))

    def displacements(self, input_percent: Array) -> Array:
        """Return the strut displacement [m] at which the suspension balances the coil."""
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
    """Return the kernel's conversion: factor, rounding if `whole`, clipping, gain."""
    limits = {"lower": lower, "upper": upper}
    return Struct("conversion", factor=factor, gain=gain, whole=whole, **limits)


def _converted(name: str, value: Array, conversion: Struct) -> Array:
    x = check.array(name, value)
    y = np.empty(x.shape)
    lib.convert(conversion.pointer, x.size, pointer(np.ascontiguousarray(x)), pointer(y))
    return y


def displacement_limits(
    model: mujoco.MjModel, amplifier: Amplifier, current_limit_a: ArrayLike | None = None
) -> tuple[Array, Array]:
    """Return the displacements at which actuators can rest, by their ranges and currents.

    At rest a coil balances its suspension, so that a displacement l requires the current
    newton_per_m l / newton_per_a. Other forces (flexures, the shifted weight) are neglected: 0.1 %
    of the current in the hexapod. The limits do not apply to a locked actuator, which rests without
    current.

    Args:
        model: Model as for :class:`Plant`. Ranges are those of the joint or tendon, of the control
            and of the force that holds its spring; infinite if not stated.
        amplifier: Drive of each actuator. Its saturation and the converter's largest code limit the
            current.
        current_limit_a: Further limit [A] for all or each of the actuators, shape () or (n,), such
            as that of a hot coil; None: only the amplifier's.

    Returns:
        Lower and upper displacement from the nominal position, shape (n,) each, [m].

    Raises:
        ModelError: An actuator is not supported by :class:`Plant`.
    """
    check.instance("amplifier", amplifier, Amplifier)
    lower, upper = Plant(check.instance("model", model, mujoco.MjModel)).limits()
    full_m = amplifier.full_input_a * amplifier.newton_per_a / amplifier.newton_per_m
    # The converter's largest code is one below full input.
    least_m, most_m = amplifier.displacements(amplifier.inputs(full_m * np.array([-2, 2])))
    if current_limit_a is not None:
        currents = check.array("current_limit_a", current_limit_a, least=0.0)
        if currents.shape not in ((), lower.shape):
            raise ValueError(
                f"current_limit_a must be one number or {len(lower)} numbers, "
                f"got shape {currents.shape}"
            )
        limit_m = currents * amplifier.newton_per_a / amplifier.newton_per_m
        least_m, most_m = np.maximum(least_m, -limit_m), np.minimum(most_m, limit_m)
    return np.maximum(lower, least_m), np.minimum(upper, most_m)
