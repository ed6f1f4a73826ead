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
        after: Takes over at `tick`, counted from the first.
        lost_displacements: What each actuator loses then of its displacement, (n,); None: the
            displacement commanded of those that the goal of `after` says are free.
        secondary: Reference of the secondary goal (n,) at each time of the run; None is zero.
        acting: As of :meth:`ftc.PrioritizedController.transfer`.
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
            check.integer("tick", self.tick)
        if self.secondary is not None:
            check.function("secondary", self.secondary)
        for name in ("lost_displacements", "acting"):
            if (given := getattr(self, name)) is not None:
                vars(self)[name] = check.frozen(check.array(name, given, before))

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
        """One control tick."""
        last = check.instance("state", state, OracleState).controller
        if state.ticks == self.tick:
            if (lost := self.lost_displacements) is None:
                # An actuator that keeps its damper falls too slowly to be made up for at once.
                held, lost = (
                    self.before.drives.displacements(last.inputs),
                    np.zeros(len(last.inputs)),
                )
                free = list(self.after.mapping.goal.free)
                lost[free] = held[free]
            last = self.after.transfer(last, lost, self.acting)
        acting = self.after if 0 <= self.tick <= state.ticks else self.before
        secondary = self.secondary and self.secondary(state.ticks * acting.period_s)
        controller = acting.step(last, reference, measurement, secondary, feedforward=feedforward)
        return OracleState(controller, state.ticks + 1)
