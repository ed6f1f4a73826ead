"""Temperatures of coils that are heated by their currents."""

from dataclasses import dataclass

import numpy as np
from scipy.special import exprel

import argument_checks as check
from argument_checks import Array

COPPER_PER_K = 3.93e-3
"""Relative increase of copper's resistance per kelvin, from 20 degrees Celsius, [1]/[K]."""
_REFERENCE_C = 20.0


@dataclass(frozen=True)
class Coils:
    """Thermal model of n windings, each one thermal mass with a thermal resistance to the ambient.

        C dT/dt = R(T) I^2 - (T - T_ambient) / R_th,   R(T) = R_20 (1 + kappa (T - 20))

    The resistance rises with temperature: above I^2 = 1 / (kappa R_20 R_th) it never settles.

    Attributes:
        resistance_ohm: R_20, resistance of each winding at 20 degrees Celsius [Ohm].
        heat_capacity_j_per_k: C, heat capacity of each winding [J]/[K].
        thermal_resistance_k_per_w: R_th, from each winding to the ambient, shape (n,), [K]/[W].
        ambient_c: T_ambient, [degrees Celsius].
    """

    resistance_ohm: float
    heat_capacity_j_per_k: float
    thermal_resistance_k_per_w: Array
    ambient_c: float

    def __post_init__(self) -> None:
        check.number("resistance_ohm", self.resistance_ohm, check.SMALLEST)
        check.number("heat_capacity_j_per_k", self.heat_capacity_j_per_k, check.SMALLEST)
        check.number("ambient_c", self.ambient_c)
        paths = check.array("thermal_resistance_k_per_w", self.thermal_resistance_k_per_w, None)
        if not (paths > check.SMALLEST).all():
            raise ValueError(
                "thermal_resistance_k_per_w must be a list of positive numbers, "
                f"got {check.short_repr(paths.tolist())}"
            )
        object.__setattr__(self, "thermal_resistance_k_per_w", check.frozen(paths))

    def cold(self) -> Array:
        """Return the temperatures of coils without current, shape (n,), [degrees Celsius]."""
        return np.full(len(self.thermal_resistance_k_per_w), self.ambient_c)

    def net_power_w(self, temperature_c: Array, current_a: Array) -> Array:
        """Return the net heating power of each winding [W], shape (n,)."""
        temperature_c, current_a = self._checked(temperature_c, current_a)
        resistance = self.resistance_ohm * (1 + COPPER_PER_K * (temperature_c - _REFERENCE_C))
        lost = (temperature_c - self.ambient_c) / self.thermal_resistance_k_per_w
        return resistance * current_a**2 - lost

    def step(self, temperature_c: Array, current_a: Array, period_s: float) -> Array:
        """Return the exact temperatures (n,) after a period of constant currents (n,).

        Raises:
            ValueError: An argument has a wrong shape or non-finite numbers, or the temperatures
                overflow.
        """
        temperature_c, current_a = self._checked(temperature_c, current_a)
        check.number("period_s", period_s, 0.0)
        rising = self.resistance_ohm * COPPER_PER_K * current_a**2
        decay = (1 / self.thermal_resistance_k_per_w - rising) / self.heat_capacity_j_per_k
        rate = self.net_power_w(temperature_c, current_a) / self.heat_capacity_j_per_k
        with np.errstate(over="ignore", invalid="ignore"):  # checked below
            warmer_c = temperature_c + rate * period_s * exprel(-decay * period_s)
        if not check.is_moderate(warmer_c):
            raise ValueError(
                "current_a must leave temperatures finite at this resistance_ohm, got a thermal "
                "runaway"
            )
        return warmer_c

    def temperatures_c(self, current_a: Array, period_s: float) -> Array:
        """Return temperatures (N, n) of initially cold coils before each of the currents (N, n)."""
        current_a = check.array("current_a", current_a, ..., *self.thermal_resistance_k_per_w.shape)
        if current_a.ndim != 2:
            raise ValueError(f"current_a must have shape (N, n), got {current_a.shape}")
        now, temperatures = self.cold(), []
        for step_current_a in current_a:
            temperatures.append(now)
            now = self.step(now, step_current_a, period_s)
        return np.array(temperatures).reshape(current_a.shape)

    def _checked(self, temperature_c: Array, current_a: Array) -> tuple[Array, Array]:
        shape = self.thermal_resistance_k_per_w.shape
        temperature_c = check.array("temperature_c", temperature_c, *shape)
        return temperature_c, check.array("current_a", current_a, *shape)
