"""The array type of all signatures: float64 unless a docstring says otherwise."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

import argument_checks as check

Array = NDArray[Any]


def lock(record: object) -> None:
    """Make the arrays of a record read-only, at little cost: they are its own."""
    for value in vars(record).values():
        if type(value) is np.ndarray:
            check.read_only(value)
