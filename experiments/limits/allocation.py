"""Displacements within limits without strict priority: cut off, or one problem with weights."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from experiments.limits.strategies import Strategy
from experiments.rig.hexapod.columns import MAJOR, SECONDARY
from experiments.rig.hexapod.controller import StrutMapping
from ftc.control.limits import LimitedMapping
from ftc.control.local_mapping import Mapping
from ftc.goal import Goal
from prioritized import Kinematics
from sim import Array, Hexapod

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

    mapping: Mapping
    limits: Limits

    def solve(
        self,
        v_major: ArrayLike,
        joint_velocity: ArrayLike | None = None,
        secondary_velocity: ArrayLike | None = None,
    ) -> Allocated:
        """As :meth:`ftc.control.limits.LimitedMapping.solve`."""
        rates = self.mapping(v_major, joint_velocity, secondary_velocity)
        return Allocated(rates.clip(*self.limits))


@dataclass(frozen=True)
class Compromise:
    """One bounded least-squares problem: no task comes before another.

    Attributes:
        equals: The mapping with nothing major; its secondary task is [v_m; v_s].
        secondary_count: Rows of v_s.
    """

    equals: LimitedMapping
    secondary_count: int

    def solve(
        self,
        v_major: ArrayLike,
        joint_velocity: ArrayLike | None = None,
        secondary_velocity: ArrayLike | None = None,
    ) -> Allocated:
        """As :meth:`ftc.control.limits.LimitedMapping.solve`."""
        v_s = np.zeros(self.secondary_count) if secondary_velocity is None else secondary_velocity
        solved = self.equals.solve([], joint_velocity, np.concatenate([v_major, v_s]))
        return Allocated(solved.rates)


def allocated(
    kinematics: Kinematics,
    strategy: Strategy,
    limits: Limits,
    major: list[int],
    secondary: list[int],
) -> LimitedMapping:
    """Least rates for the major task within limits of all n actuators, by a strategy."""
    survivors, W1 = kinematics.actuators, np.ones(len(kinematics.actuators))
    if strategy.allocation == "weighted":
        assert strategy.major_weight is not None
        weights = np.repeat([strategy.major_weight, 0.0], [len(major), len(secondary)])
        equals = kinematics.velocity_mapping(
            [], [*major, *secondary], W1, weights, rate_limits=limits
        )
        return Compromise(equals, len(secondary))
    if strategy.allocation == "clipping":
        own = limits[0][survivors], limits[1][survivors]
        return Clipped(kinematics.velocity_mapping(major, secondary, W1), own)
    when = "scaled" if strategy.allocation == "scaled" else "least_squares"
    return kinematics.velocity_mapping(major, secondary, W1, rate_limits=limits, when_limited=when)


class AllocatedMapping(StrutMapping):
    """The strut mapping with equal weights; a strategy finds displacements within the limits."""

    def __init__(
        self, geometry: Hexapod, locked_m: dict[int, float], limits_m: Limits, strategy: Strategy
    ) -> None:
        """The Jacobian is constant; `locked_m` as in :class:`ftc.goal.Goal`."""
        self._strategy = strategy
        goal = Goal(joint_weight=(1.0,) * 6, locked_m=locked_m)
        super().__init__(geometry, goal, "constant", limits_m=limits_m)

    def limited_at(self, kinematics: Kinematics) -> LimitedMapping:
        """By the strategy."""
        assert self.limits_m is not None
        return allocated(kinematics, self._strategy, self.limits_m, MAJOR, SECONDARY)
