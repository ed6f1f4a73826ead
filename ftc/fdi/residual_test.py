"""Detection: a test of the residuals with a threshold from the rate of false alarms.

While the plant is as the model has it, the residuals are the sensors' white noise; a failure adds a
mean. The mean over the last M samples is tested for several M at once: finite moving averages,
Basseville and Nikiforov, Detection of Abrupt Changes (1993), section 2.1.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from argument_checks import Array

WINDOWS = tuple(2**k for k in range(10))
"""Numbers of samples averaged: from one, for a jump, to 512, for a creeping change."""


@dataclass(frozen=True)
class ResidualTest:
    """Alarm when M |mean of the last M whitened residuals|^2 exceeds a threshold for any M.

    Attributes:
        outputs: Number of residuals per sample, p: chi-square has as many degrees of freedom.
        threshold: Of the chi-square variables.
    """

    outputs: int
    threshold: float

    def start(self) -> Array:
        """No residuals yet, shape (max M, p)."""
        return np.zeros((WINDOWS[-1], self.outputs))

    def push(self, recent: Array, residual: Array) -> Array:
        """The latest residuals (max M, p) and one more (p,), the oldest dropped."""
        return np.vstack([recent[1:], residual])

    def alarm(self, recent: Array) -> int:
        """The smallest M for which the latest residuals (max M, p) are more than noise, or 0.

        The newest residual is the last.
        """
        sums = recent[::-1].cumsum(axis=0)[np.array(WINDOWS) - 1]
        too_large = (sums**2).sum(axis=-1) > self.threshold * np.array(WINDOWS)
        return WINDOWS[too_large.argmax()] if too_large.any() else 0

    def alarms(self, residuals: Array) -> Array:
        """The same for whole records (..., N, p), tick by tick; bool, shape (..., N)."""
        total = np.cumsum(residuals, axis=-2)
        alarm = np.zeros(residuals.shape[:-1], dtype=bool)
        for M in WINDOWS:
            sums = total.copy()
            sums[..., M:, :] -= total[..., :-M, :]
            alarm |= (sums**2).sum(axis=-1) > self.threshold * M
        return alarm


def residual_test(outputs: int, false_alarms_per_hour: float, period_s: float) -> ResidualTest:
    """A test that raises no more false alarms than that, on average.

    Union bound: the rate is at most that of all windows together, each exact for Gaussian noise.
    """
    tests_per_hour = len(WINDOWS) * 3600 / period_s
    return ResidualTest(outputs, float(chdtri(outputs, false_alarms_per_hour / tests_per_hour)))
