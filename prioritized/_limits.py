"""Limits of rates, torques, or any unknowns: a lower and an upper one for each."""

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

import argument_checks as check
from argument_checks import Array
from prioritized._arrays import read_only

Limits = tuple[Array, Array]
"""Lower and upper limits, (n,) each, infinite where there is none."""


def limits(name: str, value: tuple[ArrayLike, ArrayLike] | None, n: int) -> Limits:
    """Lower and upper limits of n actuators, read-only, shape (n,) each; None is infinite.

    Each of the pair is n numbers, or one for all. Equal limits are a lock.

    Raises:
        ValueError: Not a pair, a wrong length, NaN, or a lower limit above the upper one.
    """
    if value is None:
        value = (-np.inf, np.inf)
    try:
        lower, upper = value
    except (TypeError, ValueError):
        raise ValueError(
            f"{name} must be a pair (lower, upper), got {check.shown(value)}"
        ) from None
    if check.is_plain(lower) and check.is_plain(upper) and lower.ndim == upper.ndim == 1:
        both = np.empty((2, n))
        if _solver().copy_limits(lower, upper, check.LARGEST, both):  # the common case
            both.setflags(write=False)
            return both[0], both[1]
    return ordered(name, lower, name, upper, n)


@cache
def _solver() -> Any:
    from prioritized import _unlimited

    return _unlimited


def ordered(
    lower_name: str, lower: ArrayLike | None, upper_name: str, upper: ArrayLike | None, n: int
) -> Limits:
    """Limits under names of their own; None is infinite."""
    low = _side(lower_name, -np.inf if lower is None else lower, n)
    high = _side(upper_name, np.inf if upper is None else upper, n)
    for k in np.flatnonzero((low > high) | (low == np.inf) | (high == -np.inf)):
        name = lower_name if lower_name == upper_name else f"{lower_name} and {upper_name}"
        pair = f"{low[k]:g} and {high[k]:g} at {k}"
        raise ValueError(f"{name} must have lower limits below the upper ones, got {pair}")
    return low, high


def _side(name: str, value: ArrayLike, n: int) -> Array:
    """Numbers (n,), infinite ones among them."""
    try:
        infinite = np.asarray(False if check.is_masked(value) else np.isinf(value))
    except (TypeError, ValueError):  # no numbers: the check says so
        infinite = np.asarray(False)
    x = check.real(name, np.where(infinite, 0.0, value) if infinite.any() else value)
    if x.shape not in ((), (n,)):
        raise ValueError(f"{name} must be one number or {n} for each side, got shape {x.shape}")
    return read_only(np.full(n, np.where(infinite, value, x) if infinite.any() else x))


def are_obeyed(x: Array, between: Limits) -> bool:
    """Whether all numbers (..., n) lie within the limits."""
    return bool(((x >= between[0]) & (x <= between[1])).all())
