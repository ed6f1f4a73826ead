"""Four ways to keep displacements within their limits: what the mappings of the study do."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from experiments.hexapod.columns import MAJOR, SECONDARY
from experiments.hexapod.controller import StrutMapping
from ftc.goal import Goal
from ftc.local_mapping import LimitedMapping, Mapping
from prioritized import Kinematics
from sim import Array, Hexapod


@dataclass(frozen=True)
class Allocated:
    """Rates within the limits (n',), and the major velocity that they do not reach (m1,)."""

    rates: Array
    residual: Array


@dataclass(frozen=True)
class Clipped:
    """The mapping without limits, each of its rates then cut off at its own limits."""

    mapping: Mapping
    J_m: Array
    lower: Array
    upper: Array

    def solve(
        self,
        v_major: ArrayLike,
        joint_velocity: ArrayLike | None = None,
        secondary_velocity: ArrayLike | None = None,
    ) -> Allocated:
        """Cut off, and what that costs."""
        rates = self.mapping(v_major, joint_velocity, secondary_velocity)
        rates = rates.clip(self.lower, self.upper)
        return Allocated(rates, v_major - self.J_m @ rates)


@dataclass(frozen=True)
class Compromise:
    """One bounded least-squares problem of all tasks; its first secondary rows are the major."""

    equals: LimitedMapping
    J_m: Array

    def solve(
        self,
        v_major: ArrayLike,
        joint_velocity: ArrayLike | None = None,
        secondary_velocity: ArrayLike | None = None,
    ) -> Allocated:
        """The optimum of the weighted sum."""
        v_s = np.concatenate(
            [v_major, np.zeros(4) if secondary_velocity is None else secondary_velocity]
        )
        rates = self.equals.solve([], joint_velocity, v_s).rates
        return Allocated(rates, v_major - self.J_m @ rates)


class ClippedMapping(StrutMapping):
    def limited_at(self, kinematics: Kinematics) -> LimitedMapping:
        """Clip."""
        survivors = kinematics.actuators
        lower, upper = (each[survivors] for each in self.limits_m)
        return Clipped(self.rates_at(kinematics), kinematics.J[MAJOR], lower, upper)


class CompromiseMapping(StrutMapping):
    def __init__(self, geometry: Hexapod, goal: Goal, major_weight: float, limits_m) -> None:
        self._weight = major_weight
        super().__init__(geometry, goal, "constant", limits_m=limits_m)

    def limited_at(self, kinematics: Kinematics) -> LimitedMapping:
        """One problem."""
        goal = self.goal
        W2 = np.zeros(4) if goal.secondary_weight is None else np.array(goal.secondary_weight)
        equals = kinematics.velocity_mapping(
            [],
            [*MAJOR, *SECONDARY],
            goal.joint_weight,
            np.concatenate([np.full(2, self._weight), W2]),
            rate_limits=self.limits_m,
        )
        return Compromise(equals, kinematics.J[MAJOR])
