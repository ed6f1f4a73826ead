"""Array type of all signatures: float64 unless a docstring says otherwise."""

from typing import Any

from numpy.typing import NDArray

Array = NDArray[Any]
