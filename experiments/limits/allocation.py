"""The strategies that the study compares, and the displacements within limits that each finds."""

from dataclasses import dataclass
from math import inf
from typing import Any, Literal

import numpy as np

from experiments.limits.conventional import Clipped, Limits, Redistributed
from experiments.rig.compromise import Compromise
from experiments.rig.hexapod.columns import MAJOR, SECONDARY
from experiments.rig.hexapod.controller import StrutMapping
from ftc.goal import Goal
from prioritized import Kinematics
from sim import Hexapod

Allocation = Literal["strict", "scaled", "clipping", "redistributed", "weighted", "unlimited"]
"""How rates or displacements are found: the major task first, with least error or its direction
kept; without limits, and then cut off, or what is cut off given to the others; in one problem with
weights; or where nothing is limited."""

SLOWNESS = (1.0, 2.0, 5.0, 10.0, 20.0, 50.0, inf)
"""Tracking times that are tried for clipping, in multiples of the integrators' 1/gain; inf is no
anti-windup."""
WEIGHTS = (0.1, 0.3, 1.0, 2.0, 3.0, 5.0, 10.0, 1e3)
"""Of the major task, tried for the one problem with weights; [rad] against [m] or [rad]."""


@dataclass(frozen=True)
class Strategy:
    """One way to obey the limits.

    Attributes:
        allocation: How.
        major_weight: Of the major task in the one problem with weights.
        slowness: Of the compensators that observe what is achieved, as in
            :func:`ftc.control.anti_windup.tracking_gain`; inf is no anti-windup.
    """

    allocation: Allocation
    major_weight: float | None = None
    slowness: float = 1.0

    @property
    def anti_windup(self) -> bool:
        """Whether the compensators observe what is achieved."""
        return self.slowness < inf

    @property
    def name(self) -> str:
        """As in `limits.json`."""
        weight = "" if self.major_weight is None else f"_{self.major_weight:g}"
        slow = "" if self.slowness == 1.0 else f"_tracking_{self.slowness:g}"
        return f"{self.allocation}{weight}{slow if self.anti_windup else '_winding_up'}"


UNLIMITED = Strategy("unlimited")
"""Of a machine with longer strokes and cooler coils: what the loop errs without limits."""
STRICT, WINDING_UP = Strategy("strict"), Strategy("strict", slowness=inf)


def loop_strategies(quick: bool) -> tuple[Strategy, ...]:
    """In the loop of the hexapod; two of them for each number that has to be chosen."""
    redistributed = Strategy("redistributed")
    clipping = (Strategy("clipping", slowness=each) for each in SLOWNESS)
    if quick:
        clipping = (Strategy("clipping", slowness=each) for each in (1.0, 10.0))
        return STRICT, WINDING_UP, *clipping, redistributed, Strategy("weighted", 10.0), UNLIMITED
    return STRICT, WINDING_UP, Strategy("scaled"), *clipping, redistributed, *weighted(), UNLIMITED


def arm_strategies(quick: bool) -> tuple[Strategy, ...]:
    """On the arm, whose controller has no integrator."""
    clipping, redistributed = Strategy("clipping"), Strategy("redistributed")
    if quick:
        return STRICT, clipping, redistributed, UNLIMITED
    return STRICT, Strategy("scaled"), clipping, redistributed, *weighted(), UNLIMITED


def weighted() -> tuple[Strategy, ...]:
    """One problem with each weight."""
    return tuple(Strategy("weighted", weight) for weight in WEIGHTS)


def allocated(
    kinematics: Kinematics,
    strategy: Strategy,
    limits: Limits,
    major: list[int],
    secondary: list[int],
) -> Any:
    """Least rates for the major task within limits of all n actuators, by a strategy."""
    survivors, W1 = kinematics.actuators, np.ones(len(kinematics.actuators))
    own = limits[0][survivors], limits[1][survivors]
    if strategy.allocation == "weighted":
        assert strategy.major_weight is not None
        weights = np.repeat([0.0, strategy.major_weight], [len(secondary), len(major)])
        rows = [*secondary, *major]
        equals = kinematics.velocity_mapping([], rows, W1, weights, rate_limits=limits)
        return Compromise(equals, len(secondary))
    if strategy.allocation == "clipping":
        return Clipped(kinematics.velocity_mapping(major, secondary, W1), own)
    if strategy.allocation == "redistributed":
        return Redistributed(kinematics.J[major], own)
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

    def limited_at(self, kinematics: Kinematics) -> Any:
        """By the strategy."""
        assert self.limits is not None
        return allocated(kinematics, self._strategy, self.limits, MAJOR, SECONDARY)
