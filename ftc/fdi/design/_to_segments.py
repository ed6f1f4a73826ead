"""Mahalanobis distances of points from segments, each pair with a covariance of its own; compiled.

By Cholesky factors: half the work of a general solution, and a forward substitution is enough.
"""

import numpy as np
from numba import types

from argument_checks.compilation import kernel

_2, _3 = (types.Array(types.float64, n, "C", readonly=True) for n in (2, 3))
_out = types.Array(types.float64, 2, "C")
_FASTMATH = {"reassoc", "contract"}
_PIVOT = 1e-13
"""Part of its variance below which a pivot is round-off."""


@kernel(types.void(_2, _2, _2, _3, _3, _out), fastmath=_FASTMATH)
def to_segments(points, starts, ways, own, other, distance):  # pragma: no cover
    """Fill `distance` (H, E) of points (H, d) from starts + t ways (E, d), t in 0..1.

    The covariance is own + other, of (H, d, d) and (E, d, d), or one for all (1, d, d).
    """
    H, d = points.shape
    L, a, b = np.empty((d, d)), np.empty(d), np.empty(d)
    for h in range(H):
        for e in range(len(starts)):
            if (h == 0 and e == 0) or len(own) > 1 or len(other) > 1:
                P, Q = own[h % len(own)], other[e % len(other)]
                for i in range(d):
                    for j in range(i + 1):
                        total = P[i, j] + Q[i, j]
                        for k in range(j):
                            total -= L[i, k] * L[j, k]
                        if i == j:
                            L[i, i] = np.sqrt(max(total, _PIVOT * (P[i, i] + Q[i, i])))
                        else:
                            L[i, j] = total / L[j, j]
            aa = ab = bb = 0.0
            for i in range(d):
                from_start, along = points[h, i] - starts[e, i], ways[e, i]
                for k in range(i):
                    from_start -= L[i, k] * a[k]
                    along -= L[i, k] * b[k]
                a[i], b[i] = from_start / L[i, i], along / L[i, i]
                ab += a[i] * b[i]
                bb += b[i] * b[i]
            t = min(max(ab / bb, 0.0), 1.0) if bb > 0.0 else 0.0
            for i in range(d):
                aa += (a[i] - t * b[i]) ** 2
            distance[h, e] = np.sqrt(aa)
