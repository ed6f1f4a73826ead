"""Matrices and batches of them, and matrices that weigh."""

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg.blas import dnrm2

from argument_checks.arrays import SMALLEST, Array, real
from argument_checks.shown import shown


def sized(name: str, A: Array) -> Array:
    """The matrices themselves, each of which is zero or not too small for products."""
    if A.ndim == 2 and A.size and dnrm2(A.ravel()) >= SMALLEST:
        return A  # the common case
    size = np.abs(A).max(axis=(-2, -1), initial=0.0)
    if (small := size[(size > 0.0) & (size < SMALLEST)]).size:
        least = f"{SMALLEST:g}"
        raise ValueError(f"{name} must be zero or of a size of at least {least}, got {small[0]:g}")
    return A


def batch(
    name: str, value: ArrayLike, columns: int | None = None, rows: int | None = None
) -> Array:
    """A finite matrix with any leading batch axes as float64."""
    A = real(name, value)
    if A.ndim < 2:
        raise ValueError(f"{name} must be a matrix, got shape {A.shape}")
    if columns is not None and A.shape[-1] != columns:
        raise ValueError(f"{name} must have {columns} columns, got shape {A.shape}")
    if rows is not None and A.shape[-2] != rows:
        raise ValueError(f"{name} must have {rows} rows, got shape {A.shape}")
    return A


def matrix(
    name: str, value: ArrayLike, columns: int | None = None, rows: int | None = None
) -> Array:
    """One finite matrix as float64, zero or not too small, with what of its shape is fixed."""
    A = batch(name, value, columns, rows)
    if A.ndim != 2:
        raise ValueError(f"{name} must be one matrix, got shape {A.shape}")
    return sized(name, A)


def weight(name: str, value: ArrayLike, size: int) -> Array:
    """A weighting matrix: a vector is the diagonal of one, a matrix has `size` columns."""
    W = real(name, value)
    if W.ndim == 0:
        raise ValueError(f"{name} must be a diagonal or a matrix, got the scalar {W}")
    if W.shape[-1] != size:
        raise ValueError(f"{name} must have {size} columns, got shape {W.shape}")
    return np.diag(W) if W.ndim == 1 else W


def positive_semidefinite(name: str, value: ArrayLike, size: int) -> Array:
    """A symmetric matrix (size, size) without negative eigenvalues; a vector is its diagonal."""
    K = sized(name, weight(name, value, size))
    round_off = 1e-12 * np.abs(K).max(initial=0.0)
    if K.shape != (size, size) or (np.abs(K - K.T) > round_off).any():
        raise ValueError(
            f"{name} must be a diagonal of {size} or a symmetric matrix, got {shown(K.tolist())}"
        )
    if (lowest := np.linalg.eigvalsh(K).min(initial=0.0)) < -round_off * size:
        raise ValueError(f"{name} must have no negative eigenvalue, got {lowest:.3g}")
    return K
