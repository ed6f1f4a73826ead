"""The two norms that eq. (40) is taken in."""

from typing import Literal, get_args

import numpy as np

from sim import Array

Norm = Literal["frobenius", "two"]
NORMS: tuple[Norm, ...] = get_args(Norm)


def size(matrices: Array, norm: Norm) -> Array:
    """Norm of each of the matrices (..., p, q), shape (...)."""
    return np.linalg.norm(matrices, "fro" if norm == "frobenius" else 2, axis=(-2, -1))
