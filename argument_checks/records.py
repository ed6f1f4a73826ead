"""Frozen records of arrays, checked and copied on input and made read-only on construction."""

from typing import Any, TypeVar

import numpy as np

from argument_checks.arrays import array, read_only

_Kind = TypeVar("_Kind")


def lock(record: object) -> None:
    """Make all arrays of a dataclass read-only in place; no other object may write to them."""
    for value in vars(record).values():
        if type(value) is np.ndarray:
            read_only(value)


def computed(kind: type[_Kind], **fields: Any) -> _Kind:
    """Construct a frozen dataclass without its checks, and make its arrays read-only in place."""
    record = unchecked_record(kind, **fields)
    lock(record)
    return record


def unchecked_record(kind: type[_Kind], **fields: Any) -> _Kind:
    """Construct a frozen dataclass from arrays that are read-only already, bypassing its checks."""
    record = object.__new__(kind)
    record.__dict__.update(fields)
    return record


def changed(record: _Kind, **fields: Any) -> _Kind:
    """Return a copy of a frozen record with some fields replaced, as by `dataclasses.replace`.

    This is seven times as fast. The record must have neither `__post_init__` nor cached values.
    """
    copy = object.__new__(type(record))
    copy.__dict__.update(record.__dict__, **fields)
    return copy


def freeze_field(frozen: object, name: str, *shape: int) -> None:
    """Replace an array field of a frozen dataclass by a checked, read-only, C-contiguous copy."""
    A = np.array(array(name, getattr(frozen, name), ..., *shape), order="C")
    object.__setattr__(frozen, name, read_only(A))
