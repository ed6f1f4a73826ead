"""The compiled solvers, loaded when first needed: the compiler takes some 0.3 s."""

from functools import cache
from typing import Any


@cache
def unlimited() -> Any:
    """Problem 1 without limits."""
    from prioritized import _unlimited

    return _unlimited


@cache
def elimination() -> Any:
    """Passive velocities from regular loops."""
    from prioritized import _closing

    return _closing


@cache
def bounded() -> Any:
    """Lexicographic least squares under bounds."""
    from prioritized import _bounded

    return _bounded
