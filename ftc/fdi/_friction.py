"""Physics steps with dry friction, compiled.

In each step the friction forces f minimize f'K f / 2 + f'c within their limits, by projected
Gauss-Seidel, and x' = A x + B u + G f. Arguments are those of :class:`ftc.fdi.friction.Rubbing`.
"""

import numpy as np
from numba import njit, types

from argument_checks.compilation import kernel

_1, _2, _3, _4 = (types.Array(types.float64, n, "C") for n in range(1, 5))
_counts = types.Array(types.int64, 1, "C")
_flags = types.Array(types.boolean, 2, "C")
_FASTMATH = {"reassoc", "contract"}
_SWEEPS, _CHANGE = 1000, 1e-11
"""Most sweeps of a step, and the change of a force, of its limit, at which they end."""

_inlined = njit(error_model="numpy")


@_inlined
def _held(K, c, limit, f):  # pragma: no cover
    """Forces f (r,), from those given, that are most likely to hold against c (r,)."""
    for _ in range(_SWEEPS):
        change = 0.0
        for i in range(len(c)):
            gap = c[i]
            for j in range(len(c)):
                gap += K[i, j] * f[j]
            new = min(max(f[i] - gap / K[i, i], -limit[i]), limit[i])
            change = max(change, abs(new - f[i]) / limit[i])
            f[i] = new
        if change < _CHANGE:
            return


@_inlined
def _product(A, x, out):  # pragma: no cover
    for i in range(len(out)):
        total = 0.0
        for j in range(len(x)):
            total += A[i, j] * x[j]
        out[i] = total


@_inlined
def _moved(x, driven, pulled, A, G, E, K, limit, f, c, after):  # pragma: no cover
    """Move x (s,) by a step, in place; `driven` is B u and `pulled` D u."""
    _product(E, x, c)
    for i in range(len(c)):
        c[i] += pulled[i]
    _held(K, c, limit, f)
    _product(A, x, after)
    for i in range(len(x)):
        total = after[i] + driven[i]
        for j in range(len(f)):
            total += G[i, j] * f[j]
        x[i] = total


@kernel(
    types.void(_2, _2, _2, _2, _2, _2, _2, _2, _1, types.int64),
    fastmath=_FASTMATH,
)
def slide(X, U, A, B, G, E, D, K, limit, steps_a_tick):  # pragma: no cover
    """States X (S, s) after a control tick with inputs U (S, n + 1), in place."""
    s, r = len(A), len(K)
    driven, after = np.empty(s), np.empty(s)
    pulled, f, c = np.empty(r), np.zeros(r), np.empty(r)
    for k in range(len(X)):
        _product(B, U[k], driven)
        _product(D, U[k], pulled)
        f[:] = 0.0
        for _ in range(steps_a_tick):
            _moved(X[k], driven, pulled, A, G, E, K, limit, f, c, after)


@_inlined
def _slopes(held, A, G, E, K):  # pragma: no cover
    """How the state after a step depends on that before it, (s, s), where places (r,) are held.

    The others, at their limit, pull as hard as before.
    """
    r, s = E.shape
    change, M = np.zeros((r, s)), np.eye(r)
    for i in range(r):
        if held[i]:
            M[i], change[i] = K[i], -E[i]
    return A + np.dot(G, np.linalg.solve(M, change))


@kernel(
    types.void(
        *(_flags, _4, _4, _4, _1, _3, types.int64, types.int64, types.float64),
        *(_3, _3, _3, _3, _3, _3, _2, _3, _counts),
    ),
    fastmath=_FASTMATH,
)
def slide_samples(
    steps,
    before,
    X,
    outputs,
    v,
    lifted,
    ticks,
    first,
    spread,
    A,
    B,
    G,
    E,
    D,
    K,
    limit,
    C,
    steps_a_tick,
):  # pragma: no cover
    """Correct samples that were stepped without friction, of H models and K onsets, in place.

    `before` and X (H, K, rows, s) are the states before and after, `outputs` (H, K, rows, p) those
    of the sample: of the model in the first row, and first-order deviations in the others. From row
    `first` on they are what one limit, `spread` smaller, takes away; none where that is zero.
    """
    H, N, rows, s = X.shape
    r, n, p = K.shape[1], B.shape[2] - 1, C.shape[1]
    u, x, mean, after = np.empty(n + 1), np.empty(s), np.empty(s), np.empty(s)
    driven, pulled, f, c = np.empty(s), np.empty(r), np.empty(r), np.empty(r)
    other, seen, W, slopes = np.empty(r), np.empty(p), np.empty((s, s)), np.empty((s, s))
    varied = r if spread > 0.0 else 0
    forces, held = np.empty((ticks * steps_a_tick.max(), r)), np.empty(r, dtype=np.bool_)
    u[:n], u[n] = v[:n], 1.0
    for h in range(H):
        _product(B[h], u, driven)
        _product(D[h], u, pulled)
        held[:], slopes[:] = False, A[h]
        for k in range(N):
            if not steps[h, k]:
                continue
            x[:], mean[:], f[:], W[:] = before[h, k, 0], 0.0, 0.0, np.eye(s)
            step = 0
            for _ in range(ticks):
                mean += x / ticks
                for _ in range(steps_a_tick[h]):
                    _moved(x, driven, pulled, A[h], G[h], E[h], K[h], limit[h], f, c, after)
                    forces[step] = f
                    step += 1
                    same = True
                    for i in range(r):
                        holds = abs(f[i]) < limit[h, i]
                        same &= holds == held[i]
                        held[i] = holds
                    if not same:  # from one onset, and one step, to the next it seldom changes
                        slopes[:] = _slopes(held, A[h], G[h], E[h], K[h])
                    W[:] = np.dot(slopes, W)
            X[h, k, 0] = x
            _product(C[h], mean, outputs[h, k, 0])
            for row in range(1, rows):
                if first <= row < first + varied:
                    continue
                for i in range(s):
                    for j in range(s):
                        X[h, k, row, i] += (W[i, j] - lifted[h, i, j]) * before[h, k, row, j]
            for j in range(varied):
                row = first + j
                other[:] = limit[h]
                other[j] *= 1.0 - spread
                x[:], mean[:], step = before[h, k, 0] - before[h, k, row], 0.0, 0
                for _ in range(ticks):
                    mean += x / ticks
                    for _ in range(steps_a_tick[h]):
                        f[:] = forces[step]  # near those that are looked for
                        step += 1
                        _moved(x, driven, pulled, A[h], G[h], E[h], K[h], other, f, c, after)
                X[h, k, row] = X[h, k, 0] - x
                _product(C[h], mean, seen)
                outputs[h, k, row] = outputs[h, k, 0] - seen
