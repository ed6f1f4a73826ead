"""Checks of single numbers, indices, flags, choices, types and attributes."""

from collections.abc import Iterable, Sequence
from contextlib import suppress
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from argument_checks.arrays import (
    LARGEST,
    SMALLEST,
    Indices,
    array,
    at_least,
    is_masked,
    short_repr,
)

_Kind = TypeVar("_Kind")

DAY_S = 86_400.0
SECONDS = 1e-9, DAY_S
"""Range of durations [s]: a run of the longest duration with the shortest period must terminate."""


def number(name: str, value: ArrayLike, least: float = -LARGEST, most: float = LARGEST) -> float:
    """Check one finite number between `least` and `most`, and return it as a float."""
    if type(value) is float and least <= value <= most and abs(value) < LARGEST:
        return value  # the common case
    A = array(name, value)
    if A.ndim:
        raise ValueError(f"{name} must be one number, got shape {A.shape}")
    if not least <= (x := float(A)) <= most:
        below = (
            f"be {'above 0 and at most' if least == SMALLEST else f'from {least:g} to'} {most:g}"
        )
        expected = below if most < LARGEST else at_least(least)
        raise ValueError(f"{name} must {expected}, got {short_repr(value)}")
    return x


def integer(name: str, value: Any, size: int | None = None) -> int:
    """Check an integer in 0..size - 1, or any non-negative one without `size`, and return it."""
    if isinstance(value, bool | np.bool_) or not isinstance(value, int | np.integer):
        raise ValueError(f"{name} must be an integer, got {short_repr(value)}")
    if value < 0 or (size is not None and value >= size):
        expected = "not be negative" if size is None else f"lie in 0..{size - 1}"
        raise ValueError(f"{name} must {expected}, got {short_repr(value)}")
    return int(value)


def indices(
    name: str, value: Iterable[int] | ArrayLike, size: int, *, distinct: bool = True
) -> Indices:
    """Check a list of integers in 0..size - 1, by default without repeats; return an array (k,)."""
    listed = value if isinstance(value, Sequence | np.ndarray) else _listed(value)
    try:
        raw = np.asarray(None if is_masked(listed) else listed)
    except ValueError:  # rows that differ
        raw = np.asarray(None)
    if raw.size == 0 and raw.ndim == 1:
        return np.zeros(0, dtype=np.intp)
    if raw.ndim != 1 or raw.dtype.kind not in "iu":
        raise ValueError(f"{name} must be a list of integers, got {short_repr(value)}")
    if raw.min() < 0 or raw.max() >= size:
        raise ValueError(f"{name} must lie in 0..{size - 1}, got {short_repr(raw.tolist())}")
    if distinct and len(set(raw.tolist())) != raw.size:
        raise ValueError(f"{name} must not repeat an index, got {short_repr(raw.tolist())}")
    return raw.astype(np.intp)


def flag(name: str, value: Any) -> bool:
    """Check that a value is True or False, and return it."""
    if not isinstance(value, bool | np.bool_):
        raise TypeError(f"{name} must be True or False, got {short_repr(value)}")
    return bool(value)


def choice(name: str, value: Any, options: Iterable[str]) -> str:
    """Check that a string is one of the options, and return it."""
    if instance(name, value, str) not in (options := tuple(options)):
        raise ValueError(f"{name} must be one of {', '.join(options)}, got {short_repr(value)}")
    return value


def instance(name: str, value: Any, *kinds: type[_Kind]) -> _Kind:
    """Check that a value is an instance of one of the classes, and return it."""
    if not isinstance(value, kinds):
        expected = " or ".join(kind.__name__ for kind in kinds)
        raise TypeError(f"{name} must be a {expected}, got {short_repr(value)}")
    return value


def members(name: str, value: Iterable[_Kind], *kinds: type[_Kind]) -> tuple[_Kind, ...]:
    """Check that a list has instances of these classes only, no string; return a tuple."""
    items: tuple[Any, ...] = (None,) if isinstance(value, str) else _listed(value)
    if not all(isinstance(item, kinds) for item in items):
        expected = " or ".join(kind.__name__ for kind in kinds)
        raise TypeError(f"{name} must be a list of {expected}, got {short_repr(value)}")
    return items


def function(name: str, value: Any) -> Any:
    """Check that a value is callable, and return it."""
    if not callable(value):
        raise TypeError(f"{name} must be a function, got {short_repr(value)}")
    return value


def attributes(name: str, value: Any, *required: str) -> Any:
    """Check that an object has the required attributes or methods, and return it.

    Properties are not evaluated if `dir` lists them.
    """
    own_fields, kind = getattr(value, "__dict__", ()), type(value)
    missing = {field for field in required if field not in own_fields and not hasattr(kind, field)}
    if missing:  # the list of all takes longer
        missing -= set(dir(value))
    if not all(hasattr(value, field) for field in missing):  # dir() of a proxy lists none
        *most, last = required
        listed = f"{', '.join(most)} and {last}" if most else last
        raise TypeError(f"{name} must have {listed}, got {short_repr(value)}")
    return value


def _listed(value: Any) -> tuple[Any, ...]:
    """Return the items of an iterable as a tuple; (None,) for a value that is not iterable."""
    with suppress(TypeError):
        return tuple(value)
    return (None,)
