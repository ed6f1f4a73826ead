"""Norms of angles and lengths together, by means of a stated length or the mechanism's own."""

from typing import NamedTuple

import numpy as np

from argument_checks import Array
from argument_checks.ties import ACCURACY


def units_of(S: Array, units: Array) -> Array:
    """Return natural units (k,) of directions S (k, m): norm of their rows' units per unit norm."""
    sizes = np.sqrt((S**2).sum(axis=1))
    with_units = np.sqrt(((S * units) ** 2).sum(axis=1))
    return with_units / np.where(sizes > 0.0, sizes, 1.0) + (sizes == 0.0)


def metric_of(units: Array) -> Array | None:
    """Return weights for adding numbers of these natural units; None if all have one kind."""
    return None if is_uniform(units) else 1.0 / units


class Measure(NamedTuple):
    """Natural units of the major velocities (m1,) and of the rates (n,) of a mapping."""

    major: Array
    rates: Array

    @property
    def metric(self) -> Array | None:
        """Metric (m1, m1) for adding major velocities of two kinds; None for one kind."""
        weights = metric_of(self.major)
        return None if weights is None else np.diag(weights)

    @property
    def is_needed(self) -> bool:
        """Return whether major velocities or rates are of two kinds, angular and linear."""
        return not (is_uniform(self.major) and is_uniform(self.rates))

    def length(self, of_error: bool, of_ties: bool) -> float | None:
        """Return the length that relates the two kinds; None if there is only one kind.

        Args:
            of_error: Whether major velocities are combined in one norm.
            of_ties: Whether rates are combined in one norm.
        """
        for units, used in ((self.major, of_error), (self.rates, of_ties)):
            if used and not is_uniform(units):  # one unit is 1, that of an angle
                return float(units.max() if units.max() > 1.0 else units.min())
        return None

    @property
    def gain_unit(self) -> float:
        """Unit of gains, major velocity over rate; 1 where there are two kinds."""
        if self.is_needed or not (self.major.size and self.rates.size):
            return 1.0
        return float(self.major[0] / self.rates[0])

    @property
    def inverse(self) -> "Measure":
        """Natural units of major forces and torques, dual to those of velocities and rates."""
        return Measure(1.0 / self.major, 1.0 / self.rates)

    def of_gain(self, gain: Array) -> Array:
        """Convert rates per major velocity (..., n, m1), or torques per force, to natural units."""
        return gain * self.major / self.rates[:, None] if self.is_needed else gain


def is_uniform(units: Array) -> bool:
    """Return whether all units are of one kind."""
    return not units.size or bool(units.max() <= (1.0 + ACCURACY) * units.min())
