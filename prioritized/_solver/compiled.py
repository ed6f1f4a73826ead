"""The compiled solvers, loaded when first needed: the compiler takes some 0.3 s."""

from functools import cache
from typing import Any


@cache
def unlimited() -> Any:
    """Problem 1 without limits."""
    from prioritized._solver import unlimited as _unlimited

    return _unlimited


@cache
def elimination() -> Any:
    """Passive velocities from regular loops."""
    from prioritized._solver import closing as _closing

    return _closing


@cache
def bounded() -> Any:
    """Lexicographic least squares under bounds."""
    from prioritized._solver import bounded as _bounded

    return _bounded
