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
    """State of a controller inside another controller's state, and the number of ticks so far."""

    controller: ControllerState[Any]
    ticks: int

    @property
    def inputs(self) -> Array:
        """Inputs to send to the drives, shape (n,)."""
        return self.controller.inputs

    @property
    def pose(self) -> Any:
        """Estimated pose."""
        return self.controller.pose


@dataclass(frozen=True)
class OracleController:
    """Controller that switches from one controller to another at a given tick.

    Attributes:
        before: Controls first.
        after: Takes over at `tick`, counted from the first; None is never.
        lost_displacements: What each actuator loses then of its displacement, (n,); None: the
            displacement commanded of those that the goal of `after` says are free.
        secondary: Reference of the secondary goal (n,) at each time of the run; None is zero.
        acting: As of :meth:`ftc.PrioritizedController.transfer`.
    """

    before: PrioritizedController[Any]
    after: PrioritizedController[Any]
    tick: int | None
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
        if self.tick is not None:
            check.integer("tick", self.tick)
        if self.secondary is not None:
            check.function("secondary", self.secondary)
        for name in ("lost_displacements", "acting"):
            if (given := getattr(self, name)) is not None:
                vars(self)[name] = check.frozen(check.array(name, given, before))

    def start(self) -> NestedState:
        """At rest at the nominal pose."""
        return NestedState(self.before.start(), 0)

    def step(
        self,
        state: NestedState,
        reference: Array,
        measurement: Measurement,
        *,
        feedforward: Array | None = None,
    ) -> NestedState:
        """One control tick."""
        last = check.instance("state", state, NestedState).controller
        if state.ticks == self.tick:
            if (lost := self.lost_displacements) is None:
                # An actuator that keeps its damper falls too slowly to be made up for at once.
                held = self.before.drives.displacements(last.inputs)
                lost = np.where(np.isin(range(len(held)), self.after.mapping.goal.free), held, 0.0)
            last = self.after.transfer(last, lost, self.acting)
        is_over = self.tick is not None and state.ticks >= self.tick
        acting = self.after if is_over else self.before
        secondary = self.secondary and self.secondary(state.ticks * acting.period_s)
        controller = acting.step(last, reference, measurement, secondary, feedforward=feedforward)
        return NestedState(controller, state.ticks + 1)
