"""Lexicographic least squares under bounds, compiled: a primal active-set method, level by level.

All compiled code of one entry point stands in one file, because the compiler's cache notices a
change of that file alone.
"""

from typing import NamedTuple

import numpy as np
from numba import njit, types
from numpy.typing import NDArray

from argument_checks import Array
from argument_checks.compilation import kernel
from argument_checks.ties import ACCURACY

AT_LOWER, FREE, AT_UPPER = -1, 0, 1
COLD, FROM_OPTIMUM, WARM = 0, 1, 2
"""What the solver starts from: nothing, the optimum without bounds, an earlier solution."""

_ROUND_OFF = 1e-14
"""Steps and residuals below this fraction of what they are computed from may be round-off."""
_CLEAR = 1e-9
"""Multipliers above this fraction show that a bound holds a level back."""
_DEPENDENT = 1e-10
"""Orthonormal rows in the free unknowns that are shorter than this depend on the others."""
_CANCELLED = 1e-3
"""Where this fraction of an unknown is left, round-off of what it was asks for another pass."""
_PASSES = 3
_NOTHING = 1e-15
"""What is left below this fraction, of unknowns and of multipliers, is round-off alone."""
_TINY = 1e-150
"""Rows shorter than this depend on others at any scale: their squares underflow."""
_EQUAL = 1.0 + ACCURACY
"""Of numbers that differ by less than this factor the first is taken, on every processor."""
_DEGENERATE = 3
"""After as many steps of zero length the first candidate is taken, not the best: no cycling."""

_compiled = njit(error_model="numpy")
at = np.uint64
"""An index that cannot be negative: the compiler then leaves out Python's counting from the end."""


class _Work(NamedTuple):
    """Arrays that every step overwrites; R is the number of rows of the largest level and n."""

    B: Array  # the rows in the free unknowns, (R, n)
    V_Q: Array  # reflections of Q's rows, (n, n)
    V: Array  # and of the level's
    beta_Q: Array  # (n,)
    beta: Array
    order: NDArray[np.int64]  # of B's rows, (R,)
    free: NDArray[np.int64]  # unknowns, (n,)
    step: Array  # (n,)
    size: Array  # of the unknowns before and after the last step, (n,)
    r: Array  # (R,)
    g: Array  # (n,)


@_compiled
def _square(M, i, first, last):
    """Sum of the squares of a part of a row."""
    square = 0.0
    for j in range(first, last):
        square += M[at(i), at(j)] * M[at(i), at(j)]
    return square


@_compiled
def _largest(M, first, last, start, columns):
    """The row with the largest norm from column `start` on, and that norm."""
    best, most, i = first, -1.0, first
    while i < last:
        if i + 4 <= last:  # four sums at once: each waits for its own last term alone
            a, b, c, d = 0.0, 0.0, 0.0, 0.0
            for j in range(start, columns):
                a += M[at(i), at(j)] * M[at(i), at(j)]
                b += M[at(i + 1), at(j)] * M[at(i + 1), at(j)]
                c += M[at(i + 2), at(j)] * M[at(i + 2), at(j)]
                d += M[at(i + 3), at(j)] * M[at(i + 3), at(j)]
            squares = (a, b, c, d)
            for k in range(4):
                if squares[k] > most * _EQUAL:
                    best, most = i + k, squares[k]
            i += 4
        else:
            square = _square(M, i, start, columns)
            if square > most * _EQUAL:
                best, most = i, square
            i += 1
    return best, np.sqrt(most)


@_compiled
def _remove_from(v, factor, B, first, last, start, columns):
    """Take factor (v . row) v from each of some rows of B, from column `start` on."""
    i = first
    while i < last:
        if i + 4 <= last:  # as above
            a, b, c, d = 0.0, 0.0, 0.0, 0.0
            for j in range(start, columns):
                a += v[at(j)] * B[at(i), at(j)]
                b += v[at(j)] * B[at(i + 1), at(j)]
                c += v[at(j)] * B[at(i + 2), at(j)]
                d += v[at(j)] * B[at(i + 3), at(j)]
            a, b, c, d = a * factor, b * factor, c * factor, d * factor
            for j in range(start, columns):
                B[at(i), at(j)] -= a * v[at(j)]
                B[at(i + 1), at(j)] -= b * v[at(j)]
                B[at(i + 2), at(j)] -= c * v[at(j)]
                B[at(i + 3), at(j)] -= d * v[at(j)]
            i += 4
        else:
            dot = 0.0
            for j in range(start, columns):
                dot += v[at(j)] * B[at(i), at(j)]
            dot *= factor
            for j in range(start, columns):
                B[at(i), at(j)] -= dot * v[at(j)]
            i += 1


@_compiled
def _reduce_rows(B, first, last, rows, column, columns, beta, V, order, threshold, gap):
    """Reduce rows first..last of B to lower triangles by reflections from the right.

    The row with the largest remainder is next. Those up to `rows` are reflected too. Returns the
    rank, and the smallest gap of its decisions.
    """
    rank = 0
    while first + rank < last and column + rank < columns:
        t, c = first + rank, column + rank
        best, norm = _largest(B, t, last, c, columns)
        if not norm > threshold:
            if norm > 0.0:
                gap = min(gap, threshold / norm)
            break
        gap = min(gap, norm / threshold)
        if best != t:
            for j in range(columns):
                B[at(t), at(j)], B[at(best), at(j)] = B[at(best), at(j)], B[at(t), at(j)]
            order[at(t)], order[at(best)] = order[at(best)], order[at(t)]
        diagonal = -norm if B[at(t), at(c)] >= 0.0 else norm
        for j in range(c, columns):
            V[at(rank), at(j)] = B[at(t), at(j)]
            B[at(t), at(j)] = 0.0
        V[at(rank), at(c)] -= diagonal
        B[at(t), at(c)] = diagonal
        beta[at(rank)] = 1.0 / (norm * abs(V[at(rank), at(c)]))
        _remove_from(V[rank], beta[at(rank)], B, t + 1, rows, c, columns)
        rank += 1
    return rank, gap


@_compiled
def _reflect(x, columns, beta, V, rank, column, backwards):
    """Apply reflections to a vector, in the order in which they were made or backwards."""
    for k in range(rank):
        t = rank - 1 - k if backwards else k
        dot = 0.0
        for j in range(column + t, columns):
            dot += V[at(t), at(j)] * x[at(j)]
        dot *= beta[at(t)]
        for j in range(column + t, columns):
            x[at(j)] -= dot * V[at(t), at(j)]


@_compiled
def _least_squares(B, first, rows, column, q, r):
    """Minimize |L w - r| in place, L the part of B from a row and a column on, of rank q.

    L is lower trapezoidal; w is r[:q].
    """
    k = rows - first
    for c in range(q if k > q else 0):
        square = 0.0
        for i in range(c, k):
            square += B[at(first + i), at(column + c)] * B[at(first + i), at(column + c)]
        norm = np.sqrt(square)
        on = B[at(first + c), at(column + c)]
        diagonal = -norm if on >= 0.0 else norm
        B[at(first + c), at(column + c)] = on - diagonal
        scale = 1.0 / (norm * abs(on - diagonal))
        for j in range(c + 1, q):
            dot = 0.0
            for i in range(c, k):
                dot += B[at(first + i), at(column + c)] * B[at(first + i), at(column + j)]
            dot *= scale
            for i in range(c, k):
                B[at(first + i), at(column + j)] -= dot * B[at(first + i), at(column + c)]
        dot = 0.0
        for i in range(c, k):
            dot += B[at(first + i), at(column + c)] * r[at(i)]
        dot *= scale
        for i in range(c, k):
            r[at(i)] -= dot * B[at(first + i), at(column + c)]
        B[at(first + c), at(column + c)] = diagonal
    for t in range(q):
        # Upper triangle from the last row, or lower from the first.
        c = q - 1 - t if k > q else t
        s = r[at(c)]
        for j in range(c + 1 if k > q else 0, q if k > q else c):
            s -= B[at(first + c), at(column + j)] * r[at(j)]
        r[at(c)] = s / B[at(first + c), at(column + c)]


@_compiled
def _orthonormal(Q, kept, A, first, last, held, threshold, M):
    """Orthonormal rows that span those of Q and a level's on what is not held; their number."""
    n, rows = Q.shape[1], kept + last - first
    for i in range(rows):
        for j in range(n):
            value = Q[at(i), at(j)] if i < kept else A[at(first + i - kept), at(j)]
            M[at(i), at(j)] = 0.0 if held[at(j)] else value
    rank, start = 0, 0
    for end, least in ((kept, _DEPENDENT), (rows, threshold)):
        # Rows of Q before those of A, which are then free of them.
        while start < end and rank < n:
            best, norm = _largest(M, start, end, 0, n)
            if not norm > least:
                break
            for j in range(n):
                M[at(start), at(j)], M[at(best), at(j)] = M[at(best), at(j)], M[at(start), at(j)]
            for t in range(rank):  # once more, against cancellation
                _remove_from(Q[t], 1.0, M, start, start + 1, 0, n)
            norm = np.sqrt(_square(M, start, 0, n))
            if norm > least:
                for j in range(n):
                    Q[at(rank), at(j)] = M[at(start), at(j)] / norm
                _remove_from(Q[rank], 1.0, M, start + 1, rows, 0, n)
                rank += 1
            start += 1
        start = end
    return rank


@_compiled
def _lacking(A, b, first, order, x, r):
    """Write b - A x to r, in this order of the rows; the norm of what it is computed from."""
    size = 0.0
    for i in range(len(order)):
        row = order[at(i)] + first
        rest, terms = b[at(row)], abs(b[at(row)])
        for j in range(len(x)):
            part = A[at(row), at(j)] * x[at(j)]
            rest -= part
            terms += abs(part)
        r[at(i)] = rest
        size += terms * terms
    return np.sqrt(size)


@_compiled
def _moved(A, first, last, free, f, step):
    """The norm of A times a step of the free unknowns."""
    square = 0.0
    for i in range(first, last):
        change = 0.0
        for t in range(f):
            change += A[at(i), at(free[at(t)])] * step[at(t)]
        square += change * change
    return np.sqrt(square)


@_compiled
def _gradient(A, b, first, last, x, size, g):
    """Gradient A^T (A x - b), and the norm of the residual beside what it is computed from."""
    n = len(x)
    square, total = 0.0, 0.0
    for j in range(n):
        g[at(j)] = 0.0
    for i in range(first, last):
        r, terms = -b[at(i)], abs(b[at(i)])
        for j in range(n):
            r += A[at(i), at(j)] * x[at(j)]
            terms += abs(A[at(i), at(j)]) * size[at(j)]
        for j in range(n):
            g[at(j)] += r * A[at(i), at(j)]
        square += r * r
        total += terms * terms
    return np.sqrt(square), np.sqrt(total)


@_compiled
def _solve_level(
    A, b, first, last, scale, threshold, Q, kept, lower, upper, x, state, held, work, most, bounded
):
    """Minimize |A x - b| with Q x as it is and x within its bounds, from an x that is.

    Bounds that clearly hold this level back are `held` from then on. Returns the steps taken,
    whether the least residual was reached, how many dimensions it leaves to what is free, and the
    gap of the rank decisions.
    """
    B, V_Q, V, beta_Q, beta, order, free, step, size, r, g = work
    k, n, idle, gap, left = last - first, len(x), 0, np.inf, 0
    rows = kept + k
    for taken in range(1, most + 1):
        f = 0
        for j in range(n):
            if state[at(j)] == FREE and not held[at(j)]:
                free[at(f)] = j
                f += 1
        for i in range(rows):
            order[at(i)] = i
            for t in range(f):
                j = free[at(t)]
                B[at(i), at(t)] = Q[at(i), at(j)] if i < kept else A[at(first + i - kept), at(j)]
        r_Q, gap = _reduce_rows(B, 0, kept, rows, 0, f, beta_Q, V_Q, order, _DEPENDENT, np.inf)
        q, gap = _reduce_rows(B, kept, rows, rows, r_Q, f, beta, V, order, threshold, gap)

        left = f - r_Q - q
        for t in range(f):
            step[at(t)] = 0.0
        terms = 0.0
        if q > 0:
            for i in range(kept, rows):
                order[at(i)] -= kept
            terms = _lacking(A, b, first, order[kept:rows], x, r)
        _least_squares(B, kept, rows, r_Q, q, r)
        for t in range(q):
            step[at(r_Q + t)] = r[at(t)]
        _reflect(step, f, beta, V, q, r_Q, True)
        _reflect(step, f, beta_Q, V_Q, r_Q, 0, True)

        length, blocked, most_step = 1.0, -1, 0.0
        if bounded and not _moved(A, first, last, free, f, step) > _ROUND_OFF * terms:
            length = 0.0  # it would be blocked in directions that mean nothing
        for t in range(f):
            most_step = max(most_step, abs(step[at(t)]))
        for t in range(f if bounded and length > 0.0 else 0):
            j, room = free[at(t)], np.inf
            if step[at(t)] > _ROUND_OFF * most_step:
                room = (upper[at(j)] - x[at(j)]) / step[at(t)]
            elif step[at(t)] < -_ROUND_OFF * most_step:
                room = (lower[at(j)] - x[at(j)]) / step[at(t)]
            if room < length:
                length, blocked = room, t
        for j in range(n):
            size[at(j)] = abs(x[at(j)])
        for t in range(f if length > 0.0 else 0):
            j = free[at(t)]
            x[at(j)] += length * step[at(t)]
            if abs(x[at(j)]) < _NOTHING * size[at(j)]:
                x[at(j)] = 0.0
            if bounded:
                x[at(j)] = min(max(x[at(j)], lower[at(j)]), upper[at(j)])
            size[at(j)] = max(size[at(j)], abs(x[at(j)]))
        idle = 0 if length > _ROUND_OFF else idle + 1
        if blocked >= 0:
            j = free[at(blocked)]
            state[at(j)] = AT_UPPER if step[at(blocked)] > 0.0 else AT_LOWER
            x[at(j)] = upper[at(j)] if state[at(j)] == AT_UPPER else lower[at(j)]
            continue
        if not bounded:
            return taken, True, left, gap
        residual, terms = _gradient(A, b, first, last, x, size, g)
        if not residual > _ROUND_OFF * terms:
            return taken, True, left, gap

        # The optimum among the free. Multipliers of the bounds: the gradient less that of Q x.
        for t in range(f):
            step[at(t)] = g[at(free[at(t)])]
        _reflect(step, f, beta_Q, V_Q, r_Q, 0, False)
        for t in range(r_Q - 1, -1, -1):
            for s in range(t + 1, r_Q):
                step[at(t)] -= B[at(s), at(t)] * step[at(s)]
            step[at(t)] /= B[at(t), at(t)]
            for j in range(n):
                g[at(j)] -= step[at(t)] * Q[at(order[at(t)]), at(j)]
        round_off, worst, chosen = _NOTHING * scale * terms, 0.0, -1
        for j in range(n):
            if not held[at(j)] and state[at(j)] * g[at(j)] > max(round_off, worst * _EQUAL):
                chosen, worst = j, state[at(j)] * g[at(j)]
                if idle > _DEGENERATE:
                    break
        if chosen < 0:
            clear = scale * max(_ROUND_OFF * terms, _CLEAR * residual)
            for j in range(n):
                held[at(j)] = held[at(j)] or state[at(j)] * g[at(j)] < -clear
            return taken, True, left, gap
        state[at(chosen)] = FREE
    return most, False, left, gap


@_compiled
def _solve_levels(A, b, ends, scales, tolerance, lower, upper, x, state, most, bounded):
    """Every level in turn; the steps taken, whether all came to an end, and the smallest gap."""
    n, most_rows, first = len(x), 0, 0
    for k in range(len(ends)):
        most_rows = max(most_rows, ends[k] - first)
        first = ends[k]
    R = most_rows + n
    work = _Work(
        np.empty((R, n)), np.empty((n, n)), np.empty((n, n)), np.empty(n), np.empty(n),
        np.empty(R, np.int64), np.empty(n, np.int64), np.empty(n), np.empty(n), np.empty(R),
        np.empty(n),
    )  # fmt: skip
    Q, held, kept, first, steps = np.empty((n, n)), np.empty(n, np.bool_), 0, 0, 0
    gap = np.inf
    for j in range(n):
        held[j] = lower[j] == upper[j]
    for k in range(len(ends)):
        if ends[k] == first:
            continue
        threshold = max(tolerance * scales[k], _TINY)
        taken, ended, left, decided = _solve_level(
            A, b, first, ends[k], scales[k], threshold, Q, kept, lower, upper, x, state, held,
            work, most - steps, bounded,
        )  # fmt: skip
        steps, gap = steps + taken, min(gap, decided)
        if not ended:
            return steps, False, gap
        for j in range(n):
            left += state[j] != FREE and not held[j]
        if left == 0 or k + 1 == len(ends):
            break
        kept = _orthonormal(Q, kept, A, first, ends[k], held, threshold, work.B)
        free = 0
        for j in range(n):
            free += not held[j]
        if kept >= free:
            break
        first = ends[k]
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
        if lower[j] == upper[j] or x[j] < lower[j]:
            inside = inside and x[j] == lower[j]
            x[j], state[j] = lower[j], AT_LOWER
        elif x[j] > upper[j]:
            inside = False
            x[j], state[j] = upper[j], AT_UPPER
        elif state[j] == AT_LOWER:
            x[j] = lower[j]
        elif state[j] == AT_UPPER:
            x[j] = upper[j]
    if inside and start != WARM:
        return 0, True, gap
    steps, ended, size = 0, False, np.empty(n)
    for _ in range(_PASSES):
        for j in range(n):
            size[j] = abs(x[j])
        taken, ended, gap = _solve_levels(
            A, b, ends, scales, tolerance, lower, upper, x, state, most - steps, True
        )
        steps += taken
        cancelled = False
        for j in range(n):
            cancelled = cancelled or (state[j] == FREE and abs(x[j]) < _CANCELLED * size[j])
        if not (ended and cancelled):
            break
    return steps, ended, gap


def _array(dtype, k, readonly=False):
    return types.Array(dtype, k, "C", readonly=readonly)


@kernel(
    types.void(
        _array(types.float64, 3, True), _array(types.float64, 2, True),
        _array(types.int64, 1, True), _array(types.float64, 2, True), types.float64,
        _array(types.float64, 2, True), _array(types.float64, 2, True),
        _array(types.float64, 2), _array(types.int8, 2), types.int64, types.int64,
        _array(types.int64, 1), _array(types.boolean, 1), _array(types.float64, 1),
    ),
)  # fmt: skip
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
