"""Room in what the limits allow of the pointing."""

import numpy as np

from sim import Array


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
