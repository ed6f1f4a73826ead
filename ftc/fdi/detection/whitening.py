"""Noise and disturbance as they are: an autoregressive model estimated from residuals.

Each output has its own. The filter is the prediction error of the autoregression (Yule and Walker;
Kay, Modern Spectral Estimation, 1988, chapter 7): white of unit variance while nothing has failed.
"""

from dataclasses import dataclass

import numpy as np

from argument_checks import Array
from kernels import lib, pointer

_RIDGE = 1e-4

_SLOW_INPUT = 50.0
"""Standard deviation of unknown inputs, in those of the noise."""


@dataclass(frozen=True)
class Spectrum:
    """Autocovariances of residuals, with forgetting.

    Attributes:
        recent: Latest residuals, the newest last, shape (q + 1, p).
        covariance: Their mean products with the newest, by lag, shape (q + 1, p).
        samples: So far.
    """

    recent: Array
    covariance: Array
    samples: int

    @classmethod
    def start(cls, order: int, outputs: int) -> "Spectrum":
        """Nothing measured yet."""
        return cls(np.zeros((order + 1, outputs)), np.zeros((order + 1, outputs)), 0)

    def filter(
        self, fitted: float = 0.0, memory: float = np.inf, slow: float | None = None
    ) -> Array:
        """Weights (q + 1, p) of the newest to the oldest residual, whose sum is white.

        Args:
            fitted: Parameters for each output that were fitted to the same residuals, beside the q
                of the autoregression. Both make them look smaller than new ones will be, by the
                final prediction error (Akaike, Annals Inst. Statistical Mathematics 21, 1969).
            memory: Samples after which residuals are forgotten.
            slow: Corner in radians a sample below which unknown inputs may act besides, as large as
                `_SLOW_INPUT` standard deviations of noise; None is none.
        """
        samples = min(self.samples, memory)
        freedom = min(len(self.covariance) - 1 + fitted, samples / 2)
        error = (samples + freedom) / max(samples - freedom, 1.0)
        weights = np.empty_like(self.covariance)
        lags = (0.0 if slow is None else slow) * np.arange(len(self.covariance))
        disturbance = 0.0 if slow is None else _SLOW_INPUT**2 * (1 + lags) * np.exp(-lags)
        a = np.empty(len(self.covariance) - 1)
        for k, c in enumerate(self.covariance.T):
            ridged = c + disturbance
            ridged[0] *= 1 + _RIDGE
            lib.predict(pointer(ridged), len(a), pointer(a))
            variance = max(ridged[0] - a @ ridged[1:], _RIDGE * ridged[0])
            weights[:, k] = np.concatenate([[1.0], -a]) / np.sqrt(error * variance)
        return weights
