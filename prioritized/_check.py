"""Argument checks: wrong input raises at once and names what was expected and what came."""

from collections.abc import Iterable, Sequence
from math import inf, isfinite
from typing import TypeGuard, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg.blas import dnrm2

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
Mask = NDArray[np.bool_]
_T = TypeVar("_T", bound=np.generic)
_FLOAT64 = np.dtype(np.float64)


def real(name: str, value: ArrayLike | None) -> Array:
    """A copy of finite real numbers of any shape as float64."""
    if is_plain(value) and is_surely_finite(value):
        return value.copy()  # the common case
    try:
        raw = np.asarray(value)
    except ValueError:
        raise ValueError(f"{name} must be a rectangular array, got rows that differ") from None
    if raw.dtype.kind not in "fiu":
        got = raw.dtype if value is not None else None
        raise ValueError(f"{name} must hold real numbers, got {got}")
    if not np.isfinite(raw).all():
        raise ValueError(f"{name} must be finite, got NaN or infinity")
    return raw.astype(float)


def is_plain(value: ArrayLike | None) -> TypeGuard[Array]:
    """Whether this is an array of float64 as it stands, finite or not."""
    return type(value) is np.ndarray and value.dtype is _FLOAT64


def is_surely_finite(A: Array) -> bool:
    """Whether all numbers are finite, and so is their norm: one pass, and no array in between."""
    return A.size == 0 or isfinite(dnrm2(A.ravel()))


def matrix(name: str, value: ArrayLike, columns: int | None = None) -> Array:
    """One finite matrix as float64, with the given number of columns if that is fixed."""
    A = batch(name, value, columns)
    if A.ndim != 2:
        raise ValueError(f"{name} must be one matrix, got shape {A.shape}")
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


def vector(name: str, value: ArrayLike | None, size: int) -> Array:
    """A finite vector with any leading batch axes, shape (..., size)."""
    v = real(name, value)
    if v.ndim < 1 or v.shape[-1] != size:
        raise ValueError(f"{name} must have shape (..., {size}), got {v.shape}")
    return v


def weight(name: str, value: ArrayLike, size: int) -> Array:
    """A weighting matrix: a vector is the diagonal of one, a matrix has `size` columns."""
    W = real(name, value)
    if W.ndim == 0:
        raise ValueError(f"{name} must be a diagonal or a matrix, got the scalar {W}")
    if W.shape[-1] != size:
        raise ValueError(f"{name} must have {size} columns, got shape {W.shape}")
    return np.diag(W) if W.ndim == 1 else W


def common_axes(leads: dict[str, tuple[int, ...]]) -> tuple[int, ...]:
    """The batch axes that arguments with these leading axes have together."""
    if not any(leads.values()):
        return ()
    try:
        return np.broadcast_shapes(*leads.values())
    except ValueError:
        batches = ", ".join(f"{name} {axes}" for name, axes in leads.items() if axes)
        raise ValueError(f"leading axes must broadcast, got {batches}") from None


def positive_semidefinite(name: str, value: ArrayLike, size: int) -> Array:
    """A symmetric matrix (size, size) without negative eigenvalues; a vector is its diagonal."""
    K = weight(name, value, size)
    round_off = 1e-12 * np.abs(K).max(initial=0.0)
    if K.shape != (size, size) or (np.abs(K - K.T) > round_off).any():
        raise ValueError(f"{name} must be a diagonal of {size} or a symmetric matrix, got {K}")
    if (lowest := np.linalg.eigvalsh(K).min(initial=0.0)) < -round_off * size:
        raise ValueError(f"{name} must have no negative eigenvalue, got {lowest:.3g}")
    return K


def not_negative(name: str, value: ArrayLike) -> Array:
    """Finite numbers, none below zero."""
    if isinstance(value, float) and 0.0 <= value < inf:
        return np.asarray(value)
    x = real(name, value)
    if (x < 0).any():
        raise ValueError(f"{name} must not be negative, got {value!r}")
    return x


def number(name: str, value: ArrayLike) -> float:
    """One finite number, not below zero."""
    if isinstance(value, float) and 0.0 <= value < inf:
        return value
    x = not_negative(name, value)
    if x.ndim:
        raise ValueError(f"{name} must be one number, got shape {x.shape}")
    return float(x)


def fraction(name: str, value: ArrayLike) -> float:
    """One number of at least zero and below one."""
    x = number(name, value)
    if x >= 1:
        raise ValueError(f"{name} must lie below 1, got {x}")
    return x


def indices(name: str, value: Sequence[int] | ArrayLike, limit: int) -> Indices:
    """Distinct integers of range(limit), in the order given."""
    raw = _integers(name, value, limit)
    if len(set(raw.tolist())) != raw.size:
        raise ValueError(f"{name} must not repeat an index, got {raw.tolist()}")
    return raw


def index_set(name: str, value: Iterable[int], limit: int) -> frozenset[int]:
    """Integers of range(limit); order and repetition do not matter."""
    if not isinstance(value, Iterable):
        raise ValueError(f"{name} must be a list of integers, got {value!r}")
    members = value if isinstance(value, np.ndarray) else list(value)
    return frozenset(_integers(name, members, limit).tolist())


def lock_and_release(
    locked: Iterable[int], free: Iterable[int], n: int
) -> tuple[frozenset[int], frozenset[int]]:
    """Failed actuators of range(n), none of them in both sets."""
    lock, release = index_set("locked", locked, n), index_set("free", free, n)
    if both := sorted(lock & release):
        raise ValueError(f"an actuator is either locked or free, got both for {both}")
    return lock, release


def frozen(A: NDArray[_T]) -> NDArray[_T]:
    """A read-only copy."""
    A = np.array(A)
    A.setflags(write=False)
    return A


def _integers(name: str, value: Sequence[int] | ArrayLike, limit: int) -> Indices:
    raw = np.asarray(value)
    if raw.size == 0 and raw.ndim == 1:
        return np.zeros(0, dtype=np.intp)
    if raw.ndim != 1 or raw.dtype.kind not in "iu":
        raise ValueError(f"{name} must be a list of integers, got {value!r}")
    if raw.min() < 0 or raw.max() >= limit:
        raise ValueError(f"{name} must lie in 0..{limit - 1}, got {raw.tolist()}")
    return raw.astype(np.intp)
