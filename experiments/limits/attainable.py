"""Pointing that a box of displacements allows: an oracle by enumeration, without an optimizer."""

from itertools import product

import numpy as np
from scipy.spatial import ConvexHull

from sim import Array


def outline(J_m: Array, lower: Array, upper: Array) -> Array:
    """Corners of the convex set {J_m l : lower <= l <= upper}, counter-clockwise, shape (k, 2)."""
    corners = np.array(list(product(*zip(lower, upper, strict=True)))) @ J_m.T
    return corners[ConvexHull(corners).vertices]


def room(corners: Array, points: Array) -> Array:
    """Distance of points (N, 2) from the outline, shape (N,): positive inside, negative outside."""
    begin, along = corners, np.roll(corners, -1, axis=0) - corners
    length = np.linalg.norm(along, axis=1)
    off = points[:, None] - begin
    part = (off * along).sum(axis=2) / length**2
    nearest = off - part.clip(0, 1)[..., None] * along
    distance = np.linalg.norm(nearest, axis=2).min(axis=1)
    inward = (along[:, 0] * off[..., 1] - along[:, 1] * off[..., 0]) / length
    return np.where((inward >= 0).all(axis=1), distance, -distance)
