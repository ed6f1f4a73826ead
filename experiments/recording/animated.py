"""A flight as an animation takes it: the rows that are drawn, and its machine on paper."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from experiments.recording import Array, drawing
from experiments.recording.marks import Mark
from experiments.recording.shown import Shown

_LARGER = 2
"""The hexapod is magnified so many times as much as in a recording, which can be enlarged."""


@dataclass(frozen=True)
class Animated:
    """A flight that is to be animated, with a heading of a few words."""

    heading: str
    shown: Shown

    @property
    def time_s(self) -> Array:
        """(N,)."""
        return self.shown.time_s

    @property
    def unit(self) -> str:
        """Of the rows that are drawn: those in the unit of the first."""
        return self.shown.row_units[0]

    @property
    def desired(self) -> Array:
        """Of these rows at each tick, (N, k); of one alone, over time."""
        return self.shown.desired[:, self.shown.drawn]

    @property
    def true(self) -> Array:
        """Likewise."""
        return self.shown.true[:, self.shown.drawn]

    @cached_property
    def error(self) -> Array:
        """Distance of these rows from where they should be at each tick, shape (N,)."""
        return np.linalg.norm(self.desired - self.true, axis=1)

    @property
    def factor(self) -> int:
        """By which the machine's motion is magnified to be seen."""
        return self.shown.factor * (_LARGER if self.shown.colored else 1)

    @cached_property
    def surface(self) -> drawing.Machine:
        """Of the machine."""
        return (drawing.machine if self.shown.colored else drawing.robot)(self.shown.model)

    @property
    def marks(self) -> list[tuple[str | None, Mark]]:
        """The failures, with the part of the surface that fails."""
        bodies = self.shown.bodies
        return [
            (f"strut{m.actuator + 1}", m)
            if self.shown.colored
            else (next(iter(bodies[m.actuator]), None), m)
            for m in self.shown.marks
        ]

    @cached_property
    def curves(self) -> tuple[Array, Array]:
        """What is drawn in a plane, desired and true, (N, 2): two rows, or one over time."""
        if len(self.shown.drawn) > 1:
            return self.desired[:, :2], self.true[:, :2]
        # As wide as high.
        both = np.hstack([self.desired, self.true])
        across = (self.time_s - self.time_s[0]) / np.ptp(self.time_s) * np.ptp(both)
        desired, true = (np.column_stack([across, each]) for each in both.T)
        return desired, true
