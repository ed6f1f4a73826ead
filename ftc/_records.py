"""Successors of frozen states, and what they keep for the kernels."""

from collections.abc import Iterator
from typing import Any, TypeVar

import numpy as np

from kernels import pointer

State = TypeVar("State")


def changed(state: State, **fields: object) -> State:
    """The state with other values of some fields, as `dataclasses.replace` makes it.

    That takes seven times as long, several times a tick. For frozen records that check nothing when
    they are made, and keep nothing that is computed from their fields.
    """
    after = object.__new__(type(state))
    vars(after).update(vars(state), **fields)
    return after


class Pointers:
    """Pointers to arrays that stay as they are; a copy has its own."""

    def __init__(self, *arrays: np.ndarray[Any, Any]) -> None:
        self._arrays, self._pointers = arrays, [pointer(array) for array in arrays]

    def __iter__(self) -> Iterator[Any]:
        return iter(self._pointers)

    def __reduce__(self) -> tuple[Any, ...]:
        return Pointers, self._arrays
