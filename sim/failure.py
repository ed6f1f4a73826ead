"""What can happen to a strut in flight."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal, get_args

import mujoco
import numpy as np

from sim.plant import Plant

FailureKind = Literal["locked", "free", "loose"]
"""Stuck where it is; without coil; without coil and suspension spring."""


@dataclass(frozen=True)
class Failure:
    """One strut fails at one time.

    Attributes:
        strut: 0..nu-1.
        kind: See :data:`FailureKind`.
        time_s: When, not before the start.

    Raises:
        ValueError: No such kind, a negative strut, or a time that is not finite.
    """

    strut: int
    kind: FailureKind
    time_s: float = 0.0

    def __post_init__(self) -> None:
        if self.kind not in get_args(FailureKind):
            known = ", ".join(get_args(FailureKind))
            raise ValueError(f"kind must be one of {known}, got {self.kind}")
        if self.strut < 0 or not 0 <= self.time_s < np.inf:
            raise ValueError(
                f"strut and time_s must be finite and not negative, got {self.strut}, {self.time_s}"
            )

    def strike(self, plant: Plant) -> None:
        """Let it happen now.

        Raises:
            ValueError: No such strut.
        """
        events = {"locked": plant.lock, "free": plant.release, "loose": plant.break_loose}
        events[self.kind](self.strut)


def failed_plant(model: mujoco.MjModel, failures: Iterable[Failure]) -> Plant:
    """A plant at rest at the nominal pose, with failures that have struck already."""
    plant = Plant(model)
    for failure in failures:
        failure.strike(plant)
    return plant
