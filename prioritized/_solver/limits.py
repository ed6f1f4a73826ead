"""Lower and upper limits of rates, torques, or other unknowns."""

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

import argument_checks as check
from argument_checks import Array
from kernels import lib, pointer
from prioritized._solver.arrays import read_only

Limits = tuple[Array, Array] | Array
"""Lower and upper limits, (n,) each, infinite where there is none."""


def limits(name: str, value: tuple[ArrayLike, ArrayLike] | None, n: int) -> Array:
    """Check limits of n unknowns and return a read-only copy, shape (2, n); None is infinite.

    Each of the pair is n numbers, or one number for all. Equal limits fix the unknown.
    """
    if value is None:
        return _none(n)
    both = plain_limits(value, n)
    return read_only(np.array(check.limits(name, value, n)) if both is None else both)


@lru_cache
def _none(n: int) -> Array:
    return read_only(np.array([np.full(n, -np.inf), np.full(n, np.inf)]))


def plain_limits(value: Any, n: int) -> Array | None:
    """Copy a pair of float64 vectors in order to (2, n), the common case; return None otherwise."""
    if not (type(value) is tuple and len(value) == 2):
        return None
    lower, upper = value
    if not (check.is_plain(lower) and check.is_plain(upper) and lower.shape == upper.shape == (n,)):
        return None
    both = np.empty((2, n))
    low, high = np.ascontiguousarray(lower), np.ascontiguousarray(upper)
    arguments = pointer(low), pointer(high), pointer(both)
    return both if lib.copy_limits(n, *arguments) else None
