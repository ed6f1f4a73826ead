"""Limits of rates, torques, or any unknowns: a lower and an upper one for each."""

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

import argument_checks as check
from argument_checks import Array
from prioritized._solver.arrays import read_only
from prioritized._solver.compiled import unlimited

Limits = tuple[Array, Array]
"""Lower and upper limits, (n,) each, infinite where there is none."""


def limits(name: str, value: tuple[ArrayLike, ArrayLike] | None, n: int) -> Limits:
    """Lower and upper limits of n unknowns, read-only copies, shape (n,) each; None is infinite.

    Each of the pair is n numbers, or one for all. Equal limits are a lock.

    Raises:
        ValueError: Not a pair, a wrong length, NaN, or a lower limit above the upper one.
    """
    if value is None:
        return _none(n)
    if isinstance(value, tuple) and len(value) == 2:
        both = plain_limits(*value, n)  # the common case
        if both is not None:
            return both[0], both[1]
    return check.limit_vectors(name, value, n)


@lru_cache
def _none(n: int) -> Limits:
    return read_only(np.full(n, -np.inf)), read_only(np.full(n, np.inf))


def plain_limits(lower: Any, upper: Any, n: int) -> Array | None:
    """A read-only copy (2, n) of limits that are vectors of floats in order; None of others."""
    if not (type(lower) is type(upper) is np.ndarray and lower.ndim == upper.ndim == 1):
        return None
    both = np.empty((2, n))
    try:
        if not unlimited().copy_limits(lower, upper, check.LARGEST, both):
            return None
    except TypeError:  # not of floats
        return None
    both.setflags(write=False)
    return both
