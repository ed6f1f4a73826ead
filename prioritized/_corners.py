"""Corners of a polytope that is given by half-spaces."""

import numpy as np

from argument_checks import Array

THINNEST = 1e-9
"""Part of the largest distance; thinner polytopes have no inside that qhull could start from."""


def corners(normal: Array, distance: Array) -> Array:
    """Corners (V, k) of the bounded set {z : normal @ z <= distance}; in the plane in their order.

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
    # The center of the largest ball inside.
    inside = linprog(
        -np.eye(k + 1)[k],
        A_ub=np.column_stack([A, np.ones(len(A))]),
        b_ub=b / size,
        bounds=[(None, None)] * k + [(None, 1.0)],
    )
    if not inside.success or inside.x[k] < THINNEST:
        return np.zeros((0, k))
    if k == 1:
        lowest, highest = -b[A[:, 0] < 0].min(), b[A[:, 0] > 0].min()
        return np.array([[lowest], [highest]])
    met = HalfspaceIntersection(np.column_stack([A, -b / size]), inside.x[:k]).intersections
    return size * met[ConvexHull(met).vertices]
