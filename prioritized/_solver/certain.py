"""Whether matrices are clearly of full rank, compiled: a bound in place of singular values.

All compiled code of an entry point stands in one file, because the compiler's cache notices a
change of that file alone.
"""

import numpy as np
from numba import types

from argument_checks.compilation import kernel

at = np.uint64
"""An index that cannot be negative: the compiler then leaves out Python's counting from the end."""


@kernel(
    types.boolean(
        types.Array(types.float64, 2, "C"),
        types.Array(types.int64, 1, "C", readonly=True),
        types.Array(types.float64, 1, "C", readonly=True),
    )
)
def all_exceed(A, ends, least):
    """Whether the first ends[k] rows of A have singular values above least[k] alone, for every k.

    A = L Q, and |L_k^-1| in the Frobenius norm is at least that in the 2-norm, 1 / sigma_min. The
    inverse of a leading block L_k of a triangle is the leading block of its inverse. True is a
    proof but for round-off, of some 1e-15 of |A|; False says nothing. A is overwritten.
    """
    rows, n = A.shape
    if rows > n:
        return False
    diagonal, inverse = np.empty(rows), np.empty(rows)
    for i in range(rows):
        square = 0.0
        for j in range(i, n):
            square += A[at(i), at(j)] * A[at(i), at(j)]
        norm = np.sqrt(square)
        if not norm > 0.0:
            return False
        first = np.copysign(norm, A[at(i), at(i)])
        A[at(i), at(i)] += first
        diagonal[at(i)] = -first
        beta = 1.0 / (norm * abs(A[at(i), at(i)]))
        for r in range(i + 1, rows):
            dot = 0.0
            for j in range(i, n):
                dot += A[at(i), at(j)] * A[at(r), at(j)]
            dot *= beta
            for j in range(i, n):
                A[at(r), at(j)] -= dot * A[at(i), at(j)]
    total, k = 0.0, 0
    for i in range(rows):
        # Row i of the inverse, from the diagonal to the left.
        for j in range(i, -1, -1):
            rest = 1.0 if j == i else 0.0
            for c in range(j + 1, i + 1):
                rest -= inverse[at(c)] * A[at(c), at(j)]
            inverse[at(j)] = rest / diagonal[at(j)]
            total += inverse[at(j)] * inverse[at(j)]
        while k < len(ends) and ends[k] == i + 1:
            if not np.sqrt(total) * least[k] < 1.0:
                return False
            k += 1
    return True
