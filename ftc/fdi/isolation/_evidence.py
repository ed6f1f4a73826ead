"""One sample of evidence for all hypotheses, compiled.

All compiled code of an entry point stands in one file, because the compiler's cache notices a
change of the file only. Arguments are those of :class:`.Evidence` and its bank, and what they
compute is of the hypotheses and onsets that `steps` (H, K).
"""

import numpy as np
from numba import types

from argument_checks.compilation import kernel

_1, _2, _3, _4 = (types.Array(types.float64, n, "C") for n in range(1, 5))
_spans = types.Array(types.uint64, 3, "C")
_onsets, _flags = (types.Array(types.boolean, n, "C") for n in (1, 2))
_FASTMATH = {"reassoc", "contract"}
_EPSILON = 2.0**-52


@kernel(types.void(_flags, _4, _4, _3, _3, _spans, _1, _1), fastmath=_FASTMATH)
def advance(steps, X, outputs, alone, driven, spans, v, age):  # pragma: no cover
    """States X (H, K, 4 + J, s) after the sample, and outputs (H, K, 4 + J, p) during it.

    What drives the last row grows with the age (K,) of the onset, in samples. `alone` (H, s, p + s)
    and `driven` (H, s + r, (4 + J) (p + s)) as of :func:`stacked`, as are `spans` (H, s + r, 2),
    the places in which a column of `driven` is not zero. Four columns at a time, for the sums are
    many and short.
    """
    H, K, rows, s = X.shape
    p, r = outputs.shape[3], len(v)
    w = p + s
    n = rows * w
    given, out = np.empty(n), np.empty(n)
    for h in range(H):
        given[:] = 0.0
        for j in range(r):
            for i in range(spans[h, s + j, 0], spans[h, s + j, 1]):
                given[i] += driven[h, s + j, i] * v[j]
        for k in range(K):
            if not steps[h, k]:
                continue
            out[:] = given
            for j in range(0, s - s % 4, 4):
                a, b, c, d = X[h, k, 0, j], X[h, k, 0, j + 1], X[h, k, 0, j + 2], X[h, k, 0, j + 3]
                start, end = spans[h, j, 0], spans[h, j, 1]
                for each in range(j + 1, j + 4):
                    start, end = min(start, spans[h, each, 0]), max(end, spans[h, each, 1])
                for i in range(start, end):
                    one, two = driven[h, j, i] * a, driven[h, j + 1, i] * b
                    out[i] += one + two + driven[h, j + 2, i] * c + driven[h, j + 3, i] * d
            for j in range(s - s % 4, s):
                for i in range(spans[h, j, 0], spans[h, j, 1]):
                    out[i] += driven[h, j, i] * X[h, k, 0, j]
            for i in range(n - w, n):
                out[i] *= age[k]
            for row in range(rows):
                o = row * w
                for j in range(0, s - s % 4, 4):
                    a, b = X[h, k, row, j], X[h, k, row, j + 1]
                    c, d = X[h, k, row, j + 2], X[h, k, row, j + 3]
                    for i in range(w):
                        one, two = alone[h, j, i] * a, alone[h, j + 1, i] * b
                        out[o + i] += one + two + alone[h, j + 2, i] * c + alone[h, j + 3, i] * d
                for j in range(s - s % 4, s):
                    for i in range(w):
                        out[o + i] += alone[h, j, i] * X[h, k, row, j]
            for row in range(rows):
                for i in range(p):
                    outputs[h, k, row, i] = out[row * w + i]
                for i in range(s):
                    X[h, k, row, i] = out[row * w + p + i]


@kernel(
    types.void(
        *(_flags, _onsets, types.boolean, types.boolean),
        *(_4, _3, _3, _2, _4, _3, _1, _1, _3),
        *(_4, _3, _3, _2),
    ),
    fastmath=_FASTMATH,
)
def weigh(
    steps,
    begins,
    weighs,
    keeps,
    memory,
    information,
    score,
    energy,
    outputs,
    slopes,
    y,
    mean,
    weights,
    memory_after,
    information_after,
    score_after,
    energy_after,
):  # pragma: no cover
    """Memory with residuals, and the sums of their products, written to the last four arrays.

    These may be the first four, where nothing of them `keeps`. Of an onset (K,) that `begins`
    hypotheses have the evidence of the first one, which therefore comes last.

    Rows of memory (H, K, q + 1, (5 + J) p) are flat, of information the lower triangle.
    `mean` (J + p,) is that of the prior; `weights` (2, q + 1, (5 + J) p) of the rows of memory, the
    second of the last hypothesis.
    """
    H, K, rows, p = outputs.shape
    q, n = weights.shape[1:]
    J = rows - 4
    R = J + p + 4
    white, regressors, offsets = np.empty(n), np.zeros((p, R)), np.zeros((2, p))
    for which in range(2):
        for lag in range(q):
            for i in range(p):
                offsets[which, i] += weights[which, lag, i]
    for h in range(H - 1, -1, -1):
        last = int(h == H - 1)
        for k in range(K):
            if not steps[h, k]:
                if keeps:
                    memory_after[h, k], score_after[h, k] = memory[h, k], score[h, k]
                    information_after[h, k] = information[h, k]
                    energy_after[h, k] = energy[h, k]
                continue
            g, b = (0, 0) if begins[k] and 0 < h < H - 1 else (h, k)
            for lag in range(q - 1):
                for i in range(n):
                    memory_after[h, k, lag, i] = memory[g, b, lag + 1, i]
            for i in range(p):
                left = y[i] - outputs[h, k, 0, i] - mean[J + i]
                for row in range(1, rows):
                    if row <= J:
                        left -= mean[row - 1] * outputs[h, k, row, i]
                    memory_after[h, k, q - 1, row * p + i] = outputs[h, k, row, i]
                memory_after[h, k, q - 1, i] = left
                memory_after[h, k, q - 1, rows * p + i] = slopes[h, k, i]
            if not weighs:
                information_after[h, k], score_after[h, k] = information[g, b], score[g, b]
                energy_after[h, k] = energy[g, b]
                continue
            white[:] = 0.0
            for lag in range(q):
                for i in range(n):
                    white[i] += weights[last, lag, i] * memory_after[h, k, lag, i]
            total = energy[g, b]
            for i in range(p):
                total += white[i] ** 2
                regressors[i, J + i] = offsets[last, i]
                for row in range(J):
                    regressors[i, row] = white[(1 + row) * p + i]
                for row in range(4):
                    regressors[i, J + p + row] = white[(1 + J + row) * p + i]
            energy_after[h, k] = total
            start = 0
            for row in range(R):
                for a in range(row + 1):
                    information_after[h, k, start + a] = information[g, b, start + a]
                total = score[g, b, row]
                for i in range(p):
                    each = regressors[i, row]
                    total += each * white[i]
                    for a in range(row + 1):
                        information_after[h, k, start + a] += each * regressors[i, a]
                score_after[h, k, row] = total
                start += row + 1


@kernel(types.void(_3, _3, _2, _4, _2), fastmath=_FASTMATH)
def integrate(information, score, spread, solved, log_det):  # pragma: no cover
    """Solve S = 1 + spread' information spread for each hypothesis and onset, by Cholesky.

    `spread` (R, R) is lower triangular; `solved` (H, K, R, 3) comes with the right-hand sides, and
    `log_det` (H, K) becomes half of log det S. S is at least 1, and so is each of its pivots: a
    smaller one is rounding, as is one that is lost beside the diagonal.
    """
    H, K, R = score.shape
    product, root = np.empty((R, R)), np.empty((R, R))
    for h in range(H):
        for k in range(K):
            product[:] = 0.0
            root[:] = 0.0
            for row in range(R):
                for b in range(R):
                    at = row * (row + 1) // 2 + b if b <= row else b * (b + 1) // 2 + row
                    each = information[h, k, at]
                    for a in range(min(b, row) + 1):  # those that the lower triangle needs
                        product[row, a] += each * spread[b, a]
            for b in range(R):
                for row in range(b + 1):
                    each = spread[b, row]
                    for a in range(row + 1):
                        root[row, a] += each * product[b, a]
            total = 0.0
            for row in range(R):
                least = max(1.0, R * _EPSILON * root[row, row])
                for a in range(row + 1):
                    left = root[row, a] + (1.0 if a == row else 0.0)
                    for b in range(a):
                        left -= root[row, b] * root[a, b]
                    root[row, a] = np.sqrt(max(left, least)) if a == row else left / root[a, a]
                total += np.log(root[row, row])
            log_det[h, k] = total
            for row in range(R):
                for b in range(row):
                    for i in range(3):
                        solved[h, k, row, i] -= root[row, b] * solved[h, k, b, i]
                for i in range(3):
                    solved[h, k, row, i] /= root[row, row]
            for row in range(R - 1, -1, -1):
                for i in range(3):
                    solved[h, k, row, i] /= root[row, row]
                for b in range(row):
                    for i in range(3):
                        solved[h, k, b, i] -= root[row, b] * solved[h, k, row, i]
