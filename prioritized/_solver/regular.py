"""Rates and passive velocities of a regular mechanism in one compiled call.

Regular is what has no rank in doubt: loops determine the passive velocities, and all rows of all
levels can be met. What is in doubt is left to singular values. All compiled code stands in one
file, because the compiler's cache notices a change of that file alone.
"""

import numpy as np
from numba import njit, types

from argument_checks.compilation import kernel

MET, LIMITED, IN_DOUBT, REFUSED = 0, 1, 2, 3
"""All is met; limits forbid it; others decide; a shape or a number is wrong."""

CLEAR = 1e-6
"""Part of a scale above which a singular value is regular: any way then finds nine digits."""
_NOTHING = 1e-13
"""Part of a scale below which a singular value is zero at any tolerance, as it is elsewhere."""
_DEPENDENT = 1e-12
"""Part of a row that is round-off where the row depends on others."""
_ROUND_OFF = 1e-14
"""Part of the terms of a velocity by which it may be beyond its limit before it is put on it."""
_STEPS = 6
"""Of the active set for each rate; where there are more, another method decides."""
_MODERATE = 1e100
"""Sum of squares up to which, and from the inverse of which on, no product over- or underflows."""
_MARGIN = 8.0
"""Of bounds of errors, which are of first order."""

_given = {k: types.Array(types.float64, k, "C", readonly=True) for k in (1, 2)}
_new = {k: types.Array(types.float64, k, "C") for k in (1, 2)}
_indices = types.Array(types.intp, 1, "C", readonly=True)
_float, _int = types.float64, types.int64
_inlined = njit(error_model="numpy")
_sum = njit(error_model="numpy", fastmath={"reassoc"})
"""In whatever order is fastest."""
at = np.uint64
"""An index that cannot be negative: the compiler then leaves out Python's counting from the end."""


@_sum
def _square(A):
    """Sum of the squares of all numbers."""
    total = 0.0
    for x in A.flat:
        total += x * x
    return total


@_sum
def _dot(A, row, x, first, last):
    """A row of A times x, from one column to another."""
    total = 0.0
    for j in range(first, last):
        total += A[at(row), at(j)] * x[at(j)]
    return total


@_inlined
def _add(M, target, factor, source, first, last):
    """Add a multiple of one row of M to another from a column on."""
    if factor != 0.0:  # loops share few joints
        for j in range(first, last):
            M[at(target), at(j)] += factor * M[at(source), at(j)]


@_inlined
def _clear_below(M, k, column, rows, first, v):
    """Zero M's column below row k by a reflection v of the columns from `first` on.

    The row after `rows` is room. Returns whether there was anything.
    """
    square, columns, own = 0.0, M.shape[1], k
    while own < rows and M[at(own), at(column)] == 0.0:
        own += 1
    if k < own < rows:  # rows of other loops stay as they are
        for j in range(first, columns):
            M[at(k), at(j)], M[at(own), at(j)] = M[at(own), at(j)], M[at(k), at(j)]
    for i in range(k, rows):
        v[at(i)] = M[at(i), at(column)]
        square += v[at(i)] * v[at(i)]
    norm = np.sqrt(square)
    if not norm > 0.0:
        return False
    v[at(k)] += np.copysign(norm, v[at(k)])
    beta = 1.0 / (norm * abs(v[at(k)]))
    for j in range(first, columns):
        M[at(rows), at(j)] = 0.0
    for i in range(k, rows):
        _add(M, rows, v[at(i)], i, first, columns)
    for i in range(k, rows):
        _add(M, i, -beta * v[at(i)], rows, first, columns)
    return True


@_inlined
def _inverse(M, pivots):
    """|R^-1|^2 of the triangle R in M's first rows and these columns."""
    count, row, total = len(pivots), np.empty(len(pivots)), 0.0
    for k in range(count):
        for i in range(k, count):
            row[at(i)] = 1.0 if i == k else 0.0
        for i in range(k, count):
            if row[at(i)] != 0.0:  # loops share few joints
                row[at(i)] /= M[at(i), at(pivots[i])]
                total += row[at(i)] * row[at(i)]
                for j in range(i + 1, count):
                    row[at(j)] -= row[at(i)] * M[at(i), at(pivots[j])]
    return total


@_inlined
def _eliminate(M, rows, p):
    """Solve M's first p unknowns by reflections from the left; the row after `rows` is room.

    Afterwards the first p rows are R^-1 Q1^T M from column p on, and the others Q2^T M. Returns
    |R^-1|^2, which is not finite where the first p columns are dependent.
    """
    v = np.empty(rows)
    for k in range(p):
        if not _clear_below(M, k, k, rows, k, v):
            return np.inf
    for i in range(p - 1, -1, -1):
        for k in range(i + 1, p):
            _add(M, i, -M[at(i), at(k)], k, p, M.shape[1])
        for j in range(p, M.shape[1]):
            M[at(i), at(j)] /= M[at(i), at(i)]
    return _inverse(M, np.arange(p))


@_inlined
def _independent(M, first, rows, zero):
    """Pivots of a triangle to which reflections from the left reduce M's rows from `first` on.

    They stand in its columns from `first` on; the row after `rows` is room. What is left of the
    rows after these is at most `zero`, and so is each singular value beyond as many.
    """
    pivots, v, count = np.empty(rows - first, np.int64), np.empty(rows), 0
    for k in range(first, min(rows, M.shape[1])):
        most, left = 0.0, 0.0
        for j in range(first, M.shape[1]):
            M[at(rows), at(j)] = 0.0
        for i in range(k, rows):
            for j in range(first, M.shape[1]):
                M[at(rows), at(j)] += M[at(i), at(j)] * M[at(i), at(j)]
        for j in range(first, M.shape[1]):
            left += M[at(rows), at(j)]
            if M[at(rows), at(j)] > most:
                pivots[at(count)], most = j, M[at(rows), at(j)]
        if not left > zero * zero:
            break
        _clear_below(M, k, pivots[at(count)], rows, first, v)
        count += 1
    return pivots[:count]


@_inlined
def _reflect(L, row, beta, x, first, last):
    """Apply a reflection, which stands in its row, to a vector."""
    dot = beta * _dot(L, row, x, first, last)
    for j in range(first, last):
        x[at(j)] -= dot * L[at(row), at(j)]


@_inlined
def _least_change(L, rows, n, beta, x):
    """Move x (n,) least so that L's rows meet its column n; returns |L^-1|^2 of their triangle.

    Afterwards L and beta hold the reflections that reduce L's rows to it.
    """
    diagonal, column = np.empty(rows), np.empty(rows)
    for i in range(rows):
        norm = np.sqrt(_dot(L, i, L[i], i, n))
        if not norm > 0.0:
            return np.inf
        first = np.copysign(norm, L[at(i), at(i)])
        L[at(i), at(i)] += first
        diagonal[at(i)] = -first
        beta[at(i)] = 1.0 / (norm * abs(L[at(i), at(i)]))
        for k in range(i + 1, rows):
            _reflect(L, i, beta[at(i)], L[k], i, n)
        _reflect(L, i, beta[at(i)], x, i, n)
    total = 0.0
    for k in range(rows):
        for i in range(k, rows):
            rest = (1.0 if i == k else 0.0) - _dot(L, i, column, k, i)
            column[at(i)] = rest / diagonal[at(i)]
            total += column[at(i)] * column[at(i)]
    for i in range(rows):
        x[at(i)] = (L[at(i), at(n)] - _dot(L, i, x, 0, i)) / diagonal[at(i)]
    for i in range(rows - 1, -1, -1):
        _reflect(L, i, beta[at(i)], x, i, n)
    return total


@_inlined
def _through(J_T, J_C, sizes, order, p, errors, bound, M):
    """Reduce the loops to M: gains, then as many rows on the rates as are independent.

    Returns whether J_Cp is regular; where these rows end; the size of the terms of J = J_Ta +
    J_Tp gain; what counts as zero of the loops, per |gain|, and of J; and |gain|^2.
    """
    c, w, of_loops, of_task = len(J_C), len(order), errors[0], errors[1]
    for i in range(c):
        for j in range(w):
            M[at(i), at(j)] = J_C[i, order[j]]
    closing = _eliminate(M, c, p)
    follows, through = 0.0, 0.0
    for k in range(p):
        follow, column = 0.0, 0.0
        for j in range(p, w):
            M[at(k), at(j)] = -M[at(k), at(j)]
            follow += M[at(k), at(j)] * M[at(k), at(j)]
        for t in range(len(J_T)):
            column += J_T[t, order[k]] * J_T[t, order[k]]
        follows += follow
        through += column * follow
    size_T, size_C = sizes
    loops = max(errors[2] * size_C, _MARGIN * of_loops * bound)
    scale = size_T + np.sqrt(through)
    reached = (of_task + size_T * np.sqrt(closing) * of_loops) * (1.0 + np.sqrt(follows))
    task = max(errors[3] * scale, _MARGIN * reached * bound)
    is_regular = p == 0 or closing * loops * loops < 1.0
    end = p + len(_independent(M, p, c, _NOTHING * size_C)) if is_regular and c > p else p
    return is_regular, end, scale, loops, task, follows


@_inlined
def _jacobian(J_T, order, p, M):
    """J = J_Ta + J_Tp gain, (m, n), its rates in this order."""
    m, n = len(J_T), len(order) - p
    J = np.empty((m, n))
    for t in range(m):
        for j in range(n):
            J[at(t), at(j)] = J_T[t, order[p + j]]
        for h in range(p):
            moved = J_T[t, order[h]]
            if moved != 0.0:
                for j in range(n):
                    J[at(t), at(j)] += moved * M[at(h), at(p + j)]
    return J


@_inlined
def _product(A, B, first, C):
    """Write A B to the rows of C from `first` on, whose first columns are as many as B's."""
    for i in range(len(A)):
        for j in range(B.shape[1]):
            C[at(first + i), at(j)] = 0.0
        for t in range(len(B)):
            if A[i, t] != 0.0:
                for j in range(B.shape[1]):
                    C[at(first + i), at(j)] += A[i, t] * B[at(t), at(j)]


@_inlined
def _is_met_whole(B, q, k, D, J, zero):
    """Whether the rank of B's q + k rows with D J after them is as large as can be, surely."""
    n, rows = J.shape[1], q + k + len(D)
    A = np.empty((rows + 1, n))
    A[: q + k] = B[: q + k, :n]
    _product(D, J, q + k, A)
    pivots = _independent(A, 0, rows, 0.0)
    return len(pivots) == min(rows, n) and _inverse(A, pivots) * zero * zero < 1.0


@_inlined
def _triangle(weight, wanted, B, z, G):
    """R and, in its last column, r: of |R x - r| with the rates x that have weights, (w, w + 1).

    It is |weights (x - wanted)|, and |G [rates; -1]| beside it, in which the z others follow from
    B. G is overwritten.
    """
    w, n = len(weight), B.shape[1] - 1
    R = np.zeros((w, w + 1))
    for j in range(w):
        R[at(j), at(j)], R[at(j), at(w)] = weight[at(j)], wanted[at(j)] * weight[at(j)]
    for e in range(len(G)):
        for i in range(z):
            for j in range(z, n + 1):
                G[at(e), at(j)] -= G[at(e), at(i)] * B[at(i), at(j)]
    for k in range(w if len(G) else 0):
        square = 0.0
        for e in range(len(G)):
            square += G[at(e), at(z + k)] * G[at(e), at(z + k)]
        norm = np.sqrt(R[at(k), at(k)] * R[at(k), at(k)] + square)
        first = R[at(k), at(k)] + norm
        for j in range(k + 1, w + 1):
            dot = first * R[at(k), at(j)]
            for e in range(len(G)):
                dot += G[at(e), at(z + k)] * G[at(e), at(z + j)]
            dot /= norm * first
            R[at(k), at(j)] -= dot * first
            for e in range(len(G)):
                G[at(e), at(z + j)] -= dot * G[at(e), at(z + k)]
        R[at(k), at(k)] = -norm
    return R


@_inlined
def _divide(row, R, is_diagonal, first, last):
    """Overwrite a row (w,), which has numbers in these columns, with row R^-1."""
    for j in range(first, last):
        for i in range(first, first if is_diagonal else j):
            row[at(j)] -= row[at(i)] * R[at(i), at(j)]
        row[at(j)] /= R[at(j), at(j)]


@_inlined
def _optimum(B, rows, z, R, is_diagonal, L, beta, y):
    """Meet B's rows by rates over which y = R x is nearest to R's last column.

    The first z rates have no weight: they follow from the others, as passive velocities do. Returns
    |(B R^-1)^+|^2 at most, and 1 + |rates without weight per other rate|^2.
    """
    n, w = B.shape[1] - 1, len(y)
    gain = 1.0
    for i in range(z):
        for j in range(z, n):
            gain += B[at(i), at(j)] * B[at(i), at(j)]
    for j in range(w):
        y[at(j)] = R[at(j), at(w)]
    for i in range(rows - z):
        for j in range(w + 1):
            L[at(i), at(j)] = B[at(z + i), at(z + j)]
        _divide(L[i], R, is_diagonal, 0, w)
    return _least_change(L, rows - z, w, beta, y), gain


@_inlined
def _all_velocities(M, B, p, z, R, is_diagonal):
    """C and c of all moving velocities C y + c, in their order, and where a row has numbers."""
    n, w = B.shape[1] - 1, len(R)
    C, c, spans = np.zeros((p + n, w)), np.zeros(p + n), np.zeros((p + n, 2), np.int64)
    spans[:, 1] = w
    for i in range(z):
        c[at(p + i)] = B[at(i), at(n)]
        for j in range(w):
            C[at(p + i), at(j)] = -B[at(i), at(z + j)]
    for j in range(w):
        C[at(p + z + j), at(j)] = 1.0
        spans[p + z + j] = j, j + 1 if is_diagonal else w
    for k in range(p):
        for j in range(w):
            C[at(k), at(j)] = M[at(k), at(p + z + j)]
        for i in range(z):
            c[at(k)] += M[at(k), at(p + i)] * c[at(p + i)]
            _add(C, k, M[at(k), at(p + i)], p + i, 0, w)
    for i in range(p + n):
        _divide(C[i], R, is_diagonal, spans[i, 0], spans[i, 1])
    return C, c, spans


@_inlined
def _most_beyond(C, c, spans, norms, lower, upper, order, y):
    """The velocity farthest beyond a limit, per norm of its row, and the side; -1 if none is."""
    chosen, side, most, size = -1, 0.0, 0.0, np.sqrt(_square(y))
    for i in range(len(C)):
        low, high = lower[order[i]], upper[order[i]]
        if low > -np.inf or high < np.inf:
            x, norm = c[at(i)] + _dot(C, i, y, spans[i, 0], spans[i, 1]), norms[at(i)]
            beyond = max(low - x, x - high)
            is_beyond = beyond > _ROUND_OFF * (norm * size + abs(c[at(i)]))
            if is_beyond and (not norm > 0.0 or beyond > most * norm):
                chosen, side, most = i, 1.0 if low > x else -1.0, beyond / norm
    return chosen, side


@_inlined
def _multipliers(H, h, k, F, r):
    """Solve H r = h by Cholesky's factor F, k rows of each."""
    for a in range(k):
        for b in range(a + 1):
            t = H[at(a), at(b)]
            for e in range(b):
                t -= F[at(a), at(e)] * F[at(b), at(e)]
            F[at(a), at(b)] = np.sqrt(t) if a == b else t / F[at(b), at(b)]
    for a in range(k):
        t = h[at(a)]
        for e in range(a):
            t -= F[at(a), at(e)] * r[at(e)]
        r[at(a)] = t / F[at(a), at(a)]
    for a in range(k - 1, -1, -1):
        t = r[at(a)]
        for e in range(a + 1, k):
            t -= F[at(e), at(a)] * r[at(e)]
        r[at(a)] = t / F[at(a), at(a)]


@_inlined
def _project(L, rows, beta, x):
    """Take from x what moves the rows of L."""
    for i in range(rows):
        _reflect(L, i, beta[at(i)], x, i, len(x))
    for i in range(rows):
        x[at(i)] = 0.0
    for i in range(rows - 1, -1, -1):
        _reflect(L, i, beta[at(i)], x, i, len(x))


@_inlined
def _drop(P, H, u, dropped, last):
    """Take one of the limits that hold out of the lists, whose last one is a candidate."""
    for a in range(dropped, last):
        P[a], u[a] = P[a + 1], u[a + 1]
    for a in range(dropped, last - 1):
        H[a] = H[a + 1]
    for b in range(last - 1):
        for a in range(dropped, last - 1):
            H[at(b), at(a)] = H[at(b), at(a + 1)]


@_inlined
def _hold(L, rows, beta, C, c, spans, lower, upper, order, y):
    """Move y least, the rows of L met as before, so that C y + c is within its limits.

    A dual active-set method (Goldfarb, Idnani, Math. Programming 27, 1983): k limits hold, P has
    their rows on what L leaves free, H = P P^T, u their multipliers. Returns whether y was found
    beyond doubt.
    """
    w, most, k, steps = len(y), len(y) - rows, 0, 0
    P, step, u = np.empty((most + 1, w)), np.empty(w), np.empty(most + 1)
    H, F, r, h = np.empty((most, most)), np.empty((most, most)), np.empty(most), np.empty(most)
    norms = np.empty(len(C))
    for i in range(len(C)):
        norms[at(i)] = np.sqrt(_dot(C, i, C[i], spans[i, 0], spans[i, 1]))
    while True:
        new, side = _most_beyond(C, c, spans, norms, lower, upper, order, y)
        if new < 0:
            return True
        limit, size = (lower if side > 0.0 else upper)[order[new]], norms[new] * norms[new]
        row, first, last = C[new], spans[new, 0], spans[new, 1]
        for j in range(w):
            P[at(k), at(j)] = side * row[at(j)]
        _project(L, rows, beta, P[k])
        u[k], is_held = 0.0, False
        while not is_held:
            steps += 1
            for a in range(k):
                h[at(a)] = side * _dot(P, a, row, first, last)
            _multipliers(H, h, k, F, r)
            length, dropped = np.inf, -1
            step[:] = P[k]
            for a in range(k):
                for j in range(w):
                    step[at(j)] -= r[at(a)] * P[at(a), at(j)]
            square = _square(step)
            moves = square > _DEPENDENT * _DEPENDENT * size
            if moves:
                length = side * (limit - c[at(new)] - _dot(C, new, y, first, last)) / square
            is_doubtful = moves and (square < CLEAR * CLEAR * size or k == most)
            for a in range(k):
                if r[at(a)] > 0.0 and u[at(a)] < length * r[at(a)]:
                    length, dropped = u[at(a)] / r[at(a)], a
            if is_doubtful or length == np.inf or steps > _STEPS * (w + 1):
                return False
            for j in range(w if moves else 0):
                y[at(j)] += length * step[at(j)]
            for a in range(k):
                u[at(a)] -= length * r[at(a)]
            u[at(k)] += length
            is_held = dropped < 0
            if is_held:
                for a in range(k):
                    H[at(k), at(a)] = H[at(a), at(k)] = h[at(a)]
                H[at(k), at(k)] = side * _dot(P, k, row, first, last)
                k += 1
            else:
                _drop(P, H, u, dropped, k)
                k -= 1


@_inlined
def _is_sound(squares, bound):
    """Whether all numbers are finite; and whether no product of them over- or underflows.

    Their sums of squares are given.
    """
    is_moderate = bound < np.inf
    for square in squares:
        if not square < np.inf:
            return False, False
        is_moderate = is_moderate and (square == 0.0 or 1.0 / _MODERATE < square < _MODERATE)
    return bound >= 0.0, is_moderate


@_inlined
def _reduce(M, J, p, end, place, scale, reduced):
    """Write gains, the loops' rows on the rates, J, and the size of its terms, all per rate."""
    (m, n), c = J.shape, len(M) - 1
    for j in range(n):
        for i in range(c):
            reduced[at(i), at(place[j])] = M[at(i), at(p + j)] if i < end else 0.0
        for t in range(m):
            reduced[at(c + t), at(place[j])] = J[at(t), at(j)]
        reduced[at(c + m), at(place[j])] = scale


@_inlined
def _are_idle(J_T, J_C, idle, lower, upper):
    """Whether these velocities move neither loops nor task, and may be zero."""
    for j in idle:
        if not lower[j] <= 0.0 <= upper[j]:
            return False
        for A in (J_T, J_C):
            for i in range(len(A)):
                if A[i, j] != 0.0:
                    return False
    return True


@kernel(
    _int(
        _given[2], _given[2], _given[1], _given[1], _given[1], _float,
        _given[2], _given[2], _given[2], _given[2],
        _indices, _int, _int, _indices, _indices, _given[1], _given[1], _new[1], _new[2],
    )
)  # fmt: skip
def meet(
    J_T, J_C, targets, lower, upper, bound,
    S, D, E, T, order, p, z, place, idle, weight, errors, x, reduced,
):  # fmt: skip
    """Meet all rows S J rates of all levels by the best rates.

    Least is |weights (rates - wanted)|^2 + |E D J rates - e|^2.

    Args:
        J_T: Shape (m, N).
        J_C: Shape (c, N).
        targets: What all levels ask for, (t,).
        lower: Limits of all velocities, (N,); of those that are stuck they do not matter.
        upper: Likewise.
        bound: Of the errors of the entries of J_T and J_C, in natural units.
        S: Rows of the levels on the task, (k, m).
        D: Directions of the task in the last level, (d, m).
        E: Their weights, (., d).
        T: Right sides of S, the rates that are wanted, and e, per target, (k + n - z + ., t).
        order: The p passive velocities that move, z rates without a weight, and all other rates.
        p: Number of them.
        z: Likewise.
        place: Of each rate in this order its number among the actuators, (n,).
        idle: Passive velocities that neither loops nor task know, which stay at rest.
        weight: Of the others, (n - z,).
        errors: Size of the errors of J_C and of J_T per `bound`; parts of the sizes of J_C and of J
            up to which a singular value is in doubt; norm of S and D; this part of |weight| and of
            |E D| per least weight.
        x: Overwritten with all velocities, zero where stuck or idle, (N,).
        reduced: Where limits forbid it, overwritten with passive velocities per rate (p, n),
            constraints of the rates (c - p, n), of which some may be zero, J (m, n), and the size
            of its terms (1, n), in the order of the actuators.
    """
    (m, N), c, n, k = J_T.shape, len(J_C), len(order) - p, len(S)
    w, right = n - z, np.zeros(len(T))
    if S.shape[1] != m or J_C.shape[1] != N or len(x) != N:
        return REFUSED
    if len(lower) != N or len(upper) != N or len(targets) != T.shape[1]:
        return REFUSED
    task, loops = _square(J_T), _square(J_C)
    is_finite, is_moderate = _is_sound((task, loops, _square(targets)), bound)
    if not is_finite:
        return REFUSED
    if not (is_moderate and len(reduced) == c + m + 1 and p <= c):
        return IN_DOUBT
    if not _are_idle(J_T, J_C, idle, lower, upper):
        return IN_DOUBT
    M, sizes = np.empty((c + 1, p + n)), (np.sqrt(task), np.sqrt(loops))
    is_regular, end, scale, loops, task, follows = _through(
        J_T, J_C, sizes, order, p, errors, bound, M
    )
    q = end - p
    if not (is_regular and z <= q + k <= n):
        return IN_DOUBT
    for i in range(len(T)):
        for j in range(len(targets)):
            right[at(i)] += T[i, j] * targets[j]
    J, B, rows = _jacobian(J_T, order, p, M), np.empty((q + k + 1, n + 1)), q + k
    for i in range(rows):
        for j in range(n if i < q else 0):
            B[at(i), at(j)] = M[at(p + i), at(p + j)]
        B[at(i), at(n)] = right[at(i - q)] if i >= q else 0.0
    _product(S, J, q, B)
    # The least singular value of all rows is at least 1 / |B^+|, and each level's no less.
    zero = max(loops * (1.0 + np.sqrt(follows)) if q > 0 else 0.0, 2.0 * errors[4] * task)
    if len(D) and not _is_met_whole(B, q, k, D, J, zero):
        return IN_DOUBT
    G = np.empty((len(E), n + 1))
    if len(E):
        DJ = np.empty((len(D), n))
        _product(D, J, 0, DJ)
        _product(E, DJ, 0, G)
        for e in range(len(E)):
            G[at(e), at(n)] = right[at(k + w + e)]
    unweighted = _eliminate(B, rows, z)
    R = _triangle(weight, right[k : k + w], B, z, G)
    L, beta, y = np.empty((rows - z, w + 1)), np.empty(rows - z), np.empty(w)
    inverse, gain = _optimum(B, rows, z, R, len(E) == 0, L, beta, y)
    least = weight.min()
    inverse = inverse * gain / (least * least) + unweighted
    settling = errors[5] * errors[5] + errors[6] * errors[6] * scale * scale
    if not (inverse * zero * zero < 1.0 and gain * settling < 1.0):
        return IN_DOUBT

    for j in order:
        if not lower[j] <= upper[j]:
            return REFUSED
    C, c_0, spans = _all_velocities(M, B, p, z, R, len(E) == 0)
    unlimited = y.copy()
    are_held = _hold(L, rows - z, beta, C, c_0, spans, lower, upper, order, y)
    for j in range(N):
        x[at(j)] = 0.0
    for i in range(p + n):
        j = order[i]
        value = c_0[at(i)] + _dot(C, i, y if are_held else unlimited, spans[i, 0], spans[i, 1])
        x[j] = min(max(value, lower[j]), upper[j]) if are_held else value
    if not are_held:
        _reduce(M, J, p, end, place, scale, reduced)
    return MET if are_held else LIMITED
