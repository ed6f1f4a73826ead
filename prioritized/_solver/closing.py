"""Elimination of passive velocities, compiled: square loops far from singular; bases of the rest.

All compiled code of an entry point stands in one file, because the compiler's cache notices a
change of that file alone.
"""

import numpy as np
from numba import njit, types

from argument_checks.compilation import kernel
from argument_checks.ties import ACCURACY

_given = types.Array(types.float64, 2, "C", readonly=True)
_indices = types.Array(types.intp, 1, "C", readonly=True)
_new = types.Array(types.float64, 2, "C")
_bases = types.Array(types.float64, 3, "C")
_float = types.float64
at = np.uint64
"""An index that cannot be negative: the compiler then leaves out Python's counting from the end."""


_inlined = njit(error_model="numpy")
_sum = njit(error_model="numpy", fastmath={"reassoc"})
"""In whatever order is fastest."""


@_sum
def _square(A):
    """Sum of the squares of all numbers."""
    total = 0.0
    for x in A.flat:
        total += x * x
    return total


@_inlined
def _fullest_last(J_C, moving):
    """The columns of J_Cp with the fewest numbers first: elimination then fills in fewer."""
    p = len(moving)
    filled = np.zeros(J_C.shape[1], np.int64)
    for i in range(len(J_C)):
        for j in range(J_C.shape[1]):
            filled[j] += J_C[i, j] != 0.0
    order = np.empty(p, np.int64)
    for k in range(p):  # by insertion
        place = k
        while place > 0 and filled[moving[order[place - 1]]] > filled[moving[k]]:
            order[place] = order[place - 1]
            place -= 1
        order[place] = k
    return order


@_inlined
def _subtract(M, target, source, factor, first, last):
    """Subtract a multiple of one part of M from another of the same columns."""
    for j in range(first, last):
        M[at(target + j)] -= factor * M[at(source + j)]


@kernel(types.boolean(_given, _indices, _indices, _float, _new, _new))
def close(J_C, active, moving, clear, closing, gain):
    """Solve J_Cp [closing, -gain] = [1, J_Ca] by Gaussian elimination with row pivots.

    Args:
        J_C: Rows of the loops, (p, N).
        active: Velocity indices of J_Ca, (n,).
        moving: Those of J_Cp, (p,).
        clear: Fraction of |J_C| above which a singular value is clearly not zero.
        closing: Overwritten with the inverse of J_Cp, (p, p).
        gain: Overwritten, (p, n).

    Returns:
        Whether no singular value of J_Cp is below that: the least is at least 1 / |J_Cp^-1|, in the
        Frobenius norm. Otherwise the numbers mean nothing.
    """
    p, n = len(moving), len(active)
    w = 2 * p + n
    order, row = _fullest_last(J_C, moving), np.arange(p) * w
    M = np.zeros(p * w)
    for i in range(p):
        own = i * w
        for k in range(p):
            M[at(own + k)] = J_C[i, moving[order[k]]]
        M[at(own + p + i)] = 1.0
        for k in range(n):
            M[at(own + 2 * p + k)] = J_C[i, active[k]]
    for k in range(p):
        best = k
        for i in range(k + 1, p):
            if abs(M[at(row[i] + k)]) > abs(M[at(row[best] + k)]):
                best = i
        row[k], row[best] = row[best], row[k]
        pivot = M[at(row[k] + k)]
        if pivot == 0.0:
            return False
        for i in range(k + 1, p):
            below = M[at(row[i] + k)]
            if below != 0.0:  # loops share few joints
                _subtract(M, row[i], row[k], below / pivot, k + 1, w)
    for k in range(p - 1, -1, -1):
        pivot = M[at(row[k] + k)]
        for j in range(p, w):
            M[at(row[k] + j)] /= pivot
        for i in range(k):
            above = M[at(row[i] + k)]
            if above != 0.0:
                _subtract(M, row[i], row[k], above, p, w)
        for j in range(p):
            closing[order[k], j] = M[at(row[k] + p + j)]
        for j in range(n):
            gain[order[k], j] = -M[at(row[k] + 2 * p + j)]
    return bool(clear * np.sqrt(_square(J_C)) * np.sqrt(_square(closing)) < 1.0)


@kernel(_float(_given, _indices, _indices, _given, _new))
def reduce(J_T, active, moving, gain, J):
    """Write J = J_Ta + J_Tp gain, eq. (14), (m, n), and return the size of the two terms."""
    m, n = J.shape
    through = 0.0
    for t in range(m):
        for j in range(n):
            J[t, j] = J_T[t, active[j]]
    for k in range(len(moving)):
        column, follows = 0.0, 0.0
        for j in range(n):
            follows += gain[k, j] * gain[k, j]
        for t in range(m):
            moved = J_T[t, moving[k]]
            column += moved * moved
            if moved != 0.0:
                for j in range(n):
                    J[t, j] += moved * gain[k, j]
        # A fast passive joint adds to the size only if it moves the task.
        through += column * follows
    return np.sqrt(_square(J_T)) + np.sqrt(through)


@kernel(types.void(_bases, _bases))
def canonical(rest, made):
    """Write to `made` the bases of :func:`prioritized.canonical_basis`, (B, N, k).

    Args:
        rest: Orthonormal columns, of which zero ones come last then, (B, N, k); overwritten.
        made: Zeros of the same shape.
    """
    N, k = rest.shape[1:]
    along = np.empty(k)
    for b in range(len(rest)):
        for t in range(k):
            pivot, most, left = 0, 0.0, 0.0
            for i in range(N):
                square = 0.0
                for j in range(k):
                    square += rest[b, i, j] * rest[b, i, j]
                left += square
                if square > most * (1.0 + ACCURACY):
                    pivot, most = i, square
            if left < 0.5:  # what is left has the dimension that is left
                break
            for j in range(k):
                along[j] = rest[b, pivot, j] / np.sqrt(most)
            for i in range(N):
                part = 0.0
                for j in range(k):
                    part += rest[b, i, j] * along[j]
                made[b, i, t] = part
                for j in range(k):
                    rest[b, i, j] -= part * along[j]
