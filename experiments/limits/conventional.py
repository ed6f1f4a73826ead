"""Conventional ways to keep rates within limits: clipping, and the redistributed pseudo-inverse."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from argument_checks.ties import exceeds
from prioritized import VelocityMapping, velocity_mapping
from sim import Array

Limits = tuple[Array, Array]


@dataclass(frozen=True)
class Allocated:
    """Rates within the limits, shape (n',)."""

    rates: Array


@dataclass(frozen=True)
class Clipped:
    """The mapping without limits; each rate is cut off at its own limit, whatever it is for.

    Attributes:
        mapping: Without limits.
        limits: Of the rates, shape (n',) each.
    """

    mapping: VelocityMapping
    limits: Limits

    def solve(
        self,
        v_major: ArrayLike,
        joint_velocity: ArrayLike | None = None,
        secondary_velocity: ArrayLike | None = None,
    ) -> Allocated:
        """As :meth:`prioritized.VelocityMapping.solve`."""
        rates = self.mapping(v_major, joint_velocity, secondary_velocity)
        return Allocated(rates.clip(*self.limits))


@dataclass(frozen=True)
class Redistributed:
    """Redistributed pseudo-inverse: what saturated actuators lack, the others make up for.

    Least |rates - desired rates| for the major task; rates beyond their limits are fixed there, and
    the others solved again, until none is beyond (Virnig and Bodden 1994; Bodson, Evaluation of
    Optimization Methods for Control Allocation, 2002). A rate once fixed is never released, so that
    the result need not be the best within the limits.

    Attributes:
        J_m: Jacobian of the major task, shape (m1, n').
        limits: Of the rates, shape (n',) each.
    """

    J_m: Array
    limits: Limits

    def solve(
        self,
        v_major: ArrayLike,
        joint_velocity: ArrayLike | None = None,
        secondary_velocity: ArrayLike | None = None,
    ) -> Allocated:
        """As :meth:`prioritized.VelocityMapping.solve`; no secondary task is weighted."""
        (m1, n), (lower, upper) = self.J_m.shape, self.limits
        desired = np.zeros(n) if joint_velocity is None else np.asarray(joint_velocity)
        rates, moving = np.zeros(n), np.ones(n, dtype=bool)
        while moving.any():
            J_m = self.J_m[:, moving]
            remaining = np.asarray(v_major) - self.J_m[:, ~moving] @ rates[~moving]
            mapping = velocity_mapping(J_m, range(m1), joint_weight=np.ones(J_m.shape[1]))
            rates[moving] = mapping(remaining, desired[moving])
            beyond = exceeds(rates, upper) | exceeds(lower, rates)
            rates = rates.clip(lower, upper)
            if not beyond.any():
                break
            moving &= ~beyond
        return Allocated(rates)
