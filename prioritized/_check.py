"""Argument checks: wrong input raises at once and names what was expected and what came."""

from collections.abc import Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
_T = TypeVar("_T", bound=np.generic)
Indices = NDArray[np.intp]
Mask = NDArray[np.bool_]


def matrix(name: str, value: ArrayLike, columns: int | None = None) -> Array:
    """One finite matrix as float64, with the given number of columns if that is fixed."""
    A = batch(name, value, columns)
    if A.ndim != 2:
        raise ValueError(f"{name} must be one matrix, got shape {A.shape}")
    return A


def batch(name: str, value: ArrayLike, columns: int | None = None) -> Array:
    """A finite matrix with any leading batch axes as float64."""
    A = np.asarray(value, dtype=float)
    if A.ndim < 2:
        raise ValueError(f"{name} must be a matrix, got shape {A.shape}")
    if columns is not None and A.shape[-1] != columns:
        raise ValueError(f"{name} must have {columns} columns, got shape {A.shape}")
    return finite(name, A)


def vector(name: str, value: ArrayLike, size: int) -> Array:
    """A finite vector with any leading batch axes, shape (..., size)."""
    v = np.asarray(value, dtype=float)
    if v.ndim < 1 or v.shape[-1] != size:
        raise ValueError(f"{name} must have shape (..., {size}), got {v.shape}")
    return finite(name, v)


def weight(name: str, value: ArrayLike, size: int) -> Array:
    """A weighting matrix: a vector is the diagonal of one, a matrix has `size` columns."""
    W = np.asarray(value, dtype=float)
    if W.ndim == 0:
        raise ValueError(f"{name} must be a diagonal or a matrix, got the scalar {W}")
    if W.shape[-1] != size:
        raise ValueError(f"{name} must have {size} columns, got shape {W.shape}")
    return finite(name, np.diag(W) if W.ndim == 1 else W)


def indices(name: str, value: Sequence[int] | ArrayLike, limit: int) -> Indices:
    """Distinct integers of range(limit)."""
    raw = np.asarray(value)
    if raw.size == 0:
        return np.zeros(0, dtype=np.intp)
    if raw.ndim != 1 or not np.issubdtype(raw.dtype, np.integer):
        raise ValueError(f"{name} must be a list of integers, got {value!r}")
    if raw.min() < 0 or raw.max() >= limit:
        raise ValueError(f"{name} must lie in 0..{limit - 1}, got {raw.tolist()}")
    if len(set(raw.tolist())) != raw.size:
        raise ValueError(f"{name} must not repeat an index, got {raw.tolist()}")
    return raw.astype(np.intp)


def finite(name: str, A: Array) -> Array:
    """The array itself, if all of it is finite."""
    if not np.isfinite(A).all():
        raise ValueError(f"{name} must be finite, got NaN or infinity")
    return A


def frozen(A: NDArray[_T]) -> NDArray[_T]:
    """A read-only copy."""
    A = np.array(A)
    A.setflags(write=False)
    return A
