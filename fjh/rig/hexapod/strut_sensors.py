"""Displacement gauges of the struts."""

from dataclasses import dataclass

import numpy as np

import argument_checks as check
from sim import Array


@dataclass(frozen=True)
class StrutSensors:
    """Gauges that measure strut displacements with white noise.

    Attributes:
        noise_m: Standard deviation of one sample [m].
    """

    noise_m: float

    def __post_init__(self) -> None:
        check.number("noise_m", self.noise_m, 0.0)

    def read(self, displacement_m: Array, rng: np.random.Generator) -> Array:
        """Return measured strut displacements, shape (nu,), [m].

        Args:
            displacement_m: True displacements, shape (nu,).
            rng: Source of the noise; nu normal numbers are sampled.
        """
        displacement_m = check.array("displacement_m", displacement_m, None)
        check.instance("rng", rng, np.random.Generator)
        return displacement_m + self.noise_m * rng.standard_normal(len(displacement_m))
