"""Whoever flies the machine: what a run asks of it, and one that is told of a failure."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, TypeVar

import numpy as np

from ftc.controller import Controller, ControllerState, Sensed
from sim import Amplifier, Array, Pose


class PilotState(Protocol):
    """What a run keeps of a pilot's state."""

    @property
    def input_percent(self) -> Array:
        """Strut inputs to send, shape (6,)."""
        ...

    @property
    def pose(self) -> Pose:
        """Estimated pose of the payload."""
        ...


NEVER = -1
"""A tick that does not come."""

State = TypeVar("State", bound=PilotState)


class Pilot(Protocol[State]):
    """Strut inputs from what can be measured; `step` is a pure function of the state."""

    @property
    def amplifier(self) -> Amplifier:
        """The converters that it drives."""
        ...

    def start(self) -> State:
        """At rest at the nominal pose."""
        ...

    def step(self, state: State, desired_rad: Array, sensed: Sensed) -> State:
        """One control tick."""
        ...


@dataclass(frozen=True)
class PointingState:
    """State of the pointing loops; pilots add what they need."""

    controller: ControllerState

    @property
    def input_percent(self) -> Array:
        """Strut inputs to send, shape (6,)."""
        return self.controller.input_percent

    @property
    def pose(self) -> Pose:
        """Estimated pose of the payload."""
        return self.controller.pose


@dataclass(frozen=True)
class InformedState(PointingState):
    """Beside it, how many ticks it has been."""

    ticks: int


@dataclass(frozen=True)
class Informed:
    """Goes over from one controller to another at a tick that it was told beforehand: an oracle.

    Attributes:
        before: Flies first.
        after: Takes over.
        tick: When, counted from the first.
        falling_m: What each strut loses then of its displacement, (6,); None: what goal and
            commands say of those without a coil.
        secondary: Desired strut displacements (6,) at each time of flight.
    """

    before: Controller
    after: Controller
    tick: int
    falling_m: Array | None = None
    secondary: Callable[[float], Array] = lambda time_s: np.zeros(6)

    @property
    def amplifier(self) -> Amplifier:
        """The same for both."""
        return self.before.amplifier

    def start(self) -> InformedState:
        """At rest at the nominal pose."""
        return InformedState(self.before.start(), ticks=0)

    def step(self, state: InformedState, desired_rad: Array, sensed: Sensed) -> InformedState:
        """One control tick."""
        last = state.controller
        if state.ticks == self.tick:
            falling_m = self._falling(last) if self.falling_m is None else self.falling_m
            last = self.after.take_over(last, falling_m)
        taken_over = self.tick != NEVER and state.ticks >= self.tick
        flies = self.after if taken_over else self.before
        rest_m = self.secondary(state.ticks * flies.period_s)
        return InformedState(flies.step(last, desired_rad, sensed, rest_m), state.ticks + 1)

    def _falling(self, last: ControllerState) -> Array:
        # A strut that keeps its damper falls too slowly to be made up for at once.
        limp = list(self.after.mapping.goal.free)
        falling_m = np.zeros(6)
        falling_m[limp] = self.amplifier.displacement_m(last.input_percent)[limp]
        return falling_m
