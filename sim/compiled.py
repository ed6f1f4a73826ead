"""The compiled code of this package."""

from functools import cache
from typing import Any


@cache
def compiled() -> Any:
    """The compiled code, loaded when first needed: the compiler takes some 0.3 s."""
    from sim import _tick

    return _tick
