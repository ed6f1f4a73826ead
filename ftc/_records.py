"""What frozen states keep for the kernels."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from kernels import pointer


class Pointers:
    """Pointers to arrays that stay as they are; a copy has its own."""

    def __init__(self, *arrays: np.ndarray[Any, Any]) -> None:
        self._arrays, self._pointers = arrays, [pointer(array) for array in arrays]

    def __iter__(self) -> Iterator[Any]:
        return iter(self._pointers)

    def __reduce__(self) -> tuple[Any, ...]:
        return Pointers, self._arrays
