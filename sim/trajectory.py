"""Desired pointing trajectories."""

import numpy as np

from sim.array import Array


def spiral(
    time_s: Array,
    radius_rad: float,
    turns: float,
    duration_s: float,
    *,
    exponent: float = 1.0,
    start_rad: float = 0.0,
) -> Array:
    """Archimedean spiral (alpha, beta) from the centre outwards, shape (N, 2), [rad].

    Radius and angle grow with (t / duration)^exponent: evenly in time with 1; with 1/2 the path is
    followed at constant speed, but for the first part of a turn.

    Args:
        time_s: Shape (N,).
        radius_rad: Reached at `duration_s`.
        turns: Made by then; positive from alpha towards beta, negative the other way.
        duration_s: Of the whole spiral.
        exponent: Of the law of time.
        start_rad: Direction in which it leaves the centre, from alpha towards beta.
    """
    progress = time_s / duration_s
    if exponent != 1.0:
        progress = progress**exponent
    angle = 2 * np.pi * turns * progress + start_rad
    radius = radius_rad * progress
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])
