"""A run as an animation takes it: the rows that are drawn, and its machine on paper."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from experiments.recording import Array, drawing
from experiments.recording.motion import Motion
from experiments.recording.view import Change, RunView

_LARGER = 2
"""The hexapod is magnified so many times as much as in a recording, which can be enlarged."""


@dataclass(frozen=True)
class Animated:
    """A run that is to be animated, with a heading of a few words."""

    heading: str
    run: RunView

    @property
    def time_s(self) -> Array:
        """(N,)."""
        return self.run.time_s

    @property
    def unit(self) -> str:
        """Of the rows that are drawn: those in the unit of the first."""
        return self.run.stated.row_units[0]

    @property
    def desired(self) -> Array:
        """Of these rows at each tick, (N, k); of one alone, over time."""
        return self.run.arrays["desired"][:, self.run.drawn]

    @property
    def true(self) -> Array:
        """Likewise."""
        return self.run.arrays["true"][:, self.run.drawn]

    @cached_property
    def error(self) -> Array:
        """Distance of these rows from where they should be at each tick, shape (N,)."""
        return np.linalg.norm(self.desired - self.true, axis=1)

    @property
    def factor(self) -> int:
        """By which the machine's motion is magnified to be seen."""
        return self.run.factor * (_LARGER if self.run.stated.hexapod else 1)

    @cached_property
    def surface(self) -> drawing.Machine:
        """Of the machine."""
        return (drawing.machine if self.run.stated.hexapod else drawing.robot)(self.run.model)

    def motion(self, tick: int, factor: float) -> Motion:
        """Of the machine at a tick, magnified."""
        own = self.run.arrays
        return self.run.motion(own["task"][[tick]], own["qpos"][[tick]], factor)

    @property
    def failures(self) -> list[tuple[str | None, Change]]:
        """The failures, with the part of the surface that fails."""
        found = []
        for (bodies, _), failure in zip(self.run.failing, self.run.failures, strict=True):
            part = next(iter(bodies), None)
            if self.run.stated.hexapod:
                part = f"strut{bodies[0][-1]}"
            found.append((part, failure))
        return found

    @cached_property
    def curves(self) -> tuple[Array, Array]:
        """What is drawn in a plane, desired and true, (N, 2): two rows, or one over time."""
        if len(self.run.drawn) > 1:
            return self.desired[:, :2], self.true[:, :2]
        # As wide as high.
        both = np.hstack([self.desired, self.true])
        across = (self.time_s - self.time_s[0]) / np.ptp(self.time_s) * np.ptp(both)
        desired, true = (np.column_stack([across, each]) for each in both.T)
        return desired, true
