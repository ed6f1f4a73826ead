"""One basis of each subspace: that of a decomposition depends on the last bits of its input."""

import numpy as np
from numpy.typing import ArrayLike

import argument_checks as check
from argument_checks import Array
from kernels import lib, pointer

_ORTHONORMAL = 1e-6


def canonical_basis(basis: ArrayLike) -> Array:
    """The orthonormal basis that depends on the subspace alone, shape (..., N, k).

    Its first column is the unit vector e_i projected on the subspace and made of unit length, where
    i is the coordinate of which most is left, the first of equals; the others are made likewise of
    the rest. Each column is positive at its own i and all later columns are zero there: Gauss and
    Schmidt on the orthogonal projector, with pivots.

    Args:
        basis: Orthonormal columns, some of which may be zero; these come last, (..., N, k).

    Raises:
        ValueError: No matrix, not finite, or columns that are neither orthonormal nor zero.
    """
    columns = check.array("basis", basis, ..., None, None)
    products = np.swapaxes(columns, -1, -2) @ columns
    filled = np.eye(columns.shape[-1]) * (products > 0.5)
    if (off := np.abs(products - filled).max(initial=0.0)) > _ORTHONORMAL:
        raise ValueError(f"basis must have orthonormal columns or zero ones, got {off:.3g} off")
    return canonical(columns)


def canonical(basis: Array) -> Array:
    """The same without checks, for every tick."""
    result = np.zeros(basis.shape)
    if result.size:
        (N, k), remaining = basis.shape[-2:], np.array(basis, order="C")
        arguments = pointer(remaining), pointer(result), pointer(np.empty(k))
        lib.canonical_bases(result.size // (N * k), N, k, *arguments)
    return result
