"""A controller to which the failure is known beforehand."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

import argument_checks as check
from argument_checks import Array
from ftc.controller import ControllerState, Measurement, PrioritizedController


@dataclass(frozen=True)
class NestedState:
    """State of a controller inside another controller's state."""

    controller: ControllerState[Any]

    @property
    def inputs(self) -> Array:
        """Inputs to send to the drives, shape (n,)."""
        return self.controller.inputs

    @property
    def pose(self) -> Any:
        """Estimated pose."""
        return self.controller.pose


@dataclass(frozen=True)
class OracleState(NestedState):
    """The inner state, and the number of ticks so far."""

    ticks: int


NEVER = -1
"""A tick that is never reached."""


@dataclass(frozen=True)
class OracleController:
    """Controller that switches from one controller to another at a given tick.

    Attributes:
        before: Controls first.
        after: Takes over.
        tick: When, counted from the first.
        lost_displacements: What each actuator loses then of its displacement, (n,); None: the
            displacement commanded of those that the goal of `after` says are free.
        secondary: Reference of the secondary goal (n,) at each time of the run; None is zero.
        acting: As of :meth:`ftc.PrioritizedController.transfer`.

    Raises:
        ValueError, TypeError: Not controllers of as many actuators, no tick, no function, or not so
            many finite numbers.
    """

    before: PrioritizedController[Any]
    after: PrioritizedController[Any]
    tick: int
    lost_displacements: Array | None = None
    secondary: Callable[[float], Array] | None = None
    acting: Array | None = None

    def __post_init__(self) -> None:
        before, after = (
            check.instance(name, getattr(self, name), PrioritizedController).mapping.actuators
            for name in ("before", "after")
        )
        if before != after:
            raise ValueError(f"after must have the {before} actuators of before, got {after}")
        if not isinstance(self.tick, int) or self.tick != NEVER:
            check.index("tick", self.tick)
        if self.secondary is not None:
            check.function("secondary", self.secondary)
        for name in ("lost_displacements", "acting"):
            if (given := getattr(self, name)) is not None:
                vars(self)[name] = check.frozen(check.exactly(name, given, before))

    def start(self) -> OracleState:
        """At rest at the nominal pose."""
        return OracleState(self.before.start(), ticks=0)

    def step(
        self,
        state: OracleState,
        reference: Array,
        measurement: Measurement,
        *,
        feedforward: Array | None = None,
    ) -> OracleState:
        """One control tick.

        Raises:
            ValueError, TypeError: As a step of :class:`.PrioritizedController`.
        """
        last = check.instance("state", state, OracleState).controller
        if state.ticks == self.tick:
            lost_displacements = (
                self._lost_displacement(last)
                if self.lost_displacements is None
                else self.lost_displacements
            )
            last = self.after.transfer(last, lost_displacements, self.acting)
        taken_over = self.tick != NEVER and state.ticks >= self.tick
        acting = self.after if taken_over else self.before
        if self.secondary is None:
            secondary_reference = np.zeros(acting.mapping.actuators)
        else:
            secondary_reference = self.secondary(state.ticks * acting.period_s)
        controller = acting.step(
            last, reference, measurement, secondary_reference, feedforward=feedforward
        )
        return OracleState(controller, state.ticks + 1)

    def _lost_displacement(self, last: ControllerState[Any]) -> Array:
        # An actuator that keeps its damper falls too slowly to be made up for at once.
        free = list(self.after.mapping.goal.free)
        lost_displacements = np.zeros(self.after.mapping.actuators)
        lost_displacements[free] = self.before.drives.displacements(last.inputs)[free]
        return lost_displacements
