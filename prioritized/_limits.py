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
    """Lower and upper limits of n unknowns, read-only copies, shape (n,) each; None is infinite.

    Each of the pair is n numbers, or one for all. Equal limits are a lock.

    Raises:
        ValueError: Not a pair, a wrong length, NaN, or a lower limit above the upper one.
    """
    if value is None:
        value = (-np.inf, np.inf)
    lower, upper = value if isinstance(value, tuple) and len(value) == 2 else (None, None)
    if check.is_plain(lower) and check.is_plain(upper) and lower.ndim == upper.ndim == 1:
        both = np.empty((2, n))
        if _solver().copy_limits(lower, upper, check.LARGEST, both):  # the common case
            both.setflags(write=False)
            return both[0], both[1]
    low, high = check.limits(name, value, n)
    if max(low.ndim, high.ndim) > 1:
        raise ValueError(f"{name} must be a pair of numbers or of {n} numbers, got {low.shape}")
    return read_only(np.full(n, low)), read_only(np.full(n, high))


@cache
def _solver() -> Any:
    from prioritized import _unlimited

    return _unlimited
