"""The compiled solvers, loaded when first needed: the compiler takes some 0.3 s."""

from functools import cache
from typing import Any


@cache
def unlimited() -> Any:
    """Problem 1 without limits."""
    from prioritized._solver import unlimited as _unlimited

    return _unlimited


@cache
def batch() -> Any:
    """Problem 1 without limits, many at once."""
    from prioritized._solver import batch as _batch

    return _batch
