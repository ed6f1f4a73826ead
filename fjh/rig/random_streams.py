"""Random numbers of a sampled machine, with a separate stream for each purpose."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Family = Literal["uniform", "lognormal"]
"""Distribution of the factors of a machine: uniform and independent, or log-normal and correlated
(:data:`CORRELATION`), with the same standard deviation."""

CORRELATION = 0.5
"""Correlation of the logarithms of one parameter's factors, as for parts of one batch."""


@dataclass(frozen=True)
class RandomStreams:
    """Random streams of a machine by purpose: samples for one purpose do not change the others."""

    number: int
    family: Family = "uniform"

    def seed(self, purpose: str) -> tuple[int, ...]:
        """Return the seed of the generator for a purpose."""
        return self.number, *purpose.encode()

    def uniform(self, purpose: str, size: int) -> NDArray[np.float64]:
        """Return samples uniform in -1..1, shape (size,)."""
        return np.random.default_rng(self.seed(purpose)).uniform(-1, 1, size)

    def factors(self, purpose: str, size: int, half_width: float) -> NDArray[np.float64]:
        """Return random factors about 1, shape (size,), of this half width (if uniform)."""
        if self.family == "uniform":
            return 1 + half_width * self.uniform(purpose, size)
        common, *independent = np.random.default_rng(self.seed(purpose)).standard_normal(1 + size)
        samples = np.sqrt(CORRELATION) * common + np.sqrt(1 - CORRELATION) * np.array(independent)
        return np.exp(half_width / np.sqrt(3) * samples)
