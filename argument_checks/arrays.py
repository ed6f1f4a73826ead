"""Checks of arrays, limits and weights: finite real numbers of moderate magnitude."""

from collections.abc import Sequence
from types import EllipsisType
from typing import Any, TypeGuard, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg.blas import dnrm2

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
Mask = NDArray[np.bool_]
_T = TypeVar("_T", bound=np.generic)
_FLOAT64 = np.dtype(np.float64)

LARGEST = 1e120
"""Bound on the magnitude of every number, so that squares and products of two do not overflow."""
SMALLEST = 1e-120
"""Least magnitude of a non-zero matrix, so that its square does not underflow to zero."""


def short_repr(value: Any) -> str:
    """Return a one-line representation of a value for error messages, at most 80 characters."""
    try:
        text = " ".join(repr(value).split())
    except ValueError:  # Python does not write out integers of thousands of digits
        text = f"a huge {type(value).__name__}"
    return text if len(text) <= 80 else f"{text[:77]}..."


def array(
    name: str,
    value: ArrayLike | None,
    *shape: int | EllipsisType | None,
    least: float | None = None,
    finite: bool = True,
    copy: bool = False,
) -> Array:
    """Check an array of real numbers and return it as float64; it must be finite by default.

    Args:
        name: Name of the argument, for messages.
        value: Array-like; a float64 array of the right shape is returned without copying.
        shape: Length of each axis, None for any; a leading `...` stands for any batch axes. Without
            a shape, any is accepted. With two lengths or more, each matrix must be zero or have an
            entry of at least :data:`SMALLEST`.
        least: Lower bound of all numbers; None: no bound.
        finite: Refuse NaN, infinity and numbers so large that products overflow.
        copy: Always return a new array.
    """
    if type(value) is np.ndarray and value.dtype is _FLOAT64 and least is None and not copy:
        size = dnrm2(value.ravel()) if value.size else 0.0
        is_sized = size < LARGEST and (size == 0.0 or size >= SMALLEST or len(shape) < 2)
        if is_sized and (not shape or value.shape == shape or _has_shape(value, shape)):
            return value  # the common case
    A = value if is_plain(value) else _as_float64(name, value)
    if finite and not is_moderate(A):
        if not np.isfinite(A).all():
            raise ValueError(f"{name} must be finite, got NaN or infinity")
        if (largest := np.abs(A).max()) >= LARGEST:
            raise ValueError(f"{name} must be smaller than {LARGEST:g}, got {largest:.3g}")
    if shape and not _has_shape(A, shape):
        raise ValueError(f"{name} must have shape {_written(shape)}, got {A.shape}")
    if least is not None and A.size and (low := A.min()) < least:
        raise ValueError(f"{name} must {at_least(least)}, got {low:.6g}")
    if len(shape) > 1 and shape[-2] is not ...:
        _refuse_tiny(name, A)
    return A.copy() if copy and A is value else A


def at_least(least: float) -> str:
    """Return the words for a lower bound in error messages, such as "not be negative"."""
    signs = {0.0: "not be negative", SMALLEST: f"be positive, at least {SMALLEST:g}"}
    return signs.get(least, f"be at least {least:g}")


def is_plain(value: ArrayLike | None) -> TypeGuard[Array]:
    """Return whether a value is a float64 ndarray, finite or not."""
    return type(value) is np.ndarray and value.dtype is _FLOAT64


def is_moderate(A: Array) -> bool:
    """Return whether all numbers are finite and their norm is below :data:`LARGEST`."""
    return A.size == 0 or dnrm2(A.ravel()) < LARGEST  # NaN is not


def is_masked(value: Any) -> bool:
    """Return whether a value is a masked array, or a list that contains one."""
    if isinstance(value, list | tuple):
        return any(map(is_masked, value))
    return isinstance(value, np.ma.MaskedArray)


def limits(
    name: str, value: Sequence[ArrayLike] | Array, size: int, *, batch: bool = False
) -> tuple[Array, Array]:
    """Check a pair (lower, upper) of limits, infinite where there is no limit, and return both.

    Each is `size` numbers, or one number for all; equal limits fix the variable. The result is a
    pair of read-only copies (size,); with `batch` each may have leading axes and is not copied.
    """
    try:
        lower, upper = value
    except (TypeError, ValueError):
        raise ValueError(f"{name} must be a pair (lower, upper), got {short_repr(value)}") from None
    lower, upper = _side(name, lower, size), _side(name, upper, size)
    if lower.shape != upper.shape:
        common_axes({f"{name}[0]": lower.shape[:-1], f"{name}[1]": upper.shape[:-1]})
        lower, upper = np.broadcast_arrays(lower, upper)
    if (lower > upper).any() or (lower == np.inf).any() or (upper == -np.inf).any():
        raise ValueError(f"{name} must be a lower and an upper limit, got {short_repr(value)}")
    if batch:
        return lower, upper
    if lower.ndim > 1:
        raise ValueError(f"{name} must be two numbers or of shape ({size},), got {lower.shape}")
    return frozen(np.broadcast_to(lower, size)), frozen(np.broadcast_to(upper, size))


def weight(name: str, value: ArrayLike, size: int, *, semidefinite: bool = False) -> Array:
    """Check a weighting matrix (..., k, size), or its diagonal (size,), and return the matrix.

    With `semidefinite` it must be symmetric, (size, size), without negative eigenvalues.
    """
    W = array(name, value, copy=True)
    if W.ndim == 0 or W.shape[-1] != size:
        expected = f"({size},) or {_written((..., None, size))}"
        raise ValueError(f"{name} must have shape {expected}, got {W.shape}")
    W = np.diag(W) if W.ndim == 1 else W
    if not semidefinite:
        return W
    _refuse_tiny(name, W)
    round_off = 1e-12 * np.abs(W).max(initial=0.0)
    if W.shape != (size, size) or (np.abs(W - W.T) > round_off).any():
        got = short_repr(W.tolist())
        raise ValueError(f"{name} must be {size} numbers or a symmetric matrix, got {got}")
    if (lowest := np.linalg.eigvalsh(W).min(initial=0.0)) < -round_off * size:
        raise ValueError(f"{name} must have no negative eigenvalue, got {lowest:.3g}")
    return W


def common_axes(leads: dict[str, tuple[int, ...]]) -> tuple[int, ...]:
    """Return the batch axes to which arguments with these leading axes broadcast."""
    if not any(leads.values()):
        return ()
    try:
        return np.broadcast_shapes(*leads.values())
    except ValueError:
        batches = ", ".join(f"{name} {axes}" for name, axes in leads.items() if axes)
        raise ValueError(f"leading axes must broadcast, got {batches}") from None


def frozen(A: NDArray[_T]) -> NDArray[_T]:
    """Return a read-only copy of an array."""
    return read_only(np.array(A))


def read_only(A: NDArray[_T]) -> NDArray[_T]:
    """Make an array read-only, without copying, and return it."""
    A.setflags(write=False)
    return A


def flat(A: Array, axes: int, lead: tuple[int, ...]) -> Array:
    """Return an array broadcast to the batch axes `lead`, merged into one axis, C-contiguous.

    `axes` is the number of other axes, at the end. An empty `lead` adds no axis.
    """
    if not lead:
        return np.ascontiguousarray(A)
    shape = A.shape[A.ndim - axes :]
    return np.ascontiguousarray(np.broadcast_to(A, (*lead, *shape))).reshape(-1, *shape)


def _as_float64(name: str, value: ArrayLike | None) -> Array:
    """Return a float64 copy of real numbers, which may be infinite."""
    if is_masked(value):
        raise ValueError(f"{name} must have no masked entry, got a masked array: fill it first")
    try:
        raw = np.asarray(value)
    except ValueError:
        raise ValueError(
            f"{name} must be a rectangular array, got rows of different lengths"
        ) from None
    if raw.dtype.kind not in "fiu":
        got = raw.dtype if value is not None else None
        raise ValueError(f"{name} must hold real numbers, got {got}")
    with np.errstate(over="ignore"):  # long doubles
        return raw.astype(float)


def _has_shape(A: Array, shape: tuple[int | EllipsisType | None, ...]) -> bool:
    lengths = A.shape
    if shape[0] is ...:
        shape = shape[1:]
        lengths = lengths[max(len(lengths) - len(shape), 0) :]
    return lengths == shape or (len(lengths) == len(shape) and all(map(_fits, lengths, shape)))


def _fits(length: int, size: int | EllipsisType | None) -> bool:
    return size is None or length == size


def _written(shape: tuple[int | EllipsisType | None, ...]) -> str:
    """Format a shape for error messages, such as (3,) or (..., any, 6)."""
    names = {None: "any", ...: "..."}
    lengths = [names[n] if n is None or n is ... else str(n) for n in shape]
    return f"({', '.join(lengths)}{',' if len(lengths) == 1 else ''})"


def _refuse_tiny(name: str, A: Array) -> None:
    """Raise for a matrix that is neither zero nor large enough for products."""
    if A.ndim == 2 and A.size and dnrm2(A.ravel()) >= SMALLEST:
        return  # the common case
    size = np.abs(A).max(axis=(-2, -1), initial=0.0)
    if (small := size[(size > 0.0) & (size < SMALLEST)]).size:
        raise ValueError(
            f"{name} must be zero or have an entry of at least {SMALLEST:g}, got {small[0]:g}"
        )


def _side(name: str, value: ArrayLike, size: int) -> Array:
    """Check lower or upper limits (..., size), or one number; they may be infinite."""
    if type(value) is float and abs(value) < LARGEST:
        return np.asarray(value)  # the common case
    A = value if is_plain(value) else _as_float64(name, value)
    if not is_moderate(A):
        if np.isnan(A).any():
            raise ValueError(f"{name} must hold numbers or infinity, got NaN")
        if (largest := np.abs(A).max(where=np.isfinite(A), initial=0.0)) >= LARGEST:
            raise ValueError(f"{name} must be infinite or below {LARGEST:g}, got {largest:.3g}")
    if A.ndim and A.shape[-1] != size:
        raise ValueError(
            f"{name} must be a pair of numbers or of shapes (..., {size}), got {A.shape}"
        )
    return A
