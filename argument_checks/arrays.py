"""Arrays of finite numbers of moderate size, by shape."""

from math import prod
from typing import Any, TypeGuard, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg.blas import dnrm2

from argument_checks.shown import shown

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
Mask = NDArray[np.bool_]
_T = TypeVar("_T", bound=np.generic)
_FLOAT64 = np.dtype(np.float64)

LARGEST = 1e120
"""No number may be as large: squares, and products of two, must not overflow."""
SMALLEST = 1e-120
"""A matrix that is not zero must be as large, for the same reason: they must not vanish."""


def real(name: str, value: ArrayLike | None) -> Array:
    """A copy of finite real numbers of any shape as float64."""
    if is_plain(value) and is_moderate(value):
        return value.copy()  # the common case
    A = as_float64(name, value)
    if not np.isfinite(A).all():
        raise ValueError(f"{name} must be finite, got NaN or infinity")
    if (largest := np.abs(A).max(initial=0.0)) >= LARGEST:
        raise ValueError(f"{name} must be smaller than {LARGEST:g}, got {largest:.3g}")
    return A


def as_float64(name: str, value: ArrayLike | None) -> Array:
    """A copy of real numbers, infinite or not."""
    if is_masked(value):
        raise ValueError(f"{name} must have all its numbers, got a masked array: fill it first")
    try:
        raw = np.asarray(value)
    except ValueError:
        raise ValueError(f"{name} must be a rectangular array, got rows that differ") from None
    if raw.dtype.kind not in "fiu":
        got = raw.dtype if value is not None else None
        raise ValueError(f"{name} must hold real numbers, got {got}")
    with np.errstate(over="ignore"):  # long doubles
        return raw.astype(float)


def finite(name: str, value: ArrayLike) -> Array:
    """The same, but without a copy of what needs none: for what is called at every tick."""
    # The common case, calls spared: is_plain and is_moderate.
    if (
        type(value) is np.ndarray
        and value.dtype is _FLOAT64
        and (not value.size or dnrm2(value.ravel()) < LARGEST)
    ):
        return value
    return real(name, value)


def is_plain(value: ArrayLike | None) -> TypeGuard[Array]:
    """Whether this is an array of float64 as it stands, finite or not."""
    return type(value) is np.ndarray and value.dtype is _FLOAT64


def is_moderate(A: Array) -> bool:
    """Whether all numbers are finite and their norm moderate: one pass, and no array in between."""
    return A.size == 0 or dnrm2(A.ravel()) < LARGEST  # NaN is not


def shaped(name: str, value: ArrayLike, *shape: int) -> Array:
    """Finite numbers (..., *shape) with any leading batch axes; those of a float64 not copied."""
    A = finite(name, value)
    if A.ndim < len(shape) or A.shape[A.ndim - len(shape) :] != shape:
        expected = ", ".join(map(str, ("...", *shape)))
        raise ValueError(f"{name} must have shape ({expected}), got {A.shape}")
    return A


def exactly(name: str, value: ArrayLike, *shape: int) -> Array:
    """Finite numbers of one shape, without a copy of a float64 array; for every tick."""
    if (  # as above
        type(value) is np.ndarray
        and value.dtype is _FLOAT64
        and value.shape == shape
        and value.size
        and dnrm2(value.ravel()) < LARGEST
    ):
        return value
    A = real(name, value)
    if A.shape != shape:
        raise ValueError(f"{name} must be {prod(shape)} finite numbers, got shape {A.shape}")
    return A


def vector(name: str, value: ArrayLike | None, size: int) -> Array:
    """A finite vector with any leading batch axes, shape (..., size)."""
    v = real(name, value)
    if v.ndim < 1 or v.shape[-1] != size:
        raise ValueError(f"{name} must have shape (..., {size}), got {v.shape}")
    return v


def series(name: str, value: ArrayLike) -> Array:
    """One finite vector of any length, that of a float64 not copied."""
    if (v := finite(name, value)).ndim != 1:
        raise ValueError(f"{name} must be one vector, got shape {v.shape}")
    return v


def not_negative(name: str, value: ArrayLike) -> Array:
    """Finite numbers, none below zero."""
    if isinstance(value, float) and 0.0 <= value < LARGEST:
        return np.asarray(value)
    x = real(name, value)
    if (x < 0).any():
        raise ValueError(f"{name} must not be negative, got {shown(value)}")
    return x


def all_positive(name: str, value: ArrayLike, size: int) -> Array:
    """So many finite numbers above zero, none so small that its inverse is out of range."""
    A = exactly(name, value, size)
    if (A <= 1.0 / LARGEST).any():
        raise ValueError(f"{name} must be positive, at least {1 / LARGEST:g}, got {shown(value)}")
    return A


def common_axes(leads: dict[str, tuple[int, ...]]) -> tuple[int, ...]:
    """The batch axes that arguments with these leading axes have together."""
    if not any(leads.values()):
        return ()
    try:
        return np.broadcast_shapes(*leads.values())
    except ValueError:
        batches = ", ".join(f"{name} {axes}" for name, axes in leads.items() if axes)
        raise ValueError(f"leading axes must broadcast, got {batches}") from None


def frozen(A: NDArray[_T]) -> NDArray[_T]:
    """A read-only copy."""
    return read_only(np.array(A))


def read_only(A: NDArray[_T]) -> NDArray[_T]:
    """The array itself, made read-only."""
    A.setflags(write=False)
    return A


def is_masked(value: Any) -> bool:
    """Whether numbers of an array, or of one in a list, are hidden behind a mask."""
    if isinstance(value, list | tuple):
        return any(map(is_masked, value))
    return isinstance(value, np.ma.MaskedArray)


def flat(A: Array, own: int, lead: tuple[int, ...]) -> Array:
    """Arrays of so many axes of their own, broadcast to batch axes and then as one batch, in C.

    Without batch axes the array itself.
    """
    if not lead:
        return np.ascontiguousarray(A)
    shape = A.shape[A.ndim - own :]
    return np.ascontiguousarray(np.broadcast_to(A, (*lead, *shape))).reshape(-1, *shape)
