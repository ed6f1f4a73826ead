"""The spectrum of residuals that are all known, without recursions, and what a filter leaves."""

import numpy as np

from ftc.fdi.observer import Spectrum


def spectrum_of(residuals: np.ndarray, order: int, memory: float = np.inf) -> Spectrum:
    """Of residuals (N, p): mean products by lag, forgotten after so many samples."""
    N, p = residuals.shape
    rates = 1 / np.minimum(np.arange(1, N + 1), memory)
    left = np.cumprod(np.append(1.0, 1 - rates[:0:-1]))[::-1]  # of each, after those that follow
    padded = np.vstack([np.zeros((order + 1, p)), residuals])
    lagged = [padded[order + 1 - lag : order + 1 - lag + N] for lag in range(order + 1)]
    covariance = np.array([(rates * left) @ (each * residuals) for each in lagged])
    return Spectrum(padded[-order - 1 :], covariance, N)


def whitened(whitening: np.ndarray, signal: np.ndarray) -> np.ndarray:
    """Each output of (N, p) by its own weights, newest first; nothing was before."""
    return np.column_stack(
        [np.convolve(r, w)[: len(r)] for r, w in zip(signal.T, whitening.T, strict=True)]
    )
