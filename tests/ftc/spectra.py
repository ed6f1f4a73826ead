"""Spectrum and whitening of given residuals without recursions."""

import numpy as np

from ftc.fdi.observer import Spectrum


def spectrum_of(residuals: np.ndarray, order: int, memory: float = np.inf) -> Spectrum:
    """Return the spectrum of residuals (N, p): mean products by lag, with forgetting."""
    N, p = residuals.shape
    rates = 1 / np.minimum(np.arange(1, N + 1), memory)
    left = np.cumprod(np.append(1.0, 1 - rates[:0:-1]))[::-1]  # remaining weight of each sample
    padded = np.vstack([np.zeros((order + 1, p)), residuals])
    lagged = [padded[order + 1 - lag : order + 1 - lag + N] for lag in range(order + 1)]
    covariance = np.array([(rates * left) @ (each * residuals) for each in lagged])
    return Spectrum(padded[-order - 1 :], covariance, N)


def whitened(whitening: np.ndarray, signal: np.ndarray) -> np.ndarray:
    """Filter each output of (N, p) by its weights, newest first, with zeros before."""
    return np.column_stack(
        [np.convolve(r, w)[: len(r)] for r, w in zip(signal.T, whitening.T, strict=True)]
    )
