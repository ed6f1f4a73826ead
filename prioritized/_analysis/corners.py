"""Corners of a polytope that is given by half-spaces."""

import numpy as np

from argument_checks import Array, Indices
from argument_checks.ties import ACCURACY, ascending, ranks


def corners(normal: Array, distance: Array) -> Array:
    """Corners (V, k) of the bounded set {z : normal @ z <= distance}, each once.

    In the plane counter-clockwise.

    No rows where the set has no interior.

    Args:
        normal: Shape (F, k).
        distance: Shape (F,); what is infinite bounds nothing.
    """
    # Together they take as long to import as all of the library.
    from scipy.optimize import linprog
    from scipy.spatial import ConvexHull, HalfspaceIntersection

    k = normal.shape[1]
    length = np.linalg.norm(normal, axis=1)
    real = np.isfinite(distance) & (length > 0.0)
    if not k or not real.any():
        return np.zeros((1, k))
    A, b = normal[real] / length[real, None], distance[real] / length[real]
    size = np.abs(b).max() or 1.0
    # Equal actuators give equal half-spaces, whose corners would be as many as round-off makes.
    once = _distinct(np.column_stack([A, b / size]))
    A, b = A[once], b[once]
    # The center of the largest ball inside.
    inside = linprog(
        -np.eye(k + 1)[k],
        A_ub=np.column_stack([A, np.ones(len(A))]),
        b_ub=b / size,
        bounds=[(None, None)] * k + [(None, 1.0)],
    )
    if not inside.success or inside.x[k] < ACCURACY:  # thinner ones have no inside for qhull
        return np.zeros((0, k))
    if k == 1:
        lowest, highest = -b[A[:, 0] < 0].min(), b[A[:, 0] > 0].min()
        return np.array([[lowest], [highest]])
    met = HalfspaceIntersection(np.column_stack([A, -b / size]), inside.x[:k]).intersections
    met = met[_distinct(met)]
    return size * met[ConvexHull(met).vertices]


def in_order(corners: Array) -> Array:
    """Corners (V, k) in an order that is the same on every processor.

    In the plane they stay in theirs and begin with the last of the lexicographic order; elsewhere
    the order is lexicographic.
    """
    order = ascending(*corners.T, zero=ACCURACY * np.abs(corners).max(initial=0.0))
    return np.roll(corners, -order[-1], axis=0) if corners.shape[1] == 2 else corners[order]


def _distinct(points: Array) -> Indices:
    """The first of each set of equal points (P, k) of a size of one, in their order."""
    alike = np.stack([ranks(column, zero=ACCURACY) for column in points.T], axis=1)
    return np.sort(np.unique(alike, axis=0, return_index=True)[1])
