"""Displacement gauges, one beside each strut."""

from dataclasses import dataclass

import numpy as np

from sim.array import Array


@dataclass(frozen=True)
class StrutSensors:
    """White noise on the true displacements.

    Attributes:
        noise_m: Standard deviation of one sample.
    """

    noise_m: float

    def read(self, displacement_m: Array, rng: np.random.Generator) -> Array:
        """Measured strut displacements, shape (nu,).

        Args:
            displacement_m: True ones, shape (nu,).
            rng: Source of the noise; nu normal numbers are drawn.
        """
        return displacement_m + self.noise_m * rng.standard_normal(len(displacement_m))
