"""Random numbers of a machine that is drawn, each purpose with a stream of its own."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Family = Literal["uniform", "lognormal"]
"""Of the factors of a machine: uniform and independent of one another, or log-normal and correlated
(:data:`CORRELATION`), with the same standard deviation."""

CORRELATION = 0.5
"""Between the logarithms of two log-normal factors of one purpose: parts of one batch."""


@dataclass(frozen=True)
class Draw:
    """Streams of a machine by their purposes: one size more leaves what the others drew."""

    number: int
    family: Family = "uniform"

    def seed(self, purpose: str) -> tuple[int, ...]:
        """Of a generator."""
        return self.number, *purpose.encode()

    def uniform(self, purpose: str, size: int) -> NDArray[np.float64]:
        """In -1..1, shape (size,)."""
        return np.random.default_rng(self.seed(purpose)).uniform(-1, 1, size)

    def factors(self, purpose: str, size: int, half_width: float) -> NDArray[np.float64]:
        """About 1, shape (size,), of a uniform distribution's half width or standard deviation."""
        if self.family == "uniform":
            return 1 + half_width * self.uniform(purpose, size)
        common, *own = np.random.default_rng(self.seed(purpose)).standard_normal(1 + size)
        drawn = np.sqrt(CORRELATION) * common + np.sqrt(1 - CORRELATION) * np.array(own)
        return np.exp(half_width / np.sqrt(3) * drawn)
