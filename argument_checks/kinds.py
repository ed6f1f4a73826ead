"""Switches, choices by name, seeds, lists, functions, and objects with certain attributes."""

from collections.abc import Iterable, Sequence
from contextlib import suppress
from typing import Any, TypeVar

import numpy as np

from argument_checks.scalars import index, instance
from argument_checks.shown import shown

_Kind = TypeVar("_Kind")


def flag(name: str, value: Any) -> bool:
    """True or False."""
    if not isinstance(value, bool | np.bool_):
        raise TypeError(f"{name} must be True or False, got {shown(value)}")
    return bool(value)


def choice(name: str, value: Any, known: Iterable[str]) -> str:
    """One of these words."""
    if instance(name, value, str) not in (words := tuple(known)):
        raise ValueError(f"{name} must be one of {', '.join(words)}, got {shown(value)}")
    return value


def seed(name: str, value: int | Sequence[int]) -> int | list[int]:
    """Of a random generator: an integer that is not negative, or a list of some.

    numpy ends the process for some other things.
    """
    if isinstance(value, list | tuple) and value:
        return [index(name, each) for each in value]
    return index(name, value)


def members(name: str, value: Iterable[_Kind], *kinds: type[_Kind]) -> tuple[_Kind, ...]:
    """All things of a list, each of one of these classes; a text is no list."""
    each: tuple[Any, ...] = (None,)
    if not isinstance(value, str):
        with suppress(TypeError):
            each = tuple(value)
    if not all(isinstance(one, kinds) for one in each):
        expected = " or ".join(kind.__name__ for kind in kinds)
        raise TypeError(f"{name} must be a list of {expected}, got {shown(value)}")
    return each


def function(name: str, value: Any) -> Any:
    """The function itself, or whatever can be called."""
    if not callable(value):
        raise TypeError(f"{name} must be a function, got {shown(value)}")
    return value


def methods(name: str, value: Any, *wanted: str) -> Any:
    """The object itself, which has these methods."""
    if absent := [each for each in wanted if not callable(getattr(value, each, None))]:
        raise TypeError(f"{name} must have {_listed(absent)}(), got {shown(value)}")
    return value


def attributes(name: str, value: Any, *wanted: str) -> Any:
    """The object itself, which has these attributes; none that it lists is computed for that."""
    own, kind = getattr(value, "__dict__", ()), type(value)
    absent = {each for each in wanted if each not in own and not hasattr(kind, each)}
    if absent:  # the list of all takes longer
        absent -= set(dir(value))
    if not all(hasattr(value, each) for each in absent):  # a proxy lists none of its own
        raise TypeError(f"{name} must have {_listed(wanted)}, got {shown(value)}")
    return value


def _listed(words: Sequence[str]) -> str:
    *most, last = words
    return f"{', '.join(most)} and {last}" if most else last
