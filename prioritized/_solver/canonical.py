"""Canonical bases of subspaces, independent of the round-off of a decomposition."""

import numpy as np
from numpy.typing import ArrayLike

import argument_checks as check
from argument_checks import Array
from kernels import lib, pointer

_ORTHONORMAL = 1e-6


def canonical_basis(basis: ArrayLike) -> Array:
    """Return the orthonormal basis that depends on the subspace alone, shape (..., N, k).

    The first column is the normalized projection of the unit vector e_i onto the subspace, where i
    is the coordinate with the largest projection, the first one of equals; the following columns
    are constructed in the same way from the remaining subspace. Each column is positive at its own
    i and all later columns are zero there: pivoted Gram-Schmidt on the orthogonal projector.

    Args:
        basis: Orthonormal columns, some of which may be zero, (..., N, k); zero columns are sorted
            last.

    Raises:
        ValueError: The columns are not finite, or neither orthonormal nor zero.
    """
    columns = check.array("basis", basis, ..., None, None)
    products = np.swapaxes(columns, -1, -2) @ columns
    filled = np.eye(columns.shape[-1]) * (products > 0.5)
    if (off := np.abs(products - filled).max(initial=0.0)) > _ORTHONORMAL:
        raise ValueError(
            f"basis must have orthonormal or zero columns, got a deviation of {off:.3g}"
        )
    return canonical(columns)


def canonical(basis: Array) -> Array:
    """Return the canonical basis of :func:`canonical_basis` without checks, for per-tick use."""
    result = np.zeros(basis.shape)
    if result.size:
        (N, k), remaining = basis.shape[-2:], np.array(basis, order="C")
        arguments = pointer(remaining), pointer(result), pointer(np.empty(k))
        lib.canonical_bases(result.size // (N * k), N, k, *arguments)
    return result
