"""What the watch does at every sample, compiled.

The functions stand in one file, because the compiler's cache notices a change of the file only.
"""

import numpy as np
from numba import njit, types

from argument_checks.compilation import kernel

_1, _2, _3 = (types.Array(types.float64, n, "C") for n in range(1, 4))
_FASTMATH = {"reassoc", "contract"}


_inlined = njit(error_model="numpy", fastmath=_FASTMATH)


@_inlined
def _spread(upper, deviations):  # pragma: no cover
    """Make upper (k, k), the transpose of a root, that of :func:`spread`, in place.

    Column by column one reflection takes all steps into the diagonal.
    """
    k = len(upper)
    steps, unit, along = np.zeros((k, k)), np.empty(k), np.empty(k)
    for j in range(k):
        steps[j, j] = deviations[j]
        square = 0.0
        for i in range(j + 1):
            square += steps[i, j] ** 2
        size = np.sqrt(square)
        if size == 0.0:
            continue
        length = np.sqrt(upper[j, j] ** 2 + square)
        cosine, sine = upper[j, j] / length, size / length
        along[j:] = 0.0
        for i in range(j + 1):
            unit[i] = steps[i, j] / size
            for a in range(j, k):
                along[a] += unit[i] * steps[i, a]
        for a in range(j, k):
            kept, step = upper[j, a], along[a]
            upper[j, a] = cosine * kept + sine * step
            along[a] = cosine * step - sine * kept - step
        for i in range(j + 1):
            for a in range(j, k):
                steps[i, a] += unit[i] * along[a]


@_inlined
def _measured(mean, upper, white, regressors, errors):  # pragma: no cover
    """Errors (p,), mean (k,) and the transposed root (k, k) after whitened residuals, in place.

    One output after another, each by rotations of [1, g' root; 0, root] into [deviation of its
    error, 0; gain, root after it]. Errors are in standard deviations, which grow with the
    regressors (k, p) and with the covariance.
    """
    k, p = regressors.shape
    gain = np.empty(k)
    for i in range(p):
        left, deviation, gain[:] = white[i], 1.0, 0.0
        for a in range(k):
            left -= mean[a] * regressors[a, i]
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
            mean[a] += gain[a] * errors[i]


@kernel(_2(_2, _1), fastmath=_FASTMATH)
def spread(root, deviations):  # pragma: no cover
    """Root (k, k) with the squares of deviations (k,) added to its covariance.

    By reflections, which leave it lower triangular.
    """
    upper = root.T.copy()
    _spread(upper, deviations)
    return upper.T.copy()


@kernel(types.Tuple((_2, _2))(_2, _2, _1, types.float64))
def correlated(recent, covariance, residual, rate):  # pragma: no cover
    """Residuals with the newest, and their mean products (q + 1, p) with it, by lag."""
    q, p = recent.shape
    later, after = np.empty_like(recent), np.empty_like(covariance)
    later[: q - 1], later[q - 1] = recent[1:], residual
    for lag in range(q):
        for i in range(p):
            product = later[q - 1 - lag, i] * residual[i]
            after[lag, i] = covariance[lag, i] + rate * (product - covariance[lag, i])
    return later, after


@kernel(
    types.Tuple((_3, _1, types.boolean, _1, _2, _2, _2))(
        *(_3, _2, _1, _2, _1, _2, _1, _2, _2),
        *(types.float64, types.float64, types.boolean),
    ),
    fastmath=_FASTMATH,
)
def corrected(
    memory,
    predicted,
    y,
    whitening,
    mean,
    root,
    drift,
    recent,
    covariance,
    rate,
    largest,
    learns,
):  # pragma: no cover
    """What a sample (p,) makes of a state: see :meth:`.Watch.step`, whose second half this is.

    Args:
        memory: Residuals and regressors before it, shape (q + 1, 1 + J, p).
        predicted: Outputs of the model, and what each error adds to them, shape (1 + J, p).
        y: Mean outputs.
        whitening: Shape (q + 1, p).
        mean: Of the parameters, shape (J + p,).
        root: Of their covariance.
        drift: Standard deviations of their steps, shape (J + p,).
        recent: Of the spectrum, as its covariance (q + 1, p).
        covariance: See there.
        rate: Weight of this sample in the covariance.
        largest: Sum of squares of an innovation that is still learned from.
        learns: Whether anything is.

    Returns:
        Memory, innovation (p,), whether it was learned from, mean, root, recent and covariance
        after it; the last four as they were if it was not.
    """
    q, rows, p = memory.shape
    J = rows - 1
    later = np.empty_like(memory)
    later[: q - 1], later[q - 1] = memory[1:], predicted
    white, regressors, left, residual = np.zeros(p), np.zeros((J + p, p)), np.empty(p), np.empty(p)
    later[q - 1, 0] = y - predicted[0]
    for lag in range(q):
        for i in range(p):
            weight = whitening[q - 1 - lag, i]
            white[i] += weight * later[lag, 0, i]
            regressors[J + i, i] += weight
            for row in range(J):
                regressors[row, i] += weight * later[lag, row + 1, i]
    after, upper = mean.copy(), root.T.copy()
    _measured(after, upper, white, regressors, residual)
    if not learns or (residual**2).sum() > largest:
        return later, residual, False, mean, root, recent, covariance
    for i in range(p):
        left[i] = later[q - 1, 0, i] - after[J + i]
        for row in range(J):
            left[i] -= after[row] * later[q - 1, row + 1, i]
    _spread(upper, drift)
    products = correlated(recent, covariance, left, rate)
    return later, residual, True, after, upper.T.copy(), products[0], products[1]


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
