"""Single numbers, indices, and things of a kind."""

from collections.abc import Iterable, Sequence
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from argument_checks.arrays import LARGEST, Indices, is_masked, real
from argument_checks.shown import shown

_Kind = TypeVar("_Kind")

_SHORTEST_S, _LONGEST_S = 1e-9, 86_400.0
"""Of a duration: what is counted in ticks of one and lasts for the other must come to an end."""


def signed(name: str, value: ArrayLike) -> float:
    """One finite number."""
    if isinstance(value, float) and -LARGEST < value < LARGEST:
        return value  # the common case
    x = real(name, value)
    if x.ndim:
        raise ValueError(f"{name} must be one number, got shape {x.shape}")
    return float(x)


def number(name: str, value: ArrayLike) -> float:
    """One finite number, not below zero."""
    if (x := signed(name, value)) < 0:
        raise ValueError(f"{name} must not be negative, got {shown(value)}")
    return x


def positive(name: str, value: ArrayLike) -> float:
    """One finite number above zero, and not so small that its inverse is out of range."""
    if (x := signed(name, value)) <= 1.0 / LARGEST:
        raise ValueError(f"{name} must be positive, at least {1.0 / LARGEST:g}, got {shown(value)}")
    return x


def duration(
    name: str, value: ArrayLike, least: float = _SHORTEST_S, most: float = _LONGEST_S
) -> float:
    """One time in seconds, up to a day unless less is told."""
    return within(name, value, least, most, " s")


def within(name: str, value: ArrayLike, least: float, most: float, unit: str = "") -> float:
    """One number from one to another."""
    if not least <= (x := signed(name, value)) <= most:
        raise ValueError(f"{name} must be from {least:g} to {most:g}{unit}, got {shown(value)}")
    return x


def fraction(name: str, value: ArrayLike) -> float:
    """One number of at least zero and below one."""
    x = number(name, value)
    if x >= 1:
        raise ValueError(f"{name} must lie below 1, got {x}")
    return x


def at_most_one(name: str, value: ArrayLike) -> float:
    """One number of at least zero and at most one."""
    x = signed(name, value)
    if not 0 <= x <= 1:
        raise ValueError(f"{name} must lie in 0..1, got {x}")
    return x


def index(name: str, value: Any, limit: int | None = None) -> int:
    """One integer of range(limit), or any that is not negative."""
    if isinstance(value, bool | np.bool_) or not isinstance(value, int | np.integer):
        raise ValueError(f"{name} must be an integer, got {shown(value)}")
    if value < 0 or (limit is not None and value >= limit):
        expected = "not be negative" if limit is None else f"lie in 0..{limit - 1}"
        raise ValueError(f"{name} must {expected}, got {shown(value)}")
    return int(value)


def indices(name: str, value: Sequence[int] | ArrayLike, limit: int) -> Indices:
    """Distinct integers of range(limit), in the order given."""
    raw = _integers(name, value, limit)
    if len(set(raw.tolist())) != raw.size:
        raise ValueError(f"{name} must not repeat an index, got {shown(raw.tolist())}")
    return raw


def index_set(name: str, value: Iterable[int], limit: int) -> frozenset[int]:
    """Integers of range(limit); order and repetition do not matter."""
    if not isinstance(value, Iterable):
        raise ValueError(f"{name} must be a list of integers, got {shown(value)}")
    members = value if isinstance(value, np.ndarray) else list(value)
    return frozenset(_integers(name, members, limit).tolist())


def instance(name: str, value: Any, *kinds: type[_Kind]) -> _Kind:
    """The thing itself, if it is of one of these classes."""
    if not isinstance(value, kinds):
        expected = " or ".join(kind.__name__ for kind in kinds)
        raise TypeError(f"{name} must be a {expected}, got {shown(value)}")
    return value


def _integers(name: str, value: Sequence[int] | ArrayLike, limit: int) -> Indices:
    try:
        raw = np.asarray(None if is_masked(value) else value)
    except ValueError:  # rows that differ
        raw = np.asarray(None)
    if raw.size == 0 and raw.ndim == 1:
        return np.zeros(0, dtype=np.intp)
    if raw.ndim != 1 or raw.dtype.kind not in "iu":
        raise ValueError(f"{name} must be a list of integers, got {shown(value)}")
    if raw.min() < 0 or raw.max() >= limit:
        raise ValueError(f"{name} must lie in 0..{limit - 1}, got {shown(raw.tolist())}")
    return raw.astype(np.intp)
