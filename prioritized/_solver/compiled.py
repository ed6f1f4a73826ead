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


@cache
def elimination() -> Any:
    """Passive velocities from regular loops."""
    from prioritized._solver import closing as _closing

    return _closing


@cache
def certain() -> Any:
    """Bounds of singular values."""
    from prioritized._solver import certain as _certain

    return _certain


@cache
def boxes() -> Any:
    """Rates from which limits can be kept."""
    from prioritized._solver import boxes as _boxes

    return _boxes


@cache
def regular() -> Any:
    """All levels of a regular mechanism."""
    from prioritized._solver import regular as _regular

    return _regular
