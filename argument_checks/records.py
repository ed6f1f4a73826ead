"""Frozen records of arrays: checked and copied where they come in, locked where they are made."""

from typing import Any, TypeVar

import numpy as np

from argument_checks.arrays import array, read_only

_Kind = TypeVar("_Kind")


def lock(record: object) -> None:
    """Make the arrays of a record read-only, at little cost: they are its own."""
    for value in vars(record).values():
        if type(value) is np.ndarray:
            read_only(value)


def computed(kind: type[_Kind], **fields: Any) -> _Kind:
    """A frozen record of new arrays that come from checked ones, at every tick: locked alone."""
    record = unchecked_record(kind, **fields)
    lock(record)
    return record


def unchecked_record(kind: type[_Kind], **fields: Any) -> _Kind:
    """A frozen record of arrays that are locked already, made without its own checks."""
    record = object.__new__(kind)
    record.__dict__.update(fields)
    return record


def changed(record: _Kind, **fields: Any) -> _Kind:
    """The record with other values of some fields, as `dataclasses.replace` makes it.

    That takes seven times as long, several times a tick. For frozen records that check nothing when
    they are made, and keep nothing that is computed from their fields.
    """
    copy = object.__new__(type(record))
    copy.__dict__.update(record.__dict__, **fields)
    return copy


def freeze_field(frozen: object, name: str, *shape: int) -> None:
    """Check an array of a frozen dataclass, and keep a read-only copy, in C's order."""
    A = np.array(array(name, getattr(frozen, name), ..., *shape), order="C")
    object.__setattr__(frozen, name, read_only(A))
