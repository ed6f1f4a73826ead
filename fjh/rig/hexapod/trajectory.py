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

    Radius and angle grow with (t / duration)^exponent: 1 is a constant angular rate, 1/2 a constant
    speed except at the beginning.

    Args:
        time_s: Times, not negative, shape (N,) [s].
        radius_rad: Radius reached at `duration_s`.
        turns: Number of turns until then; positive from alpha towards beta, negative the other way.
        duration_s: Duration of the complete spiral [s].
        exponent: Exponent of the time law, above 0 and at most 1.
        start_rad: Direction in which it leaves the center, an angle [rad] from alpha towards beta.
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
