"""A pilot that looks at nothing, so that what follows its inputs is the machine's own."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from fjh.rig import Rig, Run


@dataclass(frozen=True)
class Sent:
    """State of a pilot: what it sends, and the tick."""

    inputs: np.ndarray
    tick: int = 0


@dataclass(frozen=True)
class Blind:
    """Sends a sinusoid to each actuator, constant at 0 Hz, and reads nothing."""

    actuators: int
    peak: float
    hz: float

    def start(self) -> Sent:
        """With no input."""
        return Sent(np.zeros(self.actuators))

    def step(self, state: Sent, *_: Any) -> Sent:
        """Whatever was measured."""
        phase = 2 * np.pi * self.hz * 1e-3 * state.tick + np.arange(self.actuators)
        return Sent(self.peak * np.cos(phase), state.tick + 1)


def blind_flight(
    one: Rig,
    events: object = None,
    *,
    ticks: int = 160,
    hz: float = 10.0,
    peak: float | None = None,
    **how: Any,
) -> Run:
    """A flight at a thirtieth of the full input."""
    if peak is None:
        peak = 3.0 if one.title.startswith("University") else 0.7 * one.size
    pilot = Blind(len(one.actuators), peak, hz)
    return one.fly(pilot, np.zeros((ticks, len(one.major))), events=events, **how)
