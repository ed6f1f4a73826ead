"""Errors of the model and offsets of the sensors, tracked while nothing has failed.

A Kalman filter whose states are the parameters, each a random walk (Ljung, System Identification,
1999, section 11.2): recursive least squares that forgets what may have drifted. Its innovations are
white of unit variance; the covariance says which parameters the motion so far has shown.
"""

from dataclasses import dataclass

import numpy as np

from argument_checks import Array
from ftc.fdi.uncertainty import Uncertainty


@dataclass(frozen=True)
class Parameters:
    """J errors of the model, in standard deviations, then p offsets, in those of the noise.

    The last errors are those of limits of dry friction, where there are any.

    Attributes:
        mean: Shape (J + p,).
        covariance: Shape (J + p, J + p).
    """

    mean: Array
    covariance: Array

    @classmethod
    def prior(cls, errors: int, outputs: int, uncertainty: Uncertainty) -> "Parameters":
        """Before anything is measured."""
        offset = max(uncertainty.offset, 1e-6)
        spread = np.concatenate([np.ones(errors), np.full(outputs, offset)])
        return cls(np.zeros(errors + outputs), np.diag(spread**2))

    def drifted(
        self, time_s: float, outputs: int, uncertainty: Uncertainty, limits: int = 0
    ) -> "Parameters":
        """After so long, with so many outputs and limits of dry friction."""
        rates = uncertainty.drift_rate, uncertainty.friction_rate, uncertainty.offset_rate
        rate = np.repeat(rates, [len(self.mean) - limits - outputs, limits, outputs])
        return Parameters(self.mean, self.covariance + np.diag(rate**2 * time_s))

    def innovations(self, white: Array, regressors: Array) -> Array:
        """Of whitened residuals (p,) with regressors (J + p, p): their prediction errors.

        In standard deviations, which grow with the regressors and with the covariance.
        """
        surprise = white - self.mean @ regressors
        S = np.eye(len(white)) + regressors.T @ self.covariance @ regressors
        return np.linalg.solve(np.linalg.cholesky(S), surprise).astype(float)

    def updated(self, white: Array, regressors: Array) -> "Parameters":
        """After such a measurement."""
        P = self.covariance @ regressors
        S = np.eye(len(white)) + regressors.T @ P
        gain = np.linalg.solve(S, P.T).T
        mean = self.mean + gain @ (white - self.mean @ regressors)
        covariance = self.covariance - gain @ P.T
        return Parameters(mean, (covariance + covariance.T) / 2)
