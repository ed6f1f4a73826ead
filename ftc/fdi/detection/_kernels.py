"""What the watch does at every sample, compiled.

The functions stand in one file, because the compiler's cache notices a change of the file only.
"""

import numpy as np
from numba import types

from argument_checks.compilation import kernel

_1, _2, _3 = (types.Array(types.float64, n, "C") for n in range(1, 4))
_FASTMATH = {"reassoc", "contract"}


@kernel(_2(_2, _1), fastmath=_FASTMATH)
def spread(root, deviations):  # pragma: no cover
    """Root (k, k) with the squares of deviations (k,) added to its covariance.

    By Givens rotations, which leave it lower triangular.
    """
    k = len(root)
    upper, step = root.T.copy(), np.zeros(k)
    for i in range(k):
        if deviations[i] == 0.0:
            continue
        step[i] = deviations[i]
        for j in range(i, k):
            length = np.sqrt(upper[j, j] ** 2 + step[j] ** 2)
            if length == 0.0:
                continue
            cosine, sine = upper[j, j] / length, step[j] / length
            for a in range(j, k):
                kept = upper[j, a]
                upper[j, a] = cosine * kept + sine * step[a]
                step[a] = cosine * step[a] - sine * kept
        step[:] = 0.0
    return upper.T.copy()


@kernel(types.Tuple((_1, _1, _2))(_1, _2, _1, _2), fastmath=_FASTMATH)
def measured(mean, root, white, regressors):  # pragma: no cover
    """Errors (p,), mean (k,) and root (k, k) after :meth:`.Parameters.measured`.

    One output after another, each by rotations of [1, g' root; 0, root] into [deviation of its
    error, 0; gain, root after it].
    """
    k, p = regressors.shape
    after, upper, errors, gain = mean.copy(), root.T.copy(), np.empty(p), np.empty(k)
    for i in range(p):
        left, deviation, gain[:] = white[i], 1.0, 0.0
        for a in range(k):
            left -= after[a] * regressors[a, i]
        for j in range(k - 1, -1, -1):
            seen = 0.0
            for a in range(j, k):
                seen += upper[j, a] * regressors[a, i]
            length = np.sqrt(deviation**2 + seen**2)
            cosine, sine = deviation / length, seen / length
            for a in range(j, k):
                kept = upper[j, a]
                upper[j, a] = cosine * kept - sine * gain[a]
                gain[a] = cosine * gain[a] + sine * kept
            deviation = length
        errors[i] = left / deviation
        for a in range(k):
            after[a] += gain[a] * errors[i]
    return errors, after, upper.T.copy()


@kernel(types.Tuple((_1, _2))(_3, _2), fastmath=_FASTMATH)
def whitened(memory, whitening):  # pragma: no cover
    """Whitened residuals (p,), and regressors (J + p, p) of the errors and of the offsets."""
    q, rows, p = memory.shape
    white, regressors = np.zeros(p), np.zeros((rows - 1 + p, p))
    for lag in range(q):
        for i in range(p):
            weight = whitening[q - 1 - lag, i]
            white[i] += weight * memory[lag, 0, i]
            regressors[rows - 1 + i, i] += weight
            for row in range(1, rows):
                regressors[row - 1, i] += weight * memory[lag, row, i]
    return white, regressors


@kernel(types.Tuple((_2, _2))(_2, _2, _1, types.float64))
def correlated(recent, covariance, residual, rate):  # pragma: no cover
    """Residuals with the newest, and products (q + 1, p) of :meth:`.Spectrum.with_residual`."""
    q, p = recent.shape
    later, after = np.empty_like(recent), np.empty_like(covariance)
    later[: q - 1], later[q - 1] = recent[1:], residual
    for lag in range(q):
        for i in range(p):
            product = later[q - 1 - lag, i] * residual[i]
            after[lag, i] = covariance[lag, i] + rate * (product - covariance[lag, i])
    return later, after


@kernel(_1(_1))
def predictor(covariance):  # pragma: no cover
    """Weights (q,) of the latest samples, newest first, that predict the next one best.

    By the recursion of Levinson and Durbin, from autocovariances (q + 1,).
    """
    q = len(covariance) - 1
    weights, before, variance = np.zeros(q), np.empty(q), covariance[0]
    for k in range(q):
        left = covariance[k + 1]
        for i in range(k):
            left -= weights[i] * covariance[k - i]
        reflection = left / variance
        before[:k] = weights[:k]
        for i in range(k):
            weights[i] -= reflection * before[k - 1 - i]
        weights[k] = reflection
        variance *= 1.0 - reflection**2
    return weights


@kernel(types.int64(_2, _2, types.int64, types.float64, types.float64))
def alarm(recent, swing, shortest, threshold, demodulated_threshold):  # pragma: no cover
    """Window of :meth:`.ResidualTest.alarm`; `swing` is empty where there is no dither."""
    M, p = recent.shape
    total, turned, window = np.zeros(p), np.zeros((2, p)), 1
    for k in range(M):
        for i in range(p):
            newest = recent[M - 1 - k, i]
            total[i] += newest
            for phase in range(2 * min(len(swing), 1)):
                turned[phase, i] += swing[k, phase] * newest
        if k + 1 == window:
            if (total**2).sum() > threshold * window:
                return window
            # The mean square of a sinusoid is one half.
            if window >= shortest and 2.0 * (turned**2).sum() > demodulated_threshold * window:
                return window
            window *= 2
    return 0
