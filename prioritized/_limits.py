"""Limits of rates, torques, or any unknowns: a lower and an upper bound for each."""

import numpy as np
from numpy.typing import ArrayLike

import argument_checks as check
from argument_checks import Array
from prioritized._arrays import read_only

Limits = tuple[Array, Array]
"""Lower and upper bounds, (n,) each, infinite where there is none."""


def limits(name: str, value: tuple[ArrayLike, ArrayLike] | None, n: int) -> Limits:
    """The pair (lower, upper) as read-only arrays (n,); None is no limit.

    Each side is n numbers, or one for all, and may be infinite.

    Raises:
        ValueError: No pair, another length, NaN, or a lower bound above the upper one.
    """
    if value is None:
        return limits(name, (-np.inf, np.inf), n)
    if not isinstance(value, tuple | list | np.ndarray) or len(value) != 2:
        raise ValueError(f"{name} must be a pair (lower, upper), got {check.shown(value)}")
    return ordered(f"{name}[0]", value[0], f"{name}[1]", value[1], n)


def ordered(
    lower_name: str, lower: ArrayLike | None, upper_name: str, upper: ArrayLike | None, n: int
) -> Limits:
    """Lower and upper bounds under names of their own; None is no bound."""
    low, high = _side(lower_name, lower, n, -np.inf), _side(upper_name, upper, n, np.inf)
    if (low > high).any():
        i = int(np.argmax(low > high))
        raise ValueError(
            f"{lower_name} must be at most {upper_name}, got {low[i]:g} above {high[i]:g} at {i}"
        )
    return low, high


def _side(name: str, value: ArrayLike | None, n: int, default: float) -> Array:
    if value is None:
        value = default
    if check.is_plain(value) and value.shape == (n,):
        side = value.copy()  # the common case
    else:
        raw = np.asarray(value)
        if raw.dtype.kind not in "fiu" or check.is_masked(value):
            raise ValueError(f"{name} must hold real numbers, got {check.shown(value)}")
        if raw.shape not in ((), (n,)):
            raise ValueError(f"{name} must be one number or {n}, got shape {raw.shape}")
        side = np.full(n, raw, dtype=float)
    if np.isnan(side).any():
        raise ValueError(f"{name} must not be NaN, got {check.shown(value)}")
    if (np.isfinite(side) & (np.abs(side) >= check.LARGEST)).any():
        raise ValueError(f"{name} must be smaller than {check.LARGEST:g} or infinite")
    return read_only(side)
