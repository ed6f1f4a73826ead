"""Problem 1 and levels of least squares, compiled, where all ranks are clearly full.

`factor` decides that by Householder reflections, once for a J and its weights; `apply` is for one
target, `apply_within` for one within limits, and `levels_within` for levels of any rows. A batch is
one problem after another. All numbers of a problem stand in one array F, because views of it would
take longer than the arithmetic. All compiled code stands in one file, because the compiler's cache
notices a change of that file alone.
"""

from typing import NamedTuple

import numpy as np
from numba import njit, types

from argument_checks.compilation import kernel

CLEAR, IN_DOUBT, REFUSED = 0, 1, 2
"""Ranks are clearly full; the SVD must decide; a number is not finite, or a shape is wrong."""

_LARGEST = 1e240
"""Sum of the squares of numbers that the argument checks let pass."""
_MODERATE = 1e100
"""Sum of squares up to which, and from the inverse of which on, no product over- or underflows."""
SPREAD = 1e4
"""Ratio of joint weights up to which rates are scaled by them without loss of digits."""
_ROUND_OFF = 1e-14
"""Part of the unknowns by which one may be beyond its limit before it is put on it."""
_DEPENDENT = 1e-12
"""Part of a limit's row that is round-off where the row depends on those of other limits."""
_REGULAR = 1e-6
"""Part of the scale, also the sine of an angle, above which any way finds nine digits."""
_CANCELLED = 1e-3
"""Where this fraction of an unknown is left, it has lost digits on its way."""
_MISSED = 1e-12
"""Part of a row's terms that round-off leaves of unknowns of one kind."""
_STEPS = 6
"""Of the active set for each unknown; where there are more, another method decides."""

_any = {k: types.Array(types.float64, k, "A", readonly=True) for k in (1, 2, 3)}
_new = {k: types.Array(types.float64, k, "C") for k in (1, 2, 3)}
_int, _float = types.int64, types.float64
_state = types.Array(types.int8, 1, "C")
_limits = types.Array(types.float64, 2, "C", readonly=True)
_ends = types.Array(types.int64, 1, "C", readonly=True)
_inlined = njit(error_model="numpy")
at = np.uint64
"""An index that cannot be negative: the compiler then leaves out Python's counting from the end."""


def _compiled(*arguments):
    """Compiled when this module is first imported, then read from the cache."""
    return kernel(_int(*arguments))


class Sizes(NamedTuple):
    """Of a problem.

    Attributes:
        p: Major directions.
        m: Task rows.
        n: Rates.
        k1: Rows of W1.
        k2: Rows of W2.
        m2: Secondary directions.
    """

    p: int
    m: int
    n: int
    k1: int
    k2: int
    m2: int


class _Parts(NamedTuple):
    """Where the parts of F begin; F[0] is 1 where rates are scaled by their weights."""

    S: int  # S_m, (p, m)
    G: int  # W2 S_s, (k2, m)
    w: int  # inverse joint weights, or ones, (n,)
    W1: int  # (k1, n)
    W2: int  # (k2, m2)
    J: int  # (m, n)
    W: int  # rows, reduced by reflections from the right
    M: int  # what they leave free, reduced by reflections from the left
    W_diagonal: int  # (n,), as are the next three
    W_beta: int
    M_diagonal: int
    M_beta: int
    v: int  # (p,)
    rates_d: int  # (n,)
    v_sd: int  # (m2,)
    c: int  # right side of M
    x: int  # (n,)
    most: int  # |L^-1|^2 of limits' rows up to which ranks are clear where these hold
    end: int


@_inlined
def _parts(z):
    W1 = 1 + z.p * z.m + z.k2 * z.m + z.n
    J = W1 + z.k1 * z.n + z.k2 * z.m2
    W = J + z.m * z.n
    M = W + (z.p + z.k1 + z.k2) * z.n
    last = M + (z.n + z.k1 + z.k2) * z.n
    v = last + 4 * z.n
    c = v + z.p + z.n + z.m2
    x = c + z.n + z.k1 + z.k2
    return _Parts(
        1, 1 + z.p * z.m, W1 - z.n, W1, W1 + z.k1 * z.n, J, W, M,
        last, last + z.n, last + 2 * z.n, last + 3 * z.n,
        v, v + z.p, v + z.p + z.n, c, x, x + z.n, x + z.n + 1,
    )  # fmt: skip


@_inlined
def _square(F, first, count):
    """Sum of the squares of some numbers."""
    total = 0.0
    for i in range(first, first + count):
        total += F[at(i)] * F[at(i)]
    return total


@_inlined
def _reflect_one(F, own, beta, x, first, n):
    """Apply the reflection that begins at `own`, from column `first` on, to n numbers at x."""
    dot = 0.0
    for j in range(first, n):
        dot += F[at(own + j)] * F[at(x + j)]
    dot *= F[at(beta)]
    for j in range(first, n):
        F[at(x + j)] -= dot * F[at(own + j)]


@_inlined
def _reduce_rows(F, W, rows, n, count, diagonal, beta):
    """Reduce the first rows of W to a lower triangle by reflections from the right.

    A reflection stands in its row from the diagonal on; the diagonal itself in `diagonal`.
    """
    for i in range(count):
        own = W + i * n
        norm = np.sqrt(_square(F, own + i, n - i))
        first = np.copysign(norm, F[at(own + i)])
        F[at(own + i)] += first
        F[at(diagonal + i)] = -first
        F[at(beta + i)] = 1.0 / (norm * abs(F[at(own + i)])) if norm > 0.0 else 0.0
        for r in range(i + 1, rows):
            _reflect_one(F, own, beta + i, W + r * n, i, n)


@_inlined
def _reflect(F, W, n, count, beta, x, backwards):
    """Apply these reflections to a vector."""
    for k in range(count):
        i = count - 1 - k if backwards else k
        _reflect_one(F, W + i * n, beta + i, x, i, n)


@_inlined
def _reduce_columns(F, M, k, q, below, diagonal, beta):
    """Reduce M (k, q) to an upper triangle by reflections from the left, stored likewise.

    Of each column only the diagonal and the rows from `below` on are not zero yet.
    """
    for c in range(q):
        start, on = max(c + 1, below), M + c * q + c
        square = F[at(on)] * F[at(on)]
        for r in range(start, k):
            square += F[at(M + r * q + c)] * F[at(M + r * q + c)]
        norm = np.sqrt(square)
        first = np.copysign(norm, F[at(on)])
        F[at(on)] += first
        F[at(diagonal + c)] = -first
        F[at(beta + c)] = 1.0 / (norm * abs(F[at(on)])) if norm > 0.0 else 0.0
        for j in range(c + 1, q):
            dot = F[at(on)] * F[at(M + c * q + j)]
            for r in range(start, k):
                dot += F[at(M + r * q + c)] * F[at(M + r * q + j)]
            dot *= F[at(beta + c)]
            F[at(M + c * q + j)] -= dot * F[at(on)]
            for r in range(start, k):
                F[at(M + r * q + j)] -= dot * F[at(M + r * q + c)]


@_inlined
def _least_squares(F, M, k, q, below, diagonal, beta, c):
    """Minimize |M z - c| by the factors of M; z is then the first part of c."""
    for j in range(q):
        start, on = max(j + 1, below), M + j * q + j
        dot = F[at(on)] * F[at(c + j)]
        for r in range(start, k):
            dot += F[at(M + r * q + j)] * F[at(c + r)]
        dot *= F[at(beta + j)]
        F[at(c + j)] -= dot * F[at(on)]
        for r in range(start, k):
            F[at(c + r)] -= dot * F[at(M + r * q + j)]
    for i in range(q - 1, -1, -1):
        z = F[at(c + i)]
        for j in range(i + 1, q):
            z -= F[at(M + i * q + j)] * F[at(c + j)]
        F[at(c + i)] = z / F[at(diagonal + i)]


@_inlined
def _inverse_square(F, T, columns, size, diagonal, is_upper, column):
    """Squared Frobenius norm of the inverse of a triangle: not finite if that is singular."""
    total = 0.0
    for k in range(size):  # a column of the inverse, of T^T for an upper triangle
        for i in range(k, size):
            s = 1.0 if i == k else 0.0
            for j in range(k, i):
                s -= (
                    F[at(T + (j * columns + i if is_upper else i * columns + j))]
                    * F[at(column + j)]
                )
            F[at(column + i)] = s / F[at(diagonal + i)]
            total += F[at(column + i)] * F[at(column + i)]
    return total


@_inlined
def _shape(F, z):
    """Rows of W, how many of them are reflected, and rows and columns of M."""
    if F[0] == 1.0:
        # All rows of the task where that leaves fewer unknowns, else those of the major task.
        count = z.p + z.k2 if z.p + z.k2 < z.n else z.p
        q = z.k2 if count > z.p else z.n - z.p
        return z.p + z.k2, count, q + z.k2, q
    return z.p + z.k1 + z.k2, z.p, z.k1 + z.k2, z.n - z.p


@_inlined
def _factor(F, z, is_diagonal, size_1, size_2, scale, clear, exact):
    """Whether the ranks are clearly full; F is given S, G, W1, W2 and J, and gets the rest."""
    a = _parts(z)
    size_J = _square(F, a.J, z.m * z.n)
    if not size_J + size_1 + size_2 < _LARGEST:
        return REFUSED
    for size in (size_J, size_1, size_2):
        if size > _MODERATE or 0.0 < size < 1.0 / _MODERATE:
            return IN_DOUBT
    scale = np.sqrt(size_J) if scale < 0.0 else scale
    if not (0 < z.p <= z.n <= z.p + z.k1 + z.k2 and z.k1 + z.k2 > 0 and scale > 0.0):
        return IN_DOUBT
    least, most = np.inf, 0.0
    for j in range(z.n):
        on = a.W1 + j * z.n + j
        F[at(a.w + j)] = 1.0
        if is_diagonal:
            least, most = min(least, abs(F[at(on)])), max(most, abs(F[at(on)]))
    scaled = is_diagonal and least * SPREAD > most
    F[0] = 1.0 if scaled else 0.0
    for j in range(z.n if scaled else 0):
        F[at(a.w + j)] = 1.0 / F[at(a.W1 + j * z.n + j)]
    rows, count, k, q = _shape(F, z)
    for i in range(z.p + z.k2):
        row = a.W + (i if i < z.p else rows - z.k2 + i - z.p) * z.n
        for j in range(z.n):
            F[at(row + j)] = 0.0
        for t in range(z.m):
            s = F[at(a.S + i * z.m + t)]  # then G, which comes next
            if s != 0.0:
                for j in range(z.n):
                    F[at(row + j)] += s * F[at(a.J + t * z.n + j)]
        for j in range(z.n if scaled else 0):
            F[at(row + j)] *= F[at(a.w + j)]
    for i in range(0 if scaled else z.k1 * z.n):
        F[at(a.W + z.p * z.n + i)] = F[at(a.W1 + i)]
    _reduce_rows(F, a.W, rows, z.n, count, a.W_diagonal, a.W_beta)
    # In rates times weights the joint weights are the identity, before and after reflections.
    for i in range(k):
        task = i - q if scaled else i
        for j in range(q):
            value = F[at(a.W + (z.p + task) * z.n + z.p + j)] if task >= 0 else 0.0
            if task < 0:
                value = 1.0 if i == j else 0.0
            elif count > z.p and j >= task:
                value = F[at(a.W_diagonal + z.p + j)] if j == task else 0.0
            F[at(a.M + i * q + j)] = value
    _reduce_columns(F, a.M, k, q, q if scaled else 0, a.M_diagonal, a.M_beta)

    least_A = clear * np.sqrt(_square(F, a.S, z.p * z.m)) * scale
    least_M = clear * np.sqrt(size_1 * exact * exact + size_2 * scale * scale)
    inverse_A = _inverse_square(F, a.W, z.n, z.p, a.W_diagonal, False, a.c)
    if scaled:
        # The least singular value of J_m is at least that of J_m / w times the least weight.
        doubt_A, doubt_M = inverse_A * (least_A / least) ** 2, (least_M / least) ** 2
        inverse_M = 1.0
    else:
        inverse_M = _inverse_square(F, a.M, q, q, a.M_diagonal, True, a.c)
        doubt_A, doubt_M = inverse_A * least_A**2, inverse_M * least_M**2
    F[at(a.most)] = _most(doubt_A * max(1.0, _REGULAR / clear) ** 2, inverse_M)
    return CLEAR if doubt_A < 1.0 and doubt_M < 1.0 else IN_DOUBT


@_inlined
def _most(doubt, inverse):
    """Square of |L^-1|, L C's rows of limits, up to which no rank is in doubt where these hold.

    Of unknowns that are zero, rows of least singular value s keep s sin(phi) at least, phi the
    angle between them and these unknowns; and sin(phi) is no less than 1 / (|L^-1| |R^-1|), R the
    factor of the objective.

    Args:
        doubt: Largest square of what is in doubt over s, of all rows that must be met.
        inverse: |R^-1|^2 at most.
    """
    return min(1.0 / doubt, 1.0 / _REGULAR**2) / inverse


@_inlined
def _apply(F, z):
    """The optimal rates of F's target, written to F."""
    a = _parts(z)
    scaled = F[0] == 1.0
    _, count, k, q = _shape(F, z)
    above = k - z.k2
    for j in range(z.n):
        F[at(a.x + j)] = F[at(a.rates_d + j)] / F[at(a.w + j)]
    if scaled:
        _reflect(F, a.W, z.n, count, a.W_beta, a.x, False)
    for i in range(above):
        s = F[at(a.x + z.p + i)] if scaled else 0.0
        for j in range(0 if scaled else z.n):
            s += F[at(a.W1 + i * z.n + j)] * F[at(a.rates_d + j)]
        F[at(a.c + i)] = s
    for i in range(z.k2):
        s = 0.0
        for t in range(z.m2):
            s += F[at(a.W2 + i * z.m2 + t)] * F[at(a.v_sd + t)]
        F[at(a.c + above + i)] = s
    for i in range(z.p):
        s = F[at(a.v + i)]
        for j in range(i):
            s -= F[at(a.W + i * z.n + j)] * F[at(a.x + j)]
        F[at(a.x + i)] = s / F[at(a.W_diagonal + i)]
    first = above if scaled else 0
    for i in range(first, k):
        for j in range(z.p):
            F[at(a.c + i)] -= F[at(a.W + (z.p + i - first) * z.n + j)] * F[at(a.x + j)]
    _least_squares(F, a.M, k, q, q if scaled else 0, a.M_diagonal, a.M_beta, a.c)
    for i in range(q):
        F[at(a.x + z.p + i)] = F[at(a.c + i)]
    _reflect(F, a.W, z.n, count, a.W_beta, a.x, True)
    for j in range(z.n):
        F[at(a.x + j)] *= F[at(a.w + j)]


@_inlined
def _motions(F, W, n, count, W_beta, M, q, M_diagonal, w, x, C):
    """Write to C (n, d) the unknowns that keep the rows which are met; the objective is |y|^2.

    It is so of C y beside the optimum; W's reflections leave the last d free, of which M's triangle
    weighs the first q, and the identity the others. x is room for n numbers.
    """
    d = C.shape[1]
    free = x + n - d
    for j in range(n):
        for i in range(n):
            F[at(x + i)] = F[at(w + j)] if i == j else 0.0
        _reflect(F, W, n, count, W_beta, x, False)
        for i in range(q):
            s = F[at(free + i)]
            for t in range(i):
                s -= F[at(M + t * q + i)] * F[at(free + t)]
            F[at(free + i)] = s / F[at(M_diagonal + i)]
        for i in range(d):
            C[at(j), at(i)] = F[at(free + i)]


@_inlined
def _columns(A):
    """Norms of A's columns."""
    rows, n = A.shape
    norm = np.zeros(n)
    for i in range(rows):
        for j in range(n):
            norm[at(j)] += A[at(i), at(j)] * A[at(i), at(j)]
    for j in range(n):
        norm[at(j)] = np.sqrt(norm[at(j)])
    return norm


@_inlined
def _most_beyond(norm, w, column, lower, upper, most, x, state):
    """The unknown farthest beyond a limit, per size of its row of C, and the side; -1 if none is.

    Limits of the start come before all others. What is beyond by round-off of the largest unknown,
    or of the rows' largest term, is not.
    """
    chosen, side, farthest, is_first, size, term = -1, 0.0, 0.0, False, 0.0, 0.0
    for j in range(len(x)):
        size = max(size, most[at(j)] / w[at(j)])
        term = max(term, most[at(j)] * column[at(j)])
    for j in range(len(x)):
        beyond = max(lower[j] - x[at(j)], x[at(j)] - upper[j])
        if beyond > _ROUND_OFF * (most[at(j)] + min(w[at(j)] * size, term / column[at(j)])):
            towards = 1.0 if lower[j] > x[at(j)] else -1.0
            of_start = state[at(j)] * towards < 0.0
            if (of_start and not is_first) or (
                of_start == is_first and not beyond <= farthest * norm[at(j)]
            ):
                chosen, side, farthest = j, towards, beyond / norm[at(j)]
                is_first = of_start
    return chosen, side


@_inlined
def _add_row(C, new, k, v):
    """Reflect C's columns from k on so that the row of a limit ends there."""
    n, d = C.shape
    square = 0.0
    for i in range(k, d):
        v[at(i)] = C[at(new), at(i)]
        square += v[at(i)] * v[at(i)]
    diagonal = -np.copysign(np.sqrt(square), v[at(k)])
    v[at(k)] -= diagonal
    beta = 1.0 / (np.sqrt(square) * abs(v[at(k)]))
    for j in range(n):
        dot = 0.0
        for i in range(k, d):
            dot += C[at(j), at(i)] * v[at(i)]
        dot *= beta
        for i in range(k, d):
            C[at(j), at(i)] -= dot * v[at(i)]
    for i in range(k, d):
        C[at(new), at(i)] = diagonal if i == k else 0.0


@_inlined
def _drop_row(C, held, u, dropped, k):
    """Rotate C's columns so that the rows of k limits without this one are a triangle again."""
    for a in range(dropped, k):
        u[at(a)] = u[at(a + 1)]
    for a in range(dropped, k - 1):
        held[at(a)] = held[at(a + 1)]
        own = held[at(a)]
        cos, sin = C[at(own), at(a)], C[at(own), at(a + 1)]
        size = np.hypot(cos, sin)
        cos, sin = cos / size, sin / size
        for j in range(len(C)):
            left, right = C[at(j), at(a)], C[at(j), at(a + 1)]
            C[at(j), at(a)] = cos * left + sin * right
            C[at(j), at(a + 1)] = cos * right - sin * left
        C[at(own), at(a + 1)] = 0.0


@_inlined
def _inverse_of_held(C, held, k, w, column):
    """|L^-1|^2 of the rows of limits over weights, whose triangle L stands in C."""
    total = 0.0
    for c in range(k):
        for a in range(c, k):
            own = held[at(a)]
            s = w[at(own)] if a == c else 0.0
            for b in range(c, a):
                s -= C[at(own), at(b)] * column[at(b)]
            column[at(a)] = s / C[at(own), at(a)]
            total += column[at(a)] * column[at(a)]
    return total


@_inlined
def _hold(C, w, column, most_inverse, lower, upper, x, state):
    """Move x by C y, |y| least, to within its limits; the steps taken, or -1 where in doubt.

    A dual active-set method (Goldfarb, Idnani, Math. Programming 27, 1983): k limits hold, whose
    rows of C are kept a lower triangle by orthogonal changes of y, and u are their multipliers.

    Args:
        C: Shape (n, d); overwritten.
        w: Unit of each unknown, (n,).
        column: Norm of each column of the rows that C y leaves, (n,).
        most_inverse: Of :func:`_most`.
        lower: Shape (n,).
        upper: At least `lower`.
        x: What is nearest without limits; overwritten.
        state: Limits to begin with, -1 lower, 1 upper, 0 none; overwritten with those that hold.
    """
    n, d = C.shape
    held, u, r = np.empty(d, np.int64), np.empty(d + 1), np.empty(d)
    norm, most, v, sides, k, steps = np.empty(n), np.empty(n), np.empty(d), np.zeros(n), 0, 0
    for j in range(n):
        square = 0.0
        for i in range(d):
            square += C[at(j), at(i)] * C[at(j), at(i)]
        norm[at(j)], most[at(j)] = np.sqrt(square), abs(x[at(j)])
    while True:
        new, side = _most_beyond(norm, w, column, lower, upper, most, x, state)
        if new < 0:
            break
        limit, u[at(k)], dropped = lower[new] if side > 0.0 else upper[new], 0.0, 0
        while dropped >= 0:
            steps += 1
            square = 0.0
            for i in range(k, d):
                square += C[at(new), at(i)] * C[at(new), at(i)]
            moves, length, dropped = square > (_DEPENDENT * norm[at(new)]) ** 2, np.inf, -1
            if moves:
                length = side * (limit - x[at(new)]) / square
            for a in range(k - 1, -1, -1):
                own, s = held[at(a)], C[at(new), at(a)]
                for b in range(a + 1, k):
                    s -= C[at(held[at(b)]), at(a)] * v[at(b)]
                v[at(a)] = s / C[at(own), at(a)]
                r[at(a)] = side * sides[at(own)] * v[at(a)]
                # What is fixed may be pushed either way.
                if lower[own] < upper[own] and r[at(a)] > 0.0 and u[at(a)] < length * r[at(a)]:
                    length, dropped = u[at(a)] / r[at(a)], a
            if length == np.inf or steps > _STEPS * (n + 1):
                return -1
            for j in range(n if moves else 0):
                dot = 0.0
                for i in range(k, d):
                    dot += C[at(j), at(i)] * C[at(new), at(i)]
                x[at(j)] += length * side * dot
                most[at(j)] = max(most[at(j)], abs(x[at(j)]))
            for a in range(k):
                u[at(a)] -= length * r[at(a)]
            u[at(k)] += length
            if dropped < 0:
                if square < (_REGULAR * norm[at(new)]) ** 2:
                    return -1
                _add_row(C, new, k, v)
                held[at(k)], sides[at(new)], x[at(new)] = new, side, limit
                k += 1
            else:
                sides[at(held[at(dropped)])] = 0.0
                _drop_row(C, held, u, dropped, k)
                k -= 1
    if not _inverse_of_held(C, held, k, w, v) < most_inverse:
        return -1
    for j in range(n):
        if sides[at(j)] == 0.0 and abs(x[at(j)]) < _CANCELLED * most[at(j)]:
            return -1
        state[at(j)] = -sides[at(j)]
        x[at(j)] = min(max(x[at(j)], lower[j]), upper[j])
    return steps


@_inlined
def _weigh(F, z, S_m, S_s, W1, W2):
    """Copy directions and weights to F.

    Returns whether W1 is diagonal, and the sums of the squares of W1 and W2 S_s.
    """
    a = _parts(z)
    is_diagonal = z.k1 == z.n
    for i in range(z.p):
        for t in range(z.m):
            F[at(a.S + i * z.m + t)] = S_m[i, t]
    for i in range(z.k1):
        for j in range(z.n):
            F[at(a.W1 + i * z.n + j)] = W1[i, j]
            is_diagonal = is_diagonal and (i == j or W1[i, j] == 0.0)
    for i in range(z.k2):
        for t in range(z.m2):
            F[at(a.W2 + i * z.m2 + t)] = W2[i, t]
        for t in range(z.m):
            s = 0.0
            for u in range(z.m2):
                s += W2[i, u] * S_s[u, t]
            F[at(a.G + i * z.m + t)] = s
    return is_diagonal, _square(F, a.W1, z.k1 * z.n), _square(F, a.G, z.k2 * z.m)


@_inlined
def _copy(F, first, v, size):
    """Copy a vector of this length to F; whether it is one, and its numbers are moderate."""
    if len(v) != size:
        return False
    for i in range(size):
        F[at(first + i)] = v[i]
    return _square(F, first, size) < _LARGEST


_DIRECTIONS = _any[2], _any[2]


@_compiled(_any[2], *_DIRECTIONS, _any[2], _any[2], _float, _float, _float, _new[1])
def factor(J, S_m, S_s, W1, W2, scale, clear, exact, F):
    """Factors of Problem 1, and whether its ranks are clearly full.

    Args:
        J: Task Jacobian, (m, n).
        S_m: Major directions, (p, m).
        S_s: Secondary directions, (m2, m).
        W1: Joint weight, (k1, n).
        W2: Secondary weight, (k2, m2).
        scale: Size of J; below zero: its norm.
        clear: Fraction of the scale above which a singular value is clearly not zero.
        exact: Part of `clear` for joint weights.
        F: Of `room` numbers; overwritten.
    """
    z = Sizes(S_m.shape[0], J.shape[0], J.shape[1], W1.shape[0], W2.shape[0], S_s.shape[0])
    a = _parts(z)
    for i in range(z.m):
        for j in range(z.n):
            F[at(a.J + i * z.n + j)] = J[i, j]
    is_diagonal, size_1, size_2 = _weigh(F, z, S_m, S_s, W1, W2)
    return _factor(F, z, is_diagonal, size_1, size_2, scale, clear, exact)


@_compiled(_any[2], *_DIRECTIONS, _any[1], _any[1], _float, _float, _float, _new[1])
def factor_diagonals(J, S_m, S_s, w1, w2, scale, clear, exact, F):
    """The same for weights given by their diagonals, (n,) and (m2,), or (0,) for none."""
    m, n = J.shape
    m2 = S_s.shape[0]
    if (len(w1) != n and len(w1) > 0) or (len(w2) != m2 and len(w2) > 0) or S_m.shape[1] != m:
        return REFUSED
    z = Sizes(S_m.shape[0], m, n, len(w1), len(w2), m2)
    a = _parts(z)
    for i in range(m):
        for j in range(n):
            F[at(a.J + i * n + j)] = J[i, j]
    for i in range(z.p):
        for t in range(m):
            F[at(a.S + i * m + t)] = S_m[i, t]
    size_1 = 0.0
    for i in range(z.k1):
        for j in range(n):
            F[at(a.W1 + i * n + j)] = w1[i] if i == j else 0.0
        size_1 += w1[i] * w1[i]
    for i in range(z.k2):
        for t in range(m2):
            F[at(a.W2 + i * m2 + t)] = w2[i] if i == t else 0.0
        for t in range(m):
            F[at(a.G + i * m + t)] = w2[i] * S_s[i, t]
    return _factor(F, z, z.k1 > 0, size_1, _square(F, a.G, z.k2 * m), scale, clear, exact)


@_inlined
def _is_within(limits, x):
    """Whether each number of x is between its limits."""
    is_within = True
    for j in range(len(x)):
        is_within = is_within and limits[0, j] <= x[j] <= limits[1, j]
    return is_within


@_compiled(_new[1], *[_int] * 6, _any[1], _any[1], _any[1], _new[1])
def apply(F, p, m, n, k1, k2, m2, v, rates_d, v_sd, x):
    """Write the optimal rates for one target to x (n,); REFUSED where it has a wrong number.

    Args:
        F: From `factor`, which found it CLEAR.
        p: As in `Sizes`, and so are the next five.
        m: Task rows.
        n: Rates.
        k1: Rows of W1.
        k2: Rows of W2.
        m2: Secondary directions.
        v: Major velocity, (p,).
        rates_d: Desired rates, (n,).
        v_sd: Desired secondary velocity, (m2,).
        x: Overwritten.
    """
    z = Sizes(p, m, n, k1, k2, m2)
    a = _parts(z)
    taken = _copy(F, a.v, v, p) and _copy(F, a.rates_d, rates_d, n) and _copy(F, a.v_sd, v_sd, m2)
    if not taken:
        return REFUSED
    _apply(F, z)
    for j in range(n):
        x[j] = F[at(a.x + j)]
    return CLEAR


@_compiled(_new[1], *[_int] * 6, _limits, _new[1], _state)
def within(F, p, m, n, k1, k2, m2, limits, x, state):
    """Move the optimal rates x (n,) to the optimum within limits (2, n).

    Returns the steps of the active set, or -1 where another method decides. `state` are limits to
    begin with, -1 lower, 1 upper, 0 none; overwritten with those that hold.
    """
    if _is_within(limits, x):
        state[:] = 0
        return 0
    z = Sizes(p, m, n, k1, k2, m2)
    a, C = _parts(z), np.empty((n, n - p))
    _, count, _, q = _shape(F, z)
    _motions(F, a.W, n, count, a.W_beta, a.M, q, a.M_diagonal, a.w, a.x, C)
    w, column = F[a.w : a.w + n], _columns(F[a.J : a.J + m * n].reshape(m, n))
    return _hold(C, w, column, F[at(a.most)], limits[0], limits[1], x, state)


@_compiled(_new[1], *[_int] * 6, *[_any[1]] * 3, _limits, _new[1])
def apply_within(F, p, m, n, k1, k2, m2, v, rates_d, v_sd, limits, x):
    """`apply` and `within` in one call; IN_DOUBT where another method decides."""
    code = apply(F, p, m, n, k1, k2, m2, v, rates_d, v_sd, x)
    if code != CLEAR or _is_within(limits, x):
        return code
    steps = within(F, p, m, n, k1, k2, m2, limits, x, np.zeros(n, np.int8))
    return IN_DOUBT if steps < 0 else CLEAR


@_compiled(
    _any[3], *_DIRECTIONS, _any[3], _any[3], _any[1], _float, _float,
    _any[2], _any[2], _any[2], _new[1], _new[2], types.Array(types.boolean, 1, "C"),
)  # fmt: skip
def solve_each(J, S_m, S_s, W1, W2, scale, clear, exact, v, rates_d, v_sd, F, x, ok):
    """A batch, one problem after the other; of J, weights and scale one may serve all.

    Writes the rates to x (B, n), and to `ok` which problems have clearly full ranks.
    """
    z = Sizes(S_m.shape[0], J.shape[1], J.shape[2], W1.shape[1], W2.shape[1], S_s.shape[0])
    a = _parts(z)
    is_diagonal, size_1, size_2 = False, 0.0, 0.0
    for k in range(len(x)):
        if k == 0 or len(W1) > 1 or len(W2) > 1:
            one, two = W1[min(k, len(W1) - 1)], W2[min(k, len(W2) - 1)]
            is_diagonal, size_1, size_2 = _weigh(F, z, S_m, S_s, one, two)
        of_J, size = min(k, len(J) - 1), scale[min(k, len(scale) - 1)]
        for i in range(z.m):
            for j in range(z.n):
                F[at(a.J + i * z.n + j)] = J[of_J, i, j]
        done = _factor(F, z, is_diagonal, size_1, size_2, size, clear, exact)
        ok[k] = done == CLEAR
        if ok[k]:
            for i in range(z.p):
                F[at(a.v + i)] = v[k, i]
            for i in range(z.n):
                F[at(a.rates_d + i)] = rates_d[k, i]
            for i in range(z.m2):
                F[at(a.v_sd + i)] = v_sd[k, i]
            _apply(F, z)
            for j in range(z.n):
                x[k, j] = F[at(a.x + j)]
    return CLEAR


@_compiled(_new[1], *[_int] * 6, _float, _new[3], _new[2], _new[2])
def levels(F, p, m, n, k1, k2, m2, exact, A, b, scales):
    """Write Problem 1 as levels for the last target.

    The rows are those of J_m, of [W1; W2 J_s], and of the identity, whose target is zero. Arrays
    have one more axis in front, of one.
    """
    z = Sizes(p, m, n, k1, k2, m2)
    a = _parts(z)
    A[:] = 0.0
    b[:] = 0.0
    for i in range(p + k2):
        row = i if i < p else k1 + i
        for t in range(m):
            s = F[at(a.S + i * m + t)]  # then G, which comes next
            for j in range(n if s != 0.0 else 0):
                A[0, row, j] += s * F[at(a.J + t * n + j)]
    for i in range(p):
        b[0, i] = F[at(a.v + i)]
    for i in range(k1):
        for j in range(n):
            w = F[at(a.W1 + i * n + j)]
            A[0, p + i, j] = w
            b[0, p + i] += w * F[at(a.rates_d + j)]
    for i in range(k2):
        for t in range(m2):
            b[0, p + k1 + i] += F[at(a.W2 + i * m2 + t)] * F[at(a.v_sd + t)]
    for j in range(n):
        A[0, p + k1 + k2 + j, j] = 1.0
    scale = np.sqrt(_square(F, a.J, m * n))
    scales[0, 0] = np.sqrt(_square(F, a.S, p * m)) * scale
    square = _square(F, a.G, k2 * m) * scale * scale
    scales[0, 1] = np.sqrt(_square(F, a.W1, k1 * n) * exact * exact + square)
    scales[0, 2] = 1.0
    return 1


@_compiled(_any[1], _any[1], _float, _new[2])
def copy_limits(lower, upper, largest, limits):
    """Copy limits to the two rows of `limits`; whether each lower is at most its upper one."""
    if len(lower) != limits.shape[1] or len(upper) != limits.shape[1]:
        return 0
    for i in range(len(lower)):
        low, high = lower[i], upper[i]
        # NaN is in no order.
        if not low <= high or low == np.inf or high == -np.inf:
            return 0
        if (abs(low) >= largest and low != -np.inf) or (abs(high) >= largest and high != np.inf):
            return 0
        limits[0, i], limits[1, i] = low, high
    return 1


@_compiled(_new[1], _ends, _new[2], _new[1])
def unpack(given, ends, A, b):
    """Write the levels of :func:`levels_within` to A (k, n) and b (k,)."""
    first, on, n = 0, 0, A.shape[1]
    for k in range(len(ends) - 1):
        for i in range(first, ends[k]):
            for j in range(n):
                A[at(i), at(j)] = given[at(on + j)]
            on += n
        for i in range(first, ends[k]):
            b[at(i)] = given[at(on)]
            on += 1
        first = ends[k]
    for i in range(n):
        for j in range(n):
            A[at(first + i), at(j)] = 1.0 if i == j else 0.0
        b[at(first + i)] = 0.0
    return 1


@_inlined
def _scales(A, b, ends, scales):
    """Write the norms of the levels; whether no product of these numbers over- or underflows."""
    first, targets = 0, 0.0
    for k in range(len(ends)):
        square = 0.0
        for i in range(first, ends[k]):
            for j in range(A.shape[1]):
                square += A[at(i), at(j)] * A[at(i), at(j)]
            targets += b[at(i)] * b[at(i)]
        if not 1.0 / _MODERATE < square < _MODERATE:
            return False
        scales[at(k)], first = np.sqrt(square), ends[k]
    return targets < _MODERATE


@_inlined
def _are_met(A, b, rows, x):
    """Whether the first rows of A x are b but for round-off of their terms."""
    for i in range(rows):
        rest, terms = b[at(i)], abs(b[at(i)])
        for j in range(A.shape[1]):
            part = A[at(i), at(j)] * x[at(j)]
            rest -= part
            terms += abs(part)
        if not abs(rest) <= _MISSED * terms:
            return False
    return True


@_compiled(
    _new[1], _ends, _float, _float, _any[1], _any[1],
    _new[1], _state,
)  # fmt: skip
def levels_within(given, ends, clear, largest, lower, upper, found, state):
    """Minimize |A_k x - b_k| level by level within limits, where only one before |x| is not met.

    That is the first with which there are as many rows as unknowns. Returns the steps of the active
    set, -1 where another method decides, -2 where that is to check the numbers first.

    Args:
        given: A_1, b_1, A_2, and so on, row by row.
        ends: Where each level ends in the rows of all, that of |x| at last.
        clear: Part of a level's norm above which a singular value is clearly not zero.
        largest: Limits below it pass, or infinite ones.
        lower: Shape (n,).
        upper: Likewise.
        found: Overwritten with the solution, lower and upper limits, (n,) each, and the norms of
            the levels.
        state: As in `apply_within`, (n,).
    """
    n, last, p, clear = len(state), 0, 0, max(clear, _REGULAR)
    A, b = np.empty((ends[-1], n)), np.empty(ends[-1])
    x, limits, scales = found[:n], found[n : 3 * n].reshape(2, n), found[3 * n :]
    unpack(given, ends, A, b)
    if copy_limits(lower, upper, largest, limits) == 0 or not _scales(A, b, ends, scales):
        return -2
    while ends[last] < n:
        p, last = ends[last], last + 1
    rows, q = ends[last], n - p
    k = rows - p
    M = rows * n
    diagonal = M + k * q
    W_beta, M_diagonal, M_beta, own = diagonal + n, diagonal + 2 * n, diagonal + 3 * n, rows + n
    c, w = diagonal + 4 * n, diagonal + 4 * n + own
    F = np.empty(w + n)
    for i in range(rows):
        for j in range(n):
            F[at(i * n + j)] = A[at(i), at(j)]
    _reduce_rows(F, 0, rows, n, p, diagonal, W_beta)
    for i in range(k):
        for j in range(q):
            F[at(M + i * q + j)] = F[at((p + i) * n + p + j)]
    _reduce_columns(F, M, k, q, 0, M_diagonal, M_beta)
    doubt = 0.0
    for level in range(last):
        inverse = _inverse_square(F, 0, n, ends[level], diagonal, False, c)
        doubtful = inverse * (clear * scales[at(level)]) ** 2
        if not doubtful < 1.0:  # nor is NaN
            return -1
        doubt = max(doubt, doubtful)
    inverse = _inverse_square(F, M, q, q, M_diagonal, True, c)
    if not inverse * (clear * scales[at(last)]) ** 2 < 1.0:
        return -1
    for i in range(rows):
        s = b[at(i)]
        for j in range(min(i, p)):
            s -= F[at(i * n + j)] * F[at(c + j)]
        F[at(c + i)] = s / F[at(diagonal + i)] if i < p else s
    _least_squares(F, M, k, q, 0, M_diagonal, M_beta, c + p)
    _reflect(F, 0, n, p, W_beta, c, True)
    for j in range(n):
        x[at(j)], F[at(w + j)] = F[at(c + j)], 1.0
    if _is_within(limits, x):
        state[:] = 0
        return 0 if _are_met(A, b, p, x) else -1
    C = np.empty((n, q))
    _motions(F, 0, n, p, W_beta, M, q, M_diagonal, w, c, C)
    most, column = _most(doubt, inverse), _columns(A[:rows])
    steps = _hold(C, F[w:], column, most, limits[0], limits[1], x, state)
    return steps if _are_met(A, b, p, x) else -1


@_compiled(
    _any[2], *_DIRECTIONS, _any[2], _any[2], _float, _float, _float, *[_any[1]] * 3, *[_new[1]] * 2
)  # fmt: skip
def solve(J, S_m, S_s, W1, W2, scale, clear, exact, v, rates_d, v_sd, F, x):
    """`factor` and, where it finds ranks CLEAR, `apply` in one call; their arguments, and codes."""
    z = Sizes(S_m.shape[0], J.shape[0], J.shape[1], W1.shape[0], W2.shape[0], S_s.shape[0])
    a = _parts(z)
    taken = _copy(F, a.v, v, z.p) and _copy(F, a.rates_d, rates_d, z.n)
    if not (taken and _copy(F, a.v_sd, v_sd, z.m2)):
        return REFUSED
    for i in range(z.m):
        for j in range(z.n):
            F[at(a.J + i * z.n + j)] = J[i, j]
    is_diagonal, size_1, size_2 = _weigh(F, z, S_m, S_s, W1, W2)
    found = _factor(F, z, is_diagonal, size_1, size_2, scale, clear, exact)
    if found == CLEAR:
        _apply(F, z)
        for j in range(z.n):
            x[j] = F[at(a.x + j)]
    return found


def room(sizes: Sizes) -> int:
    """How many numbers F takes."""
    return _parts.py_func(sizes).end


def arguments(F, *sizes):
    """J, W1 and W2 as they stand in F, read-only."""
    z = Sizes(*sizes)
    a = _parts.py_func(z)
    shapes = (a.J, z.m, z.n), (a.W1, z.k1, z.n), (a.W2, z.k2, z.m2)
    views = [F[first : first + k * n].reshape(k, n) for first, k, n in shapes]
    for view in views:
        view.setflags(write=False)
    return views
