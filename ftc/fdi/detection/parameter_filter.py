"""Errors of the model and offsets of the sensors, tracked while nothing has failed.

A Kalman filter whose states are the parameters, each a random walk (Ljung, System Identification,
1999, section 11.2): recursive least squares that forgets what may have drifted. Its innovations are
white of unit variance; the covariance says which parameters the motion so far has shown.
"""

from dataclasses import dataclass

import numpy as np

from argument_checks import Array
from ftc.fdi.uncertainty import Uncertainty
from kernels import lib, pointer


@dataclass(frozen=True)
class Parameters:
    """J errors of the model, in standard deviations, then p offsets, in those of the noise.

    The last errors are those of limits of dry friction, where there are any. The covariance is kept
    as a square root: where the motion shows a parameter a billion times better than the noise,
    rounding would leave the covariance itself indefinite (Bierman, Factorization Methods for
    Discrete Sequential Estimation, 1977; Kailath, Sayed and Hassibi, Linear Estimation, 2000,
    section 12.1).

    Attributes:
        mean: Shape (J + p,).
        root: Lower triangular, shape (J + p, J + p), its diagonal not negative.
    """

    mean: Array
    root: Array

    @property
    def covariance(self) -> Array:
        """Of the parameters, shape (J + p, J + p)."""
        return self.root @ self.root.T

    @classmethod
    def prior(cls, errors: int, outputs: int, uncertainty: Uncertainty) -> "Parameters":
        """Before anything is measured."""
        offset = max(uncertainty.offset, 1e-6)
        spread = np.concatenate([np.ones(errors), np.full(outputs, offset)])
        return cls(np.zeros(errors + outputs), np.diag(spread))

    def drifted(
        self, time_s: float, outputs: int, uncertainty: Uncertainty, limits: int = 0
    ) -> "Parameters":
        """After so long, with so many outputs and limits of dry friction."""
        return self.spread(drift(len(self.mean), time_s, outputs, uncertainty, limits))

    def spread(self, deviations: Array) -> "Parameters":
        """After independent random steps of these standard deviations, shape (J + p,)."""
        k, after = len(deviations), np.empty_like(self.root)
        room = pointer(np.empty(2 * k * (k + 1)))
        lib.spread_root(pointer(self.root), pointer(deviations), k, room, pointer(after))
        return Parameters(self.mean, after)


def drift(
    parameters: int, time_s: float, outputs: int, uncertainty: Uncertainty, limits: int = 0
) -> Array:
    """Standard deviations (J + p,) of the steps in so long, of :meth:`Parameters.drifted`."""
    rates = uncertainty.drift_rate, uncertainty.friction_rate, uncertainty.offset_rate
    rate = np.repeat(rates, [parameters - limits - outputs, limits, outputs])
    return rate * np.sqrt(time_s)
