"""Random numbers of a machine that is drawn, each purpose with a stream of its own."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Draw:
    """Streams of a machine by their purposes: one size more leaves what the others drew."""

    number: int

    def seed(self, purpose: str) -> tuple[int, ...]:
        """Of a generator."""
        return self.number, *purpose.encode()

    def uniform(self, purpose: str, size: int) -> NDArray[np.float64]:
        """In -1..1, shape (size,)."""
        return np.random.default_rng(self.seed(purpose)).uniform(-1, 1, size)

    def factors(self, purpose: str, size: int, half_width: float) -> NDArray[np.float64]:
        """About 1, shape (size,)."""
        return 1 + half_width * self.uniform(purpose, size)
