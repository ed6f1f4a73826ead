"""A pilot that looks at nothing, so that what follows its inputs is the machine's own."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fjh.rig import Rig, Run


@dataclass(frozen=True)
class Blind:
    """Sends a sinusoid to each actuator, constant at 0 Hz, and reads nothing: its own state."""

    inputs: np.ndarray
    peak: float
    hz: float
    tick: int = 0

    def start(self) -> "Blind":
        """With no input."""
        return self

    def step(self, state: "Blind", *_: Any) -> "Blind":
        """Whatever was measured."""
        phase = 2 * np.pi * self.hz * 1e-3 * state.tick + np.arange(len(self.inputs))
        return replace(state, inputs=self.peak * np.cos(phase), tick=state.tick + 1)


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
    pilot = Blind(np.zeros(len(one.actuators)), peak, hz)
    return one.fly(pilot, np.zeros((ticks, len(one.major))), events=events, **how)
