"""One sample of evidence for all hypotheses, compiled.

All compiled code of an entry point stands in one file, because the compiler's cache notices a
change of the file only. Arguments are those of :class:`.Evidence` and its bank,
and arrays of the evidence are overwritten where `steps` (H, K).
"""

import numpy as np
from numba import types

from argument_checks.compilation import kernel

_1, _2, _3, _4, _5 = (types.Array(types.float64, n, "C") for n in range(1, 6))
_flags = types.Array(types.boolean, 2, "C")
_FASTMATH = {"reassoc", "contract"}


@kernel(types.void(_flags, _4, _4, _3, _4, _3, _4, _1, _1), fastmath=_FASTMATH)
def advance(steps, X, outputs, A, M, C, N, v, age):  # pragma: no cover
    """States X (H, K, 4 + J, s) after the sample, and outputs (H, K, 4 + J, p) during it.

    What drives the last row grows with the age (K,) of the onset, in samples.
    """
    H, K, rows, s = X.shape
    p, r = C.shape[1], len(v)
    moving, after = np.empty(s + r), np.empty((rows, s))
    moving[s:] = v
    for h in range(H):
        for k in range(K):
            if not steps[h, k]:
                continue
            moving[:s] = X[h, k, 0]
            for row in range(rows):
                grown = age[k] if row == rows - 1 else 1.0
                for i in range(p):
                    total = 0.0
                    for j in range(s + r):
                        total += N[h, row, i, j] * moving[j]
                    total *= grown
                    for j in range(s):
                        total += C[h, i, j] * X[h, k, row, j]
                    outputs[h, k, row, i] = total
                for i in range(s):
                    total = 0.0
                    for j in range(s + r):
                        total += M[h, row, i, j] * moving[j]
                    total *= grown
                    for j in range(s):
                        total += A[h, i, j] * X[h, k, row, j]
                    after[row, i] = total
            X[h, k] = after


@kernel(types.void(_flags, _5, _4, _3, _2, _4, _3, _1, _1, _3), fastmath=_FASTMATH)
def weigh(
    steps, memory, information, score, energy, outputs, slopes, y, mean, whitening
):  # pragma: no cover
    """Memory (H, K, q + 1, 5 + J, p) with residuals, and the sums of their products.

    `mean` (J + p,) is that of the prior; `whitening` (H, q + 1, p) begins with the newest residual.
    """
    H, K, rows, p = outputs.shape
    q, J = whitening.shape[1], rows - 4
    R = J + p + 4
    white, regressor = np.empty((rows + 1, p)), np.zeros(R)
    for h in range(H):
        for k in range(K):
            if not steps[h, k]:
                continue
            for lag in range(q - 1):
                memory[h, k, lag] = memory[h, k, lag + 1]
            for i in range(p):
                left = y[i] - outputs[h, k, 0, i] - mean[J + i]
                for row in range(1, rows):
                    if row <= J:
                        left -= mean[row - 1] * outputs[h, k, row, i]
                    memory[h, k, q - 1, row, i] = outputs[h, k, row, i]
                memory[h, k, q - 1, 0, i] = left
                memory[h, k, q - 1, rows, i] = slopes[h, k, i]
            white[:] = 0.0
            for lag in range(q):
                for row in range(rows + 1):
                    for i in range(p):
                        white[row, i] += whitening[h, q - 1 - lag, i] * memory[h, k, lag, row, i]
            for i in range(p):
                e = white[0, i]
                regressor[:J] = white[1 : J + 1, i]
                regressor[J : J + p] = 0.0
                for lag in range(q):
                    regressor[J + i] += whitening[h, lag, i]
                regressor[J + p :] = white[J + 1 :, i]
                energy[h, k] += e * e
                for a in range(R):
                    score[h, k, a] += regressor[a] * e
                    for b in range(R):
                        information[h, k, a, b] += regressor[a] * regressor[b]
