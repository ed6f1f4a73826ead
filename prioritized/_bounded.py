"""Lexicographic least squares under bounds, compiled: a primal active-set method, level by level.

All compiled code of one entry point stands in one file, because the compiler's cache notices a
change of that file alone.
"""

import numpy as np
from numba import njit

AT_LOWER, FREE, AT_UPPER = -1, 0, 1
COLD, FROM_OPTIMUM, WARM = 0, 1, 2
"""What the solver starts from: nothing, the optimum without bounds, an earlier solution."""

_ROUND_OFF = 1e-13
"""Multipliers below this fraction of the terms they are computed from may be round-off."""
_CLEAR = 1e-9
"""Multipliers above this fraction show that a bound holds a level back."""
_DEGENERATE = 3
"""After as many steps of zero length the first candidate is taken, not the best: no cycling."""

_compiled = njit(cache=True, error_model="numpy")


@_compiled
def _reduce_rows(B, first, last, column, beta, V, order, threshold, gap):
    """Reduce rows first..last of B to lower triangles by reflections from the right.

    The row with the largest remainder is next. Rows after `last` are reflected too. Returns the
    rank, and the smallest gap of its decisions.
    """
    rows, columns = B.shape
    rank = 0
    while first + rank < last and column + rank < columns:
        t, c = first + rank, column + rank
        best, most = t, -1.0
        for i in range(t, last):
            square = 0.0
            for j in range(c, columns):
                square += B[i, j] * B[i, j]
            if square > most:
                best, most = i, square
        norm = np.sqrt(most)
        if not norm > threshold:
            if norm > 0.0:
                gap = min(gap, threshold / norm)
            break
        gap = min(gap, norm / threshold)
        if best != t:
            for j in range(columns):
                B[t, j], B[best, j] = B[best, j], B[t, j]
            order[t], order[best] = order[best], order[t]
        diagonal = -norm if B[t, c] >= 0.0 else norm
        for j in range(c, columns):
            V[rank, j] = B[t, j]
            B[t, j] = 0.0
        V[rank, c] -= diagonal
        B[t, c] = diagonal
        beta[rank] = 1.0 / (norm * abs(V[rank, c]))
        for i in range(t + 1, rows):
            dot = 0.0
            for j in range(c, columns):
                dot += V[rank, j] * B[i, j]
            dot *= beta[rank]
            for j in range(c, columns):
                B[i, j] -= dot * V[rank, j]
        rank += 1
    return rank, gap


@_compiled
def _reflect(x, beta, V, rank, column, backwards):
    """Apply reflections to a vector, in the order in which they were made or backwards."""
    for k in range(rank):
        t = rank - 1 - k if backwards else k
        dot = 0.0
        for j in range(column + t, len(x)):
            dot += V[t, j] * x[j]
        dot *= beta[t]
        for j in range(column + t, len(x)):
            x[j] -= dot * V[t, j]


@_compiled
def _least_squares(L, r):
    """Minimize |L w - r| in place, L (k, q) of full column rank; w is r[:q]."""
    k, q = L.shape
    for c in range(q):
        square = 0.0
        for i in range(c, k):
            square += L[i, c] * L[i, c]
        norm = np.sqrt(square)
        diagonal = -norm if L[c, c] >= 0.0 else norm
        L[c, c] -= diagonal
        scale = 1.0 / (norm * abs(L[c, c]))
        for j in range(c + 1, q):
            dot = 0.0
            for i in range(c, k):
                dot += L[i, c] * L[i, j]
            for i in range(c, k):
                L[i, j] -= scale * dot * L[i, c]
        dot = 0.0
        for i in range(c, k):
            dot += L[i, c] * r[i]
        for i in range(c, k):
            r[i] -= scale * dot * L[i, c]
        L[c, c] = diagonal
    for c in range(q - 1, -1, -1):
        for j in range(c + 1, q):
            r[c] -= L[c, j] * r[j]
        r[c] /= L[c, c]


@_compiled
def _remove(q, row):
    """Take the part along the unit row q from a row."""
    dot = 0.0
    for j in range(len(row)):
        dot += q[j] * row[j]
    for j in range(len(row)):
        row[j] -= dot * q[j]


@_compiled
def _orthonormal(Q, kept, A, held, threshold):
    """Orthonormal rows that span those of Q and A on what is not held; their number."""
    n = Q.shape[1]
    rest = np.empty((kept + len(A), n))
    for i in range(kept + len(A)):
        for j in range(n):
            rest[i, j] = 0.0 if held[j] else (Q[i, j] if i < kept else A[i - kept, j])
    rank, first = 0, 0
    for last, least in ((kept, 1e-10), (kept + len(A), threshold)):
        # Rows of Q before those of A, which are then free of them.
        while first < last and rank < n:
            best, most = first, -1.0
            for i in range(first, last):
                square = 0.0
                for j in range(n):
                    square += rest[i, j] * rest[i, j]
                if square > most:
                    best, most = i, square
            if not np.sqrt(most) > least:
                break
            for j in range(n):
                rest[first, j], rest[best, j] = rest[best, j], rest[first, j]
            for t in range(rank):  # once more, against cancellation
                _remove(Q[t], rest[first])
            square = 0.0
            for j in range(n):
                square += rest[first, j] * rest[first, j]
            norm = np.sqrt(square)
            if norm > least:
                for j in range(n):
                    Q[rank, j] = rest[first, j] / norm
                for i in range(first + 1, len(rest)):
                    _remove(Q[rank], rest[i])
                rank += 1
            first += 1
        first = last
    return rank


@_compiled
def _gradient(A, b, x, g):
    """Gradient A^T (A x - b), and the norm of the residual beside what it is computed from."""
    k, n = A.shape
    square, size = 0.0, 0.0
    for j in range(n):
        g[j] = 0.0
    for i in range(k):
        r, terms = -b[i], abs(b[i])
        for j in range(n):
            r += A[i, j] * x[j]
            terms += abs(A[i, j] * x[j])
        for j in range(n):
            g[j] += r * A[i, j]
        square += r * r
        size += terms * terms
    return np.sqrt(square), np.sqrt(size)


@_compiled
def _solve_level(A, b, scale, tolerance, Q, kept, lower, upper, x, state, held, most, bounded):
    """Minimize |A x - b| with Q x as it is and x within its bounds, from an x that is.

    Bounds that clearly hold this level back are `held` from then on. Returns the steps taken,
    whether the least residual was reached, and the gap of the rank decisions.
    """
    k, n = A.shape
    free, g = np.empty(n, np.int64), np.empty(n)
    beta_Q, beta, order = np.empty(n), np.empty(n), np.empty(kept + k, np.int64)
    idle, gap = 0, np.inf
    for taken in range(1, most + 1):
        f = 0
        for j in range(n):
            if state[j] == FREE and not held[j]:
                free[f] = j
                f += 1
        B = np.empty((kept + k, f))
        for i in range(kept + k):
            order[i] = i
            for t in range(f):
                B[i, t] = Q[i, free[t]] if i < kept else A[i - kept, free[t]]
        V_Q, V = np.empty((min(kept, f), f)), np.empty((min(k, f), f))
        r_Q, gap = _reduce_rows(B, 0, kept, 0, beta_Q, V_Q, order, 1e-10, np.inf)
        q, gap = _reduce_rows(B, kept, kept + k, r_Q, beta, V, order, tolerance * scale, gap)

        step, r = np.zeros(f), np.empty(k)
        for i in range(k if q > 0 else 0):
            row = order[kept + i] - kept
            r[i] = b[row]
            for j in range(n):
                r[i] -= A[row, j] * x[j]
        _least_squares(B[kept:, r_Q : r_Q + q], r)
        for t in range(q):
            step[r_Q + t] = r[t]
        _reflect(step, beta, V, q, r_Q, True)
        _reflect(step, beta_Q, V_Q, r_Q, 0, True)

        length, blocked, moved = 1.0, -1, False
        for t in range(f if bounded else 0):
            j, room = free[t], np.inf
            if step[t] > 0.0:
                room = (upper[j] - x[j]) / step[t]
            elif step[t] < 0.0:
                room = (lower[j] - x[j]) / step[t]
            if room < length:
                length, blocked = room, t
        for t in range(f):
            j = free[t]
            before = x[j]
            x[j] += length * step[t]
            if bounded:
                x[j] = min(max(x[j], lower[j]), upper[j])
            moved = moved or x[j] != before
        idle = 0 if moved else idle + 1
        if blocked >= 0:
            j = free[blocked]
            state[j] = AT_UPPER if step[blocked] > 0.0 else AT_LOWER
            x[j] = upper[j] if state[j] == AT_UPPER else lower[j]
            continue
        residual, terms = _gradient(A, b, x, g)
        if not bounded or not residual > _ROUND_OFF * terms:
            return taken, True, gap

        # The optimum among the free. Multipliers of the bounds: the gradient less that of Q x.
        for t in range(f):
            step[t] = g[free[t]]
        _reflect(step, beta_Q, V_Q, r_Q, 0, False)
        for t in range(r_Q - 1, -1, -1):
            for s in range(t + 1, r_Q):
                step[t] -= B[s, t] * step[s]
            step[t] /= B[t, t]
            for j in range(n):
                g[j] -= step[t] * Q[order[t], j]
        round_off, worst, chosen = _ROUND_OFF * scale * terms, 0.0, -1
        for j in range(n):
            if not held[j] and state[j] * g[j] > max(round_off, worst):
                chosen, worst = j, state[j] * g[j]
                if idle > _DEGENERATE:
                    break
        if chosen < 0:
            clear = max(round_off, _CLEAR * scale * residual)
            for j in range(n):
                held[j] = held[j] or (state[j] != FREE and abs(g[j]) > clear)
            return taken, True, gap
        state[chosen] = FREE
    return most, False, gap


@_compiled
def _solve_levels(A, b, ends, scales, tolerance, lower, upper, x, state, most, bounded):
    """Every level in turn; the steps taken, whether all came to an end, and the smallest gap."""
    n = len(x)
    Q, held, kept, first, steps = np.empty((n, n)), np.empty(n, np.bool_), 0, 0, 0
    free, gap = 0, np.inf
    for j in range(n):
        held[j] = lower[j] == upper[j]
    for k in range(len(ends)):
        rows, target = A[first : ends[k]], b[first : ends[k]]
        first = ends[k]
        if len(rows) == 0:
            continue
        taken, ended, decided = _solve_level(
            rows, target, scales[k], tolerance, Q, kept, lower, upper, x, state, held,
            most - steps, bounded,
        )  # fmt: skip
        steps, gap = steps + taken, min(gap, decided)
        if not ended:
            return steps, False, gap
        if k + 1 < len(ends):
            kept = _orthonormal(Q, kept, rows, held, tolerance * scales[k])
            free = 0
            for j in range(n):
                free += not held[j]
            if kept >= free:
                break
    return steps, True, gap


@_compiled
def solve(A, b, ends, scales, tolerance, lower, upper, x, state, start, most):
    """Solve |A_k x - b_k| least, level by level, within lower <= x <= upper.

    Args:
        A: Rows of all levels, one after the other, (k, n).
        b: Shape (k,).
        ends: Where each level ends in A.
        scales: Size of the matrices that each level's rows were made from.
        tolerance: Fraction of the scale below which a row is dependent on others.
        lower: Shape (n,), as are the next three.
        upper: At least `lower`.
        x: The start if not COLD; overwritten with the solution.
        state: AT_LOWER, FREE or AT_UPPER; the start if WARM; overwritten.
        start: COLD, FROM_OPTIMUM or WARM.
        most: Steps of the active set at most.

    Returns:
        Steps taken, whether every level came to an end within them, and the smallest gap of the
        rank decisions.
    """
    n = len(x)
    if start == COLD:
        for j in range(n):
            x[j] = lower[j] if lower[j] == upper[j] else 0.0
    if start != WARM:
        for j in range(n):
            state[j] = FREE
    gap = np.inf
    if start == COLD:
        _, _, gap = _solve_levels(
            A, b, ends, scales, tolerance, lower, upper, x, state, len(ends), False
        )
    inside = True
    for j in range(n):
        if x[j] < lower[j] or (x[j] == lower[j] and lower[j] == upper[j]):
            x[j], state[j] = lower[j], AT_LOWER
        elif x[j] > upper[j]:
            x[j], state[j] = upper[j], AT_UPPER
        elif state[j] == AT_LOWER:
            x[j] = lower[j]
        elif state[j] == AT_UPPER:
            x[j] = upper[j]
        inside = inside and (state[j] == FREE or lower[j] == upper[j])
    if inside and start != WARM:
        return 0, True, gap
    return _solve_levels(A, b, ends, scales, tolerance, lower, upper, x, state, most, True)


@_compiled
def solve_each(
    A, b, ends, scales, tolerance, lower, upper, x, state, start, most, steps, ended, gap
):
    """Solve a batch of problems of one shape, the batch axis first; the same as one after another.

    Steps, whether it came to an end, and the gap of each problem are written to the last three.
    """
    for k in range(len(x)):
        steps[k], ended[k], gap[k] = solve(
            A[k], b[k], ends, scales[k], tolerance, lower[k % len(lower)], upper[k % len(upper)],
            x[k], state[k], start, most,
        )  # fmt: skip
