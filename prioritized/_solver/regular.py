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
at = np.uint64
"""An index that cannot be negative: the compiler then leaves out Python's counting from the end."""


@_inlined
def _square(A):
    """Sum of the squares of all numbers."""
    total = 0.0
    for x in A.flat:
        total += x * x
    return total


@_inlined
def _add(M, target, factor, source, first, last):
    """Add a multiple of one row of M to another from a column on."""
    if factor != 0.0:  # loops share few joints
        for j in range(first, last):
            M[at(target), at(j)] += factor * M[at(source), at(j)]


@_inlined
def _eliminate(M, rows, p, columns):
    """Solve M's first p unknowns by reflections from the left; the row after `rows` is room.

    Afterwards the first p rows are R^-1 Q1^T M from column p on, and the others Q2^T M. Returns
    |R^-1|^2, which is not finite where the first p columns are dependent.
    """
    diagonal, column, total = np.empty(p), np.empty(p), 0.0
    for k in range(p):
        square = 0.0
        for i in range(k, rows):
            square += M[at(i), at(k)] * M[at(i), at(k)]
        norm = np.sqrt(square)
        if not norm > 0.0:
            return np.inf
        first = np.copysign(norm, M[at(k), at(k)])
        M[at(k), at(k)] += first
        diagonal[at(k)] = -first
        beta = 1.0 / (norm * abs(M[at(k), at(k)]))
        for j in range(k + 1, columns):
            M[at(rows), at(j)] = 0.0
        for i in range(k, rows):
            _add(M, rows, M[at(i), at(k)], i, k + 1, columns)
        for i in range(k, rows):
            _add(M, i, -beta * M[at(i), at(k)], rows, k + 1, columns)
    for k in range(p):  # a row of the inverse of R^T
        for i in range(k, p):
            s = 1.0 if i == k else 0.0
            for j in range(k, i):
                s -= M[at(j), at(i)] * column[at(j)]
            column[at(i)] = s / diagonal[at(i)]
            total += column[at(i)] * column[at(i)]
    for i in range(p - 1, -1, -1):
        for k in range(i + 1, p):
            _add(M, i, -M[at(i), at(k)], k, p, columns)
        for j in range(p, columns):
            M[at(i), at(j)] /= diagonal[at(i)]
    return total


@_inlined
def _reflect(L, row, beta, x, first, last):
    """Apply a reflection, which stands in its row, to a vector."""
    dot = 0.0
    for j in range(first, last):
        dot += L[at(row), at(j)] * x[at(j)]
    dot *= beta
    for j in range(first, last):
        x[at(j)] -= dot * L[at(row), at(j)]


@_inlined
def _least_change(L, rows, n, beta, x):
    """Move x (n,) least so that L's rows meet its column n; returns |L^-1|^2 of their triangle.

    Afterwards L and beta hold the reflections that reduce L's rows to it.
    """
    diagonal, column = np.empty(rows), np.empty(rows)
    for i in range(rows):
        square = 0.0
        for j in range(i, n):
            square += L[at(i), at(j)] * L[at(i), at(j)]
        norm = np.sqrt(square)
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
            s = 1.0 if i == k else 0.0
            for j in range(k, i):
                s -= L[at(i), at(j)] * column[at(j)]
            column[at(i)] = s / diagonal[at(i)]
            total += column[at(i)] * column[at(i)]
    for i in range(rows):
        s = L[at(i), at(n)]
        for j in range(i):
            s -= L[at(i), at(j)] * x[at(j)]
        x[at(i)] = s / diagonal[at(i)]
    for i in range(rows - 1, -1, -1):
        _reflect(L, i, beta[at(i)], x, i, n)
    return total


@_inlined
def _through(J_T, J_C, order, p, errors, bound, M):
    """Reduce the loops to M: gains, then rows on the rates; what J = J_Ta + J_Tp gain is of.

    Returns whether J_Cp is regular; |J|'s terms; what counts as zero of the loops, per |gain|, and
    of J; and |gain|^2.
    """
    c, w, of_loops, of_task = len(J_C), len(order), errors[0], errors[1]
    for i in range(c):
        for j in range(w):
            M[at(i), at(j)] = J_C[i, order[j]]
    closing = _eliminate(M, c, p, w)
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
    size_C, size_T = np.sqrt(_square(J_C)), np.sqrt(_square(J_T))
    loops = max(errors[2] * size_C, _MARGIN * of_loops * bound)
    scale = size_T + np.sqrt(through)
    reached = (of_task + size_T * np.sqrt(closing) * of_loops) * (1.0 + np.sqrt(follows))
    task = max(errors[3] * scale, _MARGIN * reached * bound)
    is_regular = p == 0 or closing * loops * loops < 1.0
    return is_regular, scale, loops, task, follows


@_inlined
def _reduce(J_T, order, p, place, M, scale, reduced):
    """Write gains, the loops' rows on the rates, J, and the size of its terms, all per rate."""
    (m, n), c = (len(J_T), len(order) - p), len(M) - 1
    for k in range(n):
        j = place[k]
        for i in range(c):
            reduced[at(i), at(j)] = M[at(i), at(p + k)]
        for t in range(m):
            reduced[at(c + t), at(j)] = J_T[t, order[p + k]]
        reduced[at(c + m), at(j)] = scale
    for t in range(m):
        for h in range(p):
            moved = J_T[t, order[h]]
            if moved != 0.0:
                for j in range(n):
                    reduced[at(c + t), at(j)] += moved * reduced[at(h), at(j)]


@_inlined
def _stack(reduced, p, c, place, S, right, B):
    """Write to B the loops' rows on the rates, then S J, and beside them what they are to be."""
    q, n, row = c - p, reduced.shape[1], np.empty(reduced.shape[1])
    for i in range(q + len(S)):
        for j in range(n):
            row[at(j)] = reduced[at(p + i), at(j)] if i < q else 0.0
        for t in range(S.shape[1] if i >= q else 0):
            if S[i - q, t] != 0.0:
                for j in range(n):
                    row[at(j)] += S[i - q, t] * reduced[at(c + t), at(j)]
        for k in range(n):
            B[at(i), at(k)] = row[place[k]]
        B[at(i), at(n)] = right[at(i - q)] if i >= q else 0.0


@_inlined
def _optimum(B, rows, z, wanted, weight, L, beta, y):
    """Meet B's rows by rates over which y, the weighted ones times weights, is nearest to wanted.

    The first z rates have no weight: they follow from the others, as passive velocities do. Returns
    |B^+|^2 at most, and 1 + |rates without weight per other rate|^2.
    """
    n, w = B.shape[1] - 1, len(y)
    unweighted = _eliminate(B, rows, z, n + 1)
    gain, least = 1.0, np.inf
    for i in range(z):
        for j in range(z, n):
            gain += B[at(i), at(j)] * B[at(i), at(j)]
    for j in range(w):
        y[at(j)] = wanted[at(j)] * weight[at(j)]
        least = min(least, weight[at(j)])
        for i in range(rows - z):
            L[at(i), at(j)] = B[at(z + i), at(z + j)] / weight[at(j)]
    for i in range(rows - z):
        L[at(i), at(w)] = B[at(z + i), at(n)]
    inverse = _least_change(L, rows - z, w, beta, y)
    return inverse * gain / (least * least) + unweighted, gain


@_inlined
def _all_velocities(M, B, p, z, weight):
    """C and c of all moving velocities C y + c, in their order."""
    n, w = B.shape[1] - 1, len(weight)
    C, c = np.zeros((p + n, w)), np.zeros(p + n)
    for i in range(z):
        c[at(p + i)] = B[at(i), at(n)]
        for j in range(w):
            C[at(p + i), at(j)] = -B[at(i), at(z + j)] / weight[at(j)]
    for j in range(w):
        C[at(p + z + j), at(j)] = 1.0 / weight[at(j)]
    for k in range(p):
        for j in range(w):
            C[at(k), at(j)] = M[at(k), at(p + z + j)] / weight[at(j)]
        for i in range(z):
            c[at(k)] += M[at(k), at(p + i)] * c[at(p + i)]
            _add(C, k, M[at(k), at(p + i)], p + i, 0, w)
    return C, c


@_inlined
def _dot(A, i, x):
    total = 0.0
    for j in range(len(x)):
        total += A[at(i), at(j)] * x[at(j)]
    return total


@_inlined
def _most_beyond(C, c, lower, upper, order, y):
    """The velocity farthest beyond a limit, per size of its row, and the side; -1 if none is."""
    chosen, side, most, size = -1, 0.0, 0.0, 0.0
    for j in range(len(y)):
        size += y[at(j)] * y[at(j)]
    for i in range(len(C)):
        low, high = lower[order[i]], upper[order[i]]
        if low > -np.inf or high < np.inf:
            x, norm = c[at(i)] + _dot(C, i, y), np.sqrt(_dot(C, i, C[at(i)]))
            beyond = max(low - x, x - high)
            is_beyond = beyond > _ROUND_OFF * (norm * np.sqrt(size) + abs(c[at(i)]))
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
def _hold(L, rows, beta, C, c, lower, upper, order, y):
    """Move y least, the rows of L met as before, so that C y + c is within its limits.

    A dual active-set method (Goldfarb, Idnani, Math. Programming 27, 1983): k limits hold, P has
    their rows on what L leaves free, H = P P^T, u their multipliers. Returns whether y was found
    beyond doubt.
    """
    w, most, k, steps = len(y), len(y) - rows, 0, 0
    P, step, u = np.empty((most + 1, w)), np.empty(w), np.empty(most + 1)
    H, F, r, h = np.empty((most, most)), np.empty((most, most)), np.empty(most), np.empty(most)
    while True:
        new, side = _most_beyond(C, c, lower, upper, order, y)
        if new < 0:
            return True
        limit, size = (lower if side > 0.0 else upper)[order[new]], _dot(C, new, C[at(new)])
        for j in range(w):
            P[at(k), at(j)] = side * C[at(new), at(j)]
        _project(L, rows, beta, P[k])
        u[k], is_held = 0.0, False
        while not is_held:
            steps += 1
            for a in range(k):
                h[at(a)] = side * _dot(P, a, C[at(new)])
            _multipliers(H, h, k, F, r)
            square, length, dropped = 0.0, np.inf, -1
            for j in range(w):
                step[at(j)] = P[at(k), at(j)]
                for a in range(k):
                    step[at(j)] -= r[at(a)] * P[at(a), at(j)]
                square += step[at(j)] * step[at(j)]
            moves = square > _DEPENDENT * _DEPENDENT * size
            if moves:
                length = side * (limit - c[at(new)] - _dot(C, new, y)) / square
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
                H[at(k), at(k)] = side * _dot(P, k, C[at(new)])
                k += 1
            else:
                _drop(P, H, u, dropped, k)
                k -= 1


@_inlined
def _is_sound(J_T, J_C, targets, bound):
    """Whether all numbers are finite; and whether no product of them over- or underflows."""
    is_moderate = bound < np.inf
    for square in (_square(J_T), _square(J_C), _square(targets)):
        if not square < np.inf:
            return False, False
        is_moderate = is_moderate and (square == 0.0 or 1.0 / _MODERATE < square < _MODERATE)
    return bound >= 0.0, is_moderate


@kernel(
    _int(
        _given[2], _given[2], _given[1], _given[1], _given[1], _float,
        _given[2], _given[2], _indices, _int, _int, _indices, _given[1], _given[1],
        _new[1], _new[2],
    )
)  # fmt: skip
def meet(
    J_T, J_C, targets, lower, upper, bound, S, T, order, p, z, place, weight, errors, x, reduced
):
    """Meet all rows S J rates of all levels, the weighted rates being nearest to their own.

    Args:
        J_T: Shape (m, N).
        J_C: Shape (c, N).
        targets: What all levels ask for, (t,).
        lower: Limits of all velocities, (N,); of those that are stuck they do not matter.
        upper: Likewise.
        bound: Of the errors of the entries of J_T and J_C, in natural units.
        S: Rows of the levels on the task, (k, m).
        T: Their right sides, then the rates that are wanted, per target, (k + n - z, t).
        order: The p passive velocities that move, z rates without a weight, and all other rates.
        p: Number of them.
        z: Likewise.
        place: Of each rate in this order its number among the actuators, (n,).
        weight: Of the others, (n - z,).
        errors: Size of the errors of J_C and of J_T per `bound`; parts of the sizes of J_C and of J
            up to which a singular value is in doubt; norm of S; this part of |weight| per least.
        x: Overwritten with all velocities, zero where stuck, (N,).
        reduced: Overwritten with passive velocities per rate (p, n), constraints of the rates
            (c - p, n), J (m, n), and the size of its terms (1, n), in the order of the actuators.
    """
    (m, N), c, n, k = J_T.shape, len(J_C), len(order) - p, len(S)
    q, w, right = c - p, n - z, np.zeros(len(T))
    if S.shape[1] != m or J_C.shape[1] != N or len(x) != N:
        return REFUSED
    if len(lower) != N or len(upper) != N or len(targets) != T.shape[1]:
        return REFUSED
    is_finite, is_moderate = _is_sound(J_T, J_C, targets, bound)
    if not is_finite:
        return REFUSED
    if not (is_moderate and len(reduced) == c + m + 1 and q >= 0 and z <= q + k <= n):
        return IN_DOUBT
    M, B = np.empty((c + 1, p + n)), np.empty((q + k + 1, n + 1))
    is_regular, scale, loops, task, follows = _through(J_T, J_C, order, p, errors, bound, M)
    if not is_regular:
        return IN_DOUBT
    for i in range(len(T)):
        for j in range(len(targets)):
            right[at(i)] += T[i, j] * targets[j]
    _reduce(J_T, order, p, place, M, scale, reduced)
    _stack(reduced, p, c, place, S, right, B)
    L, beta, y = np.empty((q + k - z, w + 1)), np.empty(q + k - z), np.empty(w)
    inverse, gain = _optimum(B, q + k, z, right[k:], weight, L, beta, y)
    # The least singular value of all rows is at least 1 / |B^+|, and each level's no less.
    zero = max(loops * (1.0 + np.sqrt(follows)) if q > 0 else 0.0, 2.0 * errors[4] * task)
    if not (inverse * zero * zero < 1.0 and gain * errors[5] * errors[5] < 1.0):
        return IN_DOUBT

    for j in order:
        if not lower[j] <= upper[j]:
            return REFUSED
    C, c_0 = _all_velocities(M, B, p, z, weight)
    unlimited = y.copy()
    are_held = _hold(L, q + k - z, beta, C, c_0, lower, upper, order, y)
    for j in range(N):
        x[at(j)] = 0.0
    for i in range(p + n):
        j = order[i]
        value = c_0[at(i)] + _dot(C, i, y if are_held else unlimited)
        x[j] = min(max(value, lower[j]), upper[j]) if are_held else value
    return MET if are_held else LIMITED
