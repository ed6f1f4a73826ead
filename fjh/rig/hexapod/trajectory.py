"""Desired pointing trajectories."""

import numpy as np

import argument_checks as check
from sim import Array


def spiral(
    time_s: Array,
    radius_rad: float,
    turns: float,
    duration_s: float,
    *,
    exponent: float = 1.0,
    start_rad: float = 0.0,
) -> Array:
    """Return an Archimedean spiral (alpha, beta) from the center outwards, shape (N, 2), [rad].

    Radius and angle grow with (t / duration)^exponent: in proportion to time with 1; at constant
    speed with 1/2, except for the first part of a turn.

    Args:
        time_s: Times, not negative, shape (N,) [s].
        radius_rad: Radius reached at `duration_s`.
        turns: Turns made by then; positive from alpha towards beta, negative the other way.
        duration_s: Duration of the complete spiral [s].
        exponent: Exponent of the time law, above 0 and at most 1.
        start_rad: Direction in which it leaves the center, from alpha towards beta.
    """
    time_s = check.array("time_s", time_s, None, least=0.0)
    check.number("radius_rad", radius_rad)
    check.number("turns", turns)
    check.number("exponent", exponent, check.SMALLEST, 1.0)
    progress = time_s / check.number("duration_s", duration_s, check.SMALLEST)
    if exponent != 1.0:
        progress = progress**exponent
    angle = 2 * np.pi * turns * progress + check.number("start_rad", start_rad)
    radius = radius_rad * progress
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])
