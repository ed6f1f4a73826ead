"""Desired pointing trajectories."""

import numpy as np

import argument_checks as check
from sim.array import Array


def spiral(time_s: Array, radius_rad: float, turns: float, duration_s: float) -> Array:
    """Archimedean spiral (alpha, beta) from the centre outwards, shape (N, 2), [rad].

    Radius and angle grow evenly with time: `radius_rad` and `turns` are reached at `duration_s`.

    Raises:
        ValueError: Times that are no vector, or numbers that are not finite; a duration that is
            not positive.
    """
    time_s = check.finite("time_s", time_s)
    if time_s.ndim != 1:
        raise ValueError(f"time_s must be a vector, got shape {time_s.shape}")
    check.signed("radius_rad", radius_rad)
    check.signed("turns", turns)
    progress = time_s / check.positive("duration_s", duration_s)
    angle = 2 * np.pi * turns * progress
    radius = radius_rad * progress
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])
