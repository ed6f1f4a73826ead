"""What can happen to a strut in flight."""

from dataclasses import dataclass
from typing import Literal

from sim.plant import Plant

FailureKind = Literal["locked", "free", "loose"]
"""Stuck where it is; without coil; without coil and suspension spring."""


@dataclass(frozen=True)
class Failure:
    """One strut fails at one time.

    Attributes:
        strut: 0..nu-1.
        kind: See :data:`FailureKind`.
        time_s: When.
    """

    strut: int
    kind: FailureKind
    time_s: float = 0.0

    def strike(self, plant: Plant) -> None:
        """Let it happen now.

        Raises:
            ValueError: No such strut or kind.
        """
        events = {"locked": plant.lock, "free": plant.release, "loose": plant.break_loose}
        if self.kind not in events:
            raise ValueError(f"kind must be one of {', '.join(events)}, got {self.kind}")
        events[self.kind](self.strut)
