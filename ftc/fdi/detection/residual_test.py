"""Detection: tests of the residuals with a threshold from the rate of false alarms.

While the plant is as the model has it, the whitened residuals are white noise of unit variance; a
failure adds a mean, and under a dither a sinusoid of its frequency. Their means over the last M
samples are tested for several M at once, as they are and demodulated by the dither (lock-in):
finite moving averages, Basseville and Nikiforov, Detection of Abrupt Changes (1993), section 2.1.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from argument_checks import Array
from kernels import ffi, lib, pointer

WINDOWS = tuple(2**k for k in range(8))
"""Numbers of samples averaged: from one, for a jump, to 128, for a creeping change."""

_DEMODULATED = WINDOWS[3:]
"""A shorter mean of a demodulated residual tells nothing of its frequency."""


@dataclass(frozen=True)
class ResidualTest:
    """Alarm when a mean of the latest residuals exceeds a threshold.

    Attributes:
        outputs: Number of residuals per sample, p.
        swing: The dither at each of the latest samples, cosine and sine, shape (max M, 2); its
            phase does not matter. None without a dither.
        threshold: Of chi-square variables with p degrees of freedom.
        demodulated_threshold: The same with 2 p.
    """

    outputs: int
    swing: Array | None
    threshold: float
    demodulated_threshold: float

    def start(self) -> Array:
        """No residuals yet, shape (max M, p)."""
        return np.zeros((WINDOWS[-1], self.outputs))

    def push(self, recent: Array, residual: Array) -> Array:
        """The latest residuals (max M, p) and one more (p,), the oldest dropped."""
        return np.concatenate([recent[1:], residual[None]])

    def alarm(self, recent: Array) -> int:
        """The smallest M for which the latest residuals (max M, p) are more than noise, or 0.

        The newest residual is the last.
        """
        swing = ffi.NULL if self.swing is None else pointer(self.swing)
        thresholds = self.threshold, self.demodulated_threshold
        own = swing, _DEMODULATED[0], *thresholds, pointer(np.empty(3 * self.outputs))
        return lib.alarming(*recent.shape, pointer(recent), *own)


def residual_test(
    outputs: int, false_alarms_per_hour: float, period_s: float, dither_hz: float | None = None
) -> ResidualTest:
    """A test that raises no more false alarms than that, on average.

    Union bound: the rate is at most that of all windows together, each exact for Gaussian noise.
    """
    tests = len(WINDOWS) + (0 if dither_hz is None else len(_DEMODULATED))
    probability = false_alarms_per_hour / (tests * 3600 / period_s)
    swing = None
    if dither_hz is not None:
        angle = 2 * np.pi * dither_hz * period_s * np.arange(WINDOWS[-1])
        swing = np.column_stack([np.cos(angle), np.sin(angle)])
    return ResidualTest(
        outputs,
        swing,
        float(chdtri(outputs, probability)),
        float(chdtri(2 * outputs, probability)),
    )
