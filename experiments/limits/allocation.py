"""The strategies that the study compares, and the displacements within limits that each finds."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from experiments.rig.compromise import Compromise
from experiments.rig.hexapod.columns import MAJOR, SECONDARY
from experiments.rig.hexapod.controller import StrutMapping
from ftc.control.limits import LimitedMapping
from ftc.control.local_mapping import Mapping
from ftc.goal import Goal
from prioritized import Kinematics
from sim import Array, Hexapod

Limits = tuple[Array, Array]

Allocation = Literal["strict", "scaled", "clipping", "weighted", "unlimited"]
"""How rates or displacements are found: the major task first, with least error or its direction
kept; without limits, and then cut off; in one problem with weights; or where nothing is limited."""


@dataclass(frozen=True)
class Strategy:
    """One way to obey the limits.

    Attributes:
        allocation: How.
        major_weight: Of the major task in the one problem with weights.
        anti_windup: Whether the compensators observe what is achieved.
    """

    allocation: Allocation
    major_weight: float | None = None
    anti_windup: bool = True

    @property
    def name(self) -> str:
        """As in `limits.json`."""
        weight = "" if self.major_weight is None else f"_{self.major_weight:g}"
        return f"{self.allocation}{weight}{'' if self.anti_windup else '_winding_up'}"


UNLIMITED = Strategy("unlimited")
"""Of a machine with longer strokes and cooler coils: what the loop errs without limits."""


def loop_strategies(quick: bool) -> tuple[Strategy, ...]:
    """In the loop of the hexapod."""
    strict, clipping = Strategy("strict"), Strategy("clipping")
    if quick:
        winding_up = Strategy("strict", anti_windup=False)
        return strict, winding_up, clipping, UNLIMITED
    both = (
        Strategy(how, anti_windup=held)
        for how in ("strict", "scaled", "clipping")
        for held in (True, False)
    )
    return (*both, *weighted(), UNLIMITED)


def arm_strategies(quick: bool) -> tuple[Strategy, ...]:
    """On the arm, whose controller has no integrator."""
    strict, clipping = Strategy("strict"), Strategy("clipping")
    if quick:
        return strict, clipping, UNLIMITED
    return strict, Strategy("scaled"), clipping, *weighted(), UNLIMITED


def weighted() -> tuple[Strategy, ...]:
    """One problem, over seven decades of the weight."""
    return tuple(Strategy("weighted", weight) for weight in (0.1, 1.0, 10.0, 1e3, 1e6))


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
        weights = np.repeat([0.0, strategy.major_weight], [len(secondary), len(major)])
        rows = [*secondary, *major]
        equals = kinematics.velocity_mapping([], rows, W1, weights, rate_limits=limits)
        return Compromise(equals, len(secondary))
    if strategy.allocation == "clipping":
        own = limits[0][survivors], limits[1][survivors]
        return Clipped(kinematics.velocity_mapping(major, secondary, W1), own)
    when = "scaled" if strategy.allocation == "scaled" else "least_squares"
    return kinematics.velocity_mapping(major, secondary, W1, rate_limits=limits, when_limited=when)


class AllocatedMapping(StrutMapping):
    """The strut mapping with equal weights; a strategy finds displacements within the limits."""

    def __init__(
        self, geometry: Hexapod, locked_at: dict[int, float], limits: Limits, strategy: Strategy
    ) -> None:
        """The Jacobian is constant; `locked_at` as in :class:`ftc.goal.Goal`."""
        self._strategy = strategy
        goal = Goal(joint_weight=(1.0,) * 6, locked_at=locked_at)
        super().__init__(geometry, goal, "constant", limits=limits)

    def limited_at(self, kinematics: Kinematics) -> LimitedMapping:
        """By the strategy."""
        assert self.limits is not None
        return allocated(kinematics, self._strategy, self.limits, MAJOR, SECONDARY)
