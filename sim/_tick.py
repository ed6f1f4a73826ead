"""What a simulated control tick computes, compiled: poses, a hexapod's struts, clipping.

A batch is one after another. All compiled code stands in one file, because the compiler's
cache notices a change of that file alone.
"""

import numpy as np
from numba import njit, types

from argument_checks.compilation import kernel

FOUND, SINGULAR, NO_LENGTH = 0, 1, 2
"""All is well; the struts do not determine the twist, or one too large; a strut has no length."""

_DEPENDENT = 1e-12
"""Part of a column below which a pivot is round-off."""
_COINCIDENT_M = 5e-15
"""Half of a gap that is round-off."""
_MOST = 1e240
"""Square of the largest number that the argument checks let pass."""

_any = {k: types.Array(types.float64, k, "A", readonly=True) for k in (1, 2, 3)}
_new = {k: types.Array(types.float64, k, "C") for k in (1, 2, 3)}
_places = types.Array(types.int64, 1, "A", readonly=True)
_inlined = njit(error_model="numpy")


def _compiled(*arguments):
    """Compiled when this module is first imported, then read from the cache."""
    return kernel(types.int64(*arguments))


@_inlined
def _move(R, t, twist, R_new, t_new):
    """Turn about the rotation vector by Rodrigues' formula, then shift."""
    x, y, z = twist[0], twist[1], twist[2]
    square = x * x + y * y + z * z
    half = 0.5 * np.sqrt(square)
    # sin(angle) / angle and (1 - cos(angle)) / angle^2, without cancellation.
    sinc = np.sin(half) / half if half > 0.0 else 1.0
    s, c = sinc * np.cos(half), 0.5 * sinc * sinc
    for j in range(3):
        a, b, d = R[0, j], R[1, j], R[2, j]
        along = c * (x * a + y * b + z * d)
        # As increments: a factor of nearly 1 would round the same way at every tick.
        R_new[0, j] = a + (s * (y * d - z * b) + (along * x - c * square * a))
        R_new[1, j] = b + (s * (z * a - x * d) + (along * y - c * square * b))
        R_new[2, j] = d + (s * (x * b - y * a) + (along * z - c * square * d))
    for i in range(3):
        t_new[i] = t[i] + twist[3 + i]


@_inlined
def _lengths(bottom, top, R, t, length, A):
    """Lengths of the struts and rows [(R a) x u, u]; of one without length NaN."""
    found = FOUND
    for k in range(len(top)):
        a0 = R[0, 0] * top[k, 0] + R[0, 1] * top[k, 1] + R[0, 2] * top[k, 2]
        a1 = R[1, 0] * top[k, 0] + R[1, 1] * top[k, 1] + R[1, 2] * top[k, 2]
        a2 = R[2, 0] * top[k, 0] + R[2, 1] * top[k, 1] + R[2, 2] * top[k, 2]
        u0 = a0 + (t[0] - bottom[k, 0])
        u1 = a1 + (t[1] - bottom[k, 1])
        u2 = a2 + (t[2] - bottom[k, 2])
        length[k] = np.sqrt(u0 * u0 + u1 * u1 + u2 * u2)
        if length[k] == 0.0:
            found = NO_LENGTH
        u0, u1, u2 = u0 / length[k], u1 / length[k], u2 / length[k]
        A[k, 0], A[k, 1], A[k, 2] = a1 * u2 - a2 * u1, a2 * u0 - a0 * u2, a0 * u1 - a1 * u0
        A[k, 3], A[k, 4], A[k, 5] = u0, u1, u2
    return found


@_inlined
def _solve(A, X):
    """Overwrite X by the solution of A X = X, and A by its factors: Gauss, partial pivoting."""
    n, columns = X.shape
    size = np.zeros(n)
    for i in range(n):
        for r in range(n):
            size[i] = max(size[i], abs(A[r, i]))
    for i in range(n):
        pivot = i
        for r in range(i + 1, n):
            if abs(A[r, i]) > abs(A[pivot, i]):
                pivot = r
        if not abs(A[pivot, i]) > _DEPENDENT * size[i]:
            return SINGULAR
        if pivot != i:
            for j in range(i, n):
                A[i, j], A[pivot, j] = A[pivot, j], A[i, j]
            for j in range(columns):
                X[i, j], X[pivot, j] = X[pivot, j], X[i, j]
        for r in range(i + 1, n):
            factor = A[r, i] / A[i, i]
            for j in range(i + 1, n):
                A[r, j] -= factor * A[i, j]
            for j in range(columns):
                X[r, j] -= factor * X[i, j]
    for i in range(n - 1, -1, -1):
        for j in range(columns):
            for k in range(i + 1, n):
                X[i, j] -= A[i, k] * X[k, j]
            X[i, j] /= A[i, i]
    return FOUND if _square(X) < _MOST else SINGULAR  # NaN is neither


@_inlined
def _turn(E, vector):
    """The vector of a rotation (3, 3), and its angle; by its quaternion."""
    trace = E[0, 0] + E[1, 1] + E[2, 2]
    k = 0
    for i in range(1, 3):
        if E[i, i] > E[k, k]:
            k = i
    i, j = (k + 1) % 3, (k + 2) % 3
    if trace > E[k, k]:
        w = 1.0 + trace
        vector[0], vector[1] = E[2, 1] - E[1, 2], E[0, 2] - E[2, 0]
        vector[2] = E[1, 0] - E[0, 1]
    else:
        w = E[j, i] - E[i, j]
        vector[k] = 1.0 + E[k, k] - E[i, i] - E[j, j]
        vector[i], vector[j] = E[i, k] + E[k, i], E[j, k] + E[k, j]
        if w < 0.0:
            w = -w
            for n in range(3):
                vector[n] = -vector[n]
    sine = np.sqrt(vector[0] ** 2 + vector[1] ** 2 + vector[2] ** 2)
    angle = 2.0 * np.arctan2(sine, w)
    for n in range(3):
        vector[n] *= angle / sine if sine > 0.0 else 0.0
    return angle


@_inlined
def _square(A):
    total = 0.0
    for row in A:
        for x in row:
            total += x * x
    return total


@_compiled(_any[3], _any[2], _any[2], _new[3], _new[2])
def move(R, t, twist, R_new, t_new):
    """Poses (B, 3, 3), (B, 3) after displacements (B, 6), written to the last two."""
    for k in range(len(t)):
        _move(R[k], t[k], twist[k], R_new[k], t_new[k])
    return FOUND


@_compiled(_any[2], _any[2], _any[3], _any[2], _new[2], _new[3])
def lengths(bottom, top, R, t, length, A):
    """Strut lengths (B, n) and A (B, n, 6) at poses, written to the last two; or NO_LENGTH."""
    found = FOUND
    for k in range(len(t)):
        found = max(found, _lengths(bottom, top, R[k], t[k], length[k], A[k]))
    return found


@_compiled(_any[2], _new[2])
def solve(A, X):
    """Overwrite X (n, k) by the solution of A X = X, A being (n, n); or SINGULAR."""
    return _solve(A.copy(), X)


@_compiled(_any[2], _new[2], types.float64)
def invert(A, inverse, most):
    """Write the inverse of A (n, n); SINGULAR unless |A| |inverse| is below `most`.

    These are Frobenius norms, so that their product is no less than the condition number.
    """
    inverse[:] = 0.0
    for i in range(len(A)):
        inverse[i, i] = 1.0
    if _solve(A.copy(), inverse) != FOUND:
        return SINGULAR
    return FOUND if _square(A) * _square(inverse) < most * most else SINGULAR


@_compiled(*[_any[2]] * 2, _any[1], *[_any[2], _any[1]] * 2, _any[1], *[_new[2], _new[1]] * 2)
def follow(bottom, top, nominal, R, t, A, moved, asked, R_new, t_new, A_new, moved_new):
    """One Newton step on the strut lengths, from displacements `moved` to those asked.

    Displacements are lengths less the nominal ones; the last four arguments are overwritten.
    """
    step = (asked - moved).reshape(-1, 1)
    found = _solve(A.copy(), step)
    if found != FOUND:
        return found
    _move(R, t, step[:, 0], R_new, t_new)
    found = _lengths(bottom, top, R_new, t_new, moved_new, A_new)
    for k in range(len(moved_new)):
        moved_new[k] -= nominal[k]
    return found


@_compiled(*[_any[2]] * 2, types.int64, _any[2], types.int64, _any[2], _any[1], _new[2], _new[1])
def seen_from(xmat, xpos, frame, base_xmat, base, R_0, p_0, R, t):
    """Write the motion (3, 3), (3,) of a frame since its nominal pose, in present base axes.

    Args:
        xmat: Rotations in the world, as MuJoCo keeps them, (K, 9).
        xpos: Positions, (K, 3).
        frame: Which of them.
        base_xmat: Likewise, of the base.
        base: Which of them.
        R_0: From world axes to those of the frame, nominally, (3, 3).
        p_0: Nominal position, (3,).
        R: R_now R_nominal^T.
        t: Translation.
    """
    for i in range(3):
        t[i] = 0.0
        for k in range(3):
            t[i] += base_xmat[base, 3 * k + i] * (xpos[frame, k] - p_0[k])
    for i in range(3):
        for j in range(3):
            R[i, j] = 0.0
            for k in range(3):
                turned, back = 0.0, 0.0
                for u in range(3):
                    turned += base_xmat[base, 3 * u + i] * xmat[frame, 3 * u + k]
                    back += R_0[k, u] * base_xmat[base, 3 * u + j]
                R[i, j] += turned * back
    return FOUND


@kernel(types.float64(_any[1], types.Array(types.int32, 1, "A"), _any[1], types.int64))
def largest_gap(gaps, owners, counts, rows):
    """Largest of the first rows' gaps, each times the number that its owner counts."""
    largest = 0.0
    for i in range(rows):
        largest = max(largest, abs(gaps[i] * counts[owners[i]]))
    return largest


@kernel(types.float64(_any[1], _any[1]))
def largest(gaps, units):
    """Of the gaps times their units, as many as there are units; NaN if one is NaN."""
    most = 0.0
    for i in range(len(units)):
        gap = abs(gaps[i] * units[i])
        if not gap <= most:
            most = gap
        if not most < np.inf:
            break
    return most


@kernel(types.void(_any[1], _any[2], _places, _any[2], _new[2]))
def at_midpoints(gaps, axes, points, carried, J):
    """Take rows of pairs of anchors as at their midpoints: see `Closures.write_rows`.

    Three rows of `points` belong to each pair, whose gap is D; a joint that carries it moves it by
    half of D x axis besides.
    """
    for i in range(0, len(points), 3):
        D = gaps[points[i]] / 2, gaps[points[i + 1]] / 2, gaps[points[i + 2]] / 2
        if max(abs(D[0]), abs(D[1]), abs(D[2])) > _COINCIDENT_M:
            for j in range(len(axes)):
                if carried[i, j] != 0.0:
                    x, y, z = axes[j, 0], axes[j, 1], axes[j, 2]
                    J[points[i], j] += (D[1] * z - D[2] * y) * carried[i, j]
                    J[points[i + 1], j] += (D[2] * x - D[0] * z) * carried[i, j]
                    J[points[i + 2], j] += (D[0] * y - D[1] * x) * carried[i, j]


@_compiled(
    *(types.int64, _any[1], types.Array(types.int32, 1, "A"), types.int64, _any[1]),
    *(_any[2], _any[2], types.int64, _any[2], types.int64, _any[2], _any[1]),
    *(_any[1], _places, _places, _any[1], _places, _places, _any[1], _any[1], _any[1]),
    *(_new[3], _new[2], _new[2], _new[1], _new[2], _new[2]),
)
def observe(
    k, gaps, owners, rows, counts,
    xmat, xpos, frame, base_xmat, base, R_0, p_0,
    qpos, joints, at, lengths, others, outputs, gear, nominal, forces,
    R, t, displacements, gap, all_qpos, all_forces,
):  # fmt: skip
    """Write tick k of a log, whose arrays the last line has: pose, drives, loops, joints, forces.

    The first two lines are as of `largest_gap` and `seen_from`. Drives number `joints` are read in
    qpos, `at` these places; number `others` in the lengths of actuators, at `outputs`, divided by
    their gear; both from their nominal displacements (n,). Of joints and forces a log may have no
    columns.
    """
    seen_from(xmat, xpos, frame, base_xmat, base, R_0, p_0, R[k], t[k])
    for i in range(len(joints)):
        displacements[k, joints[i]] = qpos[at[i]] - nominal[joints[i]]
    for i in range(len(others)):
        displacements[k, others[i]] = lengths[outputs[i]] / gear[i] - nominal[others[i]]
    gap[k] = largest_gap(gaps, owners, counts, rows)
    for i in range(all_qpos.shape[1]):  # none if they are not kept
        all_qpos[k, i] = qpos[i]
    for i in range(all_forces.shape[1]):
        all_forces[k, i] = forces[i]
    return FOUND


@_compiled(_any[2], *[types.float64] * 3, _any[1], _new[1])
def spot(R, focal, half_width, deviation, noise, seen):
    """Write the angles (2,) at which a detector sees a beam along z, from a payload turned by R.

    The spot has `noise` times `deviation` added, and stays on the detector.
    """
    for i in range(2):
        at = focal * R[2, i] / R[2, 2] + deviation * noise[i]
        at = min(max(at, -half_width), half_width) / focal
        seen[1 - i] = -at if i == 0 else at
    return FOUND


@_compiled(_any[1], *[types.float64] * 4, types.boolean, _new[1])
def convert(x, factor, lower, upper, gain, whole, y):
    """Write x times a factor, rounded to a whole number if so asked, within limits; times a gain.

    NaN stays NaN.
    """
    for i in range(len(x)):
        value = x[i] * factor
        if whole:
            value = np.rint(value)
        y[i] = gain * (lower if value < lower else upper if value > upper else value)
    return FOUND


@kernel(types.float64(_any[2], _any[1], _any[2], _any[1], _new[1]))
def way(R, p, R_to, p_to, way):
    """[rotation vector; translation] (6,) from one pose to another, and the angle of the first."""
    E = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            E[i, j] = R_to[i, 0] * R[j, 0] + R_to[i, 1] * R[j, 1] + R_to[i, 2] * R[j, 2]
        way[3 + i] = p_to[i] - p[i]
    return _turn(E, way)
