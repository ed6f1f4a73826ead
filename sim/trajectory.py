"""Desired pointing trajectories."""

import numpy as np

from sim.array import Array


def spiral(time_s: Array, radius_rad: float, turns: float, duration_s: float) -> Array:
    """Archimedean spiral (alpha, beta) from the centre outwards, shape (N, 2), [rad].

    Radius and angle grow evenly with time: `radius_rad` and `turns` are reached at `duration_s`.
    """
    progress = time_s / duration_s
    angle = 2 * np.pi * turns * progress
    radius = radius_rad * progress
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])
