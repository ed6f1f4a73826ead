"""Errors of the model and offsets of the sensors, tracked while nothing has failed.

A Kalman filter whose states are the parameters, each a random walk (Ljung, System Identification,
1999, section 11.2): recursive least squares that forgets what may have drifted. Its innovations are
white of unit variance; the covariance says which parameters the motion so far has shown.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg.lapack import dgeqrf
from scipy.linalg.lapack import dtrtrs as solve

from argument_checks import Array
from ftc.fdi.uncertainty import Uncertainty


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
        root: Lower triangular or any other, shape (J + p, J + p).
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
        rates = uncertainty.drift_rate, uncertainty.friction_rate, uncertainty.offset_rate
        rate = np.repeat(rates, [len(self.mean) - limits - outputs, limits, outputs])
        return self.spread(np.diag(rate * np.sqrt(time_s)))

    def spread(self, walk: Array) -> "Parameters":
        """After a random step whose covariance has this square root, shape (J + p, J + p)."""
        return Parameters(self.mean, _lower(np.hstack([self.root, walk])))

    def measured(self, white: Array, regressors: Array) -> tuple[Array, "Parameters"]:
        """Prediction errors of whitened residuals (p,), and the parameters after them.

        The errors are in standard deviations, which grow with the regressors and with the
        covariance.

        Args:
            white: The residuals.
            regressors: Shape (J + p, p).
        """
        p = len(white)
        before = np.zeros((p + len(self.mean), p + len(self.mean)))
        before[:p, :p] = np.eye(p)
        before[:p, p:], before[p:, p:] = regressors.T @ self.root, self.root
        after = _lower(before)
        errors = solve(after[:p, :p], white - self.mean @ regressors, lower=1)[0]
        return errors, Parameters(self.mean + after[p:, :p] @ errors, after[p:, p:])

    def innovations(self, white: Array, regressors: Array) -> Array:
        """Of :meth:`measured`, the errors alone."""
        return self.measured(white, regressors)[0]

    def updated(self, white: Array, regressors: Array) -> "Parameters":
        """Of :meth:`measured`, the parameters alone."""
        return self.measured(white, regressors)[1]


def _lower(wide: Array) -> Array:
    """L with a positive diagonal and L L' = A A' of a matrix A, shape (k, m) with k <= m."""
    # LAPACK's own functions: what scipy wraps around them takes twice as long.
    R = np.triu(dgeqrf(wide.T)[0][: len(wide)])
    return (R * np.where(R.diagonal() < 0, -1.0, 1.0)[:, None]).T
