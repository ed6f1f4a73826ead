"""Problem 1 for a batch of Jacobians with common diagonal weights, compiled: 16 problems at a time.

The same method as in `unlimited.py`, with the number of the problem as the innermost index, so that
the processor works on several at once. All compiled code stands in one file, because the compiler's
cache notices a change of that file alone.
"""

import numpy as np
from numba import njit, types

from argument_checks.compilation import kernel

LANES = 16
"""Problems at a time."""
_MODERATE = 1e100
"""Sum of squares up to which, and from the inverse of which on, no product over- or underflows."""

_any = {k: types.Array(types.float64, k, "A", readonly=True) for k in (1, 2, 3)}
_fast = {"reassoc", "contract"}
_inlined = njit(error_model="numpy", fastmath=_fast)
at = np.uint64
"""An index that cannot be negative: the compiler then leaves out Python's counting from the end."""


@_inlined
def _reflect(W, i, beta, x, n, dot):
    """Apply the reflections in row i of W to vectors x (n, lanes)."""
    for s in range(LANES):
        dot[at(s)] = 0.0
    for j in range(i, n):
        for s in range(LANES):
            dot[at(s)] += W[at(i), at(j), at(s)] * x[at(j), at(s)]
    for s in range(LANES):
        dot[at(s)] *= beta[at(i), at(s)]
    for j in range(i, n):
        for s in range(LANES):
            x[at(j), at(s)] -= dot[at(s)] * W[at(i), at(j), at(s)]


@_inlined
def _reduce_rows(W, rows, n, count, diagonal, beta, dot):
    """Reduce the first rows of W (rows, n, lanes) to lower triangles by reflections."""
    for i in range(count):
        for s in range(LANES):
            dot[at(s)] = 0.0
        for j in range(i, n):
            for s in range(LANES):
                dot[at(s)] += W[at(i), at(j), at(s)] * W[at(i), at(j), at(s)]
        for s in range(LANES):
            norm, first = np.sqrt(dot[at(s)]), W[at(i), at(i), at(s)]
            diagonal[at(i), at(s)] = -np.copysign(norm, first)
            W[at(i), at(i), at(s)] = first - diagonal[at(i), at(s)]
            beta[at(i), at(s)] = 1.0 / (norm * abs(W[at(i), at(i), at(s)]))
        for r in range(i + 1, rows):
            _reflect(W, i, beta, W[r], n, dot)


@_inlined
def _least_squares(M, q, k2, dot, z):
    """Minimize |M_1 z - c| with M = [M_1, c], (q + k2, q + 1, lanes), its first q rows triangular.

    Rows from q on are full, of the others only the diagonal and the last column count.
    """
    for c in range(q):
        for s in range(LANES):
            dot[at(s)] = M[at(c), at(c), at(s)] * M[at(c), at(c), at(s)]
        for r in range(q, q + k2):
            for s in range(LANES):
                dot[at(s)] += M[at(r), at(c), at(s)] * M[at(r), at(c), at(s)]
        for s in range(LANES):
            norm, first = np.sqrt(dot[at(s)]), M[at(c), at(c), at(s)]
            diagonal = -np.copysign(norm, first)
            z[at(c), at(s)] = diagonal
            M[at(c), at(c), at(s)] = first - diagonal
            z[at(q), at(s)] = 1.0 / (norm * abs(first - diagonal))
        for j in range(c + 1, q + 1):
            for s in range(LANES):
                dot[at(s)] = M[at(c), at(c), at(s)] * M[at(c), at(j), at(s)]
            for r in range(q, q + k2):
                for s in range(LANES):
                    dot[at(s)] += M[at(r), at(c), at(s)] * M[at(r), at(j), at(s)]
            for s in range(LANES):
                dot[at(s)] *= z[at(q), at(s)]
                M[at(c), at(j), at(s)] -= dot[at(s)] * M[at(c), at(c), at(s)]
            for r in range(q, q + k2):
                for s in range(LANES):
                    M[at(r), at(j), at(s)] -= dot[at(s)] * M[at(r), at(c), at(s)]
    for i in range(q - 1, -1, -1):
        for s in range(LANES):
            dot[at(s)] = M[at(i), at(q), at(s)]
        for j in range(i + 1, q):
            for s in range(LANES):
                dot[at(s)] -= M[at(i), at(j), at(s)] * z[at(j), at(s)]
        for s in range(LANES):
            z[at(i), at(s)] = dot[at(s)] / z[at(i), at(s)]


@_inlined
def _inverse_square(W, p, diagonal, column, total):
    """Write |L^-1|^2 of the leading triangles of W; not finite where one is singular."""
    for s in range(LANES):
        total[at(s)] = 0.0
    for k in range(p):
        for i in range(k, p):
            for s in range(LANES):
                column[at(i), at(s)] = 1.0 if i == k else 0.0
            for j in range(k, i):
                for s in range(LANES):
                    column[at(i), at(s)] -= W[at(i), at(j), at(s)] * column[at(j), at(s)]
            for s in range(LANES):
                column[at(i), at(s)] /= diagonal[at(i), at(s)]
                total[at(s)] += column[at(i), at(s)] * column[at(i), at(s)]


@_inlined
def _rows(T, S, w, first, W):
    """Write the rows S J / w to W from row `first` on; J as it stands in T."""
    for i in range(len(S)):
        for j in range(len(w)):
            for s in range(LANES):
                W[at(first + i), at(j), at(s)] = 0.0
            for t in range(S.shape[1]):
                factor = S[i, t] / w[j]
                if factor != 0.0:
                    for s in range(LANES):
                        W[at(first + i), at(j), at(s)] += factor * T[at(t), at(j), at(s)]


@kernel(
    types.void(
        _any[3], _any[2], _any[2], _any[1], _any[2], _any[1], types.float64, types.float64,
        *[_any[2]] * 3, types.Array(types.float64, 2, "C"), types.Array(types.boolean, 1, "C"),
    ),
    fastmath=_fast,
)  # fmt: skip
def solve_each(J, S_m, G, w, W2, scale, clear, exact, v, rates_d, v_sd, x, ok):
    """Write the optimal rates to x (B, n), and to `ok` which problems have clearly full ranks.

    Args:
        J: Task Jacobians, (B, m, n).
        S_m: Major directions, (p, m).
        G: W2 S_s, (k2, m).
        w: Diagonal of W1, (n,), none of it zero.
        W2: Secondary weight, (k2, m2).
        scale: Size of J, (B,) or (1,).
        clear: Fraction of the scale above which a singular value is clearly not zero.
        exact: Part of `clear` for joint weights.
        v: Major velocities, (B, p).
        rates_d: Desired rates, (B, n).
        v_sd: Desired secondary velocities, (B, m2).
        x: Overwritten.
        ok: Overwritten, (B,).
    """
    count, m, n = J.shape
    p, k2 = len(S_m), len(G)
    # All rows of the task where that leaves fewer unknowns, else those of the major task.
    reflected = p + k2 if p + k2 < n else p
    q = k2 if reflected > p else n - p
    T, W = np.empty((m, n, LANES)), np.empty((p + k2, n, LANES))
    M, z, X = np.empty((q + k2, q + 1, LANES)), np.empty((q + 1, LANES)), np.empty((n, LANES))
    diagonal, beta = np.empty((n, LANES)), np.empty((n, LANES))
    dot, size, inverse = np.empty(LANES), np.empty(LANES), np.empty(LANES)
    least, size_1, size_S, size_2 = np.inf, 0.0, 0.0, 0.0
    for j in range(n):
        least, size_1 = min(least, abs(w[j])), size_1 + w[j] * w[j]
    for t in range(m):
        for i in range(p):
            size_S += S_m[i, t] * S_m[i, t]
        for i in range(k2):
            size_2 += G[i, t] * G[i, t]
    for base in range(0, count, LANES):
        for s in range(LANES):
            size[at(s)] = 0.0
            k = min(base + s, count - 1)  # the last lanes repeat the last problem
            for j in range(n):
                X[at(j), at(s)] = rates_d[k, j] * w[j]
                for t in range(m):
                    T[at(t), at(j), at(s)] = J[k, t, j]
                    size[at(s)] += J[k, t, j] * J[k, t, j]
        _rows(T, S_m, w, 0, W)
        _rows(T, G, w, p, W)
        _reduce_rows(W, p + k2, n, reflected, diagonal, beta, dot)
        for i in range(reflected):
            _reflect(W, i, beta, X, n, dot)
        for i in range(q):
            for j in range(q):
                for s in range(LANES):
                    M[at(i), at(j), at(s)] = 1.0 if i == j else 0.0
            for s in range(LANES):
                M[at(i), at(q), at(s)] = X[at(p + i), at(s)]
        for i in range(p):
            for s in range(LANES):
                X[at(i), at(s)] = v[min(base + s, count - 1), i]
            for j in range(i):
                for s in range(LANES):
                    X[at(i), at(s)] -= W[at(i), at(j), at(s)] * X[at(j), at(s)]
            for s in range(LANES):
                X[at(i), at(s)] /= diagonal[at(i), at(s)]
        for i in range(k2):
            for s in range(LANES):
                M[at(q + i), at(q), at(s)] = 0.0
            for t in range(W2.shape[1]):
                if W2[i, t] != 0.0:
                    for s in range(LANES):
                        M[at(q + i), at(q), at(s)] += W2[i, t] * v_sd[min(base + s, count - 1), t]
            for j in range(p):
                for s in range(LANES):
                    M[at(q + i), at(q), at(s)] -= W[at(p + i), at(j), at(s)] * X[at(j), at(s)]
            for j in range(q):
                is_reduced = reflected > p and j >= i
                for s in range(LANES):
                    value = W[at(p + i), at(p + j), at(s)]
                    if is_reduced:
                        value = diagonal[at(p + j), at(s)] if i == j else 0.0
                    M[at(q + i), at(j), at(s)] = value
        _least_squares(M, q, k2, dot, z)
        for i in range(q):
            for s in range(LANES):
                X[at(p + i), at(s)] = z[at(i), at(s)]
        for i in range(reflected - 1, -1, -1):
            _reflect(W, i, beta, X, n, dot)
        _inverse_square(W, p, diagonal, beta, inverse)
        for s in range(min(LANES, count - base)):
            k = base + s
            for j in range(n):
                x[k, j] = X[at(j), at(s)] / w[j]
            of_J = scale[min(k, len(scale) - 1)]
            least_A = clear * np.sqrt(size_S) * of_J
            least_M = clear * np.sqrt(size_1 * exact * exact + size_2 * of_J * of_J)
            is_moderate = 1.0 / _MODERATE < size[at(s)] < _MODERATE
            ok[k] = (
                is_moderate
                and of_J > 0.0
                and inverse[at(s)] * least_A * least_A < least * least
                and least_M < least
            )
