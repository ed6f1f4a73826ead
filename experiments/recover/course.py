"""Where the hexapod is to point in a flight: the spiral, and what else a telescope does."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from experiments.rig.hexapod.testbed import TestbedConfig
from experiments.rig.paths import path_of
from sim import Array

Shape = Literal["spiral", "circle", "steps", "rest"]


@dataclass(frozen=True)
class Course:
    """A path of the pointing.

    Attributes:
        shape: The testbed's spiral, from any time on; a circle from rest; steps out and back, each
            held for a quarter of a turn; or none.
        turn_s: Time of one turn.
        radius: In radii of the testbed's spiral.
    """

    shape: Shape = "spiral"
    turn_s: float = TestbedConfig().spiral_period_s
    radius: float = 1.0

    def desired_rad(self, begin_s: float, duration_s: float) -> Array:
        """The part of it that a flight follows, shape (N, 2)."""
        size_urad = self.radius * TestbedConfig().spiral_radius_urad
        own = {"spiral_period_s": self.turn_s, "spiral_radius_urad": size_urad}
        bench = replace(TestbedConfig(), **own)
        time_s = bench.time_s(duration_s)
        if self.shape == "spiral":
            return bench.desired_rad(begin_s + time_s)
        if self.shape == "rest":
            return np.zeros((len(time_s), 2))
        how = time_s, self.turn_s, bench.control_period_s
        return path_of(self.shape, 2, 1e-6 * size_urad, *how)


SPIRAL = Course()
"""The testbed's own."""
