"""Lower and upper limits, which may be infinite."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from argument_checks.arrays import (
    LARGEST,
    Array,
    as_float64,
    common_axes,
    frozen,
    is_moderate,
    is_plain,
)
from argument_checks.shown import shown


def limits(name: str, value: Sequence[ArrayLike] | Array, size: int) -> tuple[Array, Array]:
    """A pair (lower, upper), given as numbers or (..., size); infinite where there is no limit.

    For every tick: plain arrays are not copied.
    """
    try:
        lower, upper = value
    except (TypeError, ValueError):
        raise ValueError(f"{name} must be a pair (lower, upper), got {shown(value)}") from None
    lower, upper = _side(name, lower, size), _side(name, upper, size)
    if lower.shape != upper.shape:
        common_axes({f"{name}[0]": lower.shape[:-1], f"{name}[1]": upper.shape[:-1]})
        lower, upper = np.broadcast_arrays(lower, upper)
    if (lower > upper).any() or (lower == np.inf).any() or (upper == -np.inf).any():
        raise ValueError(f"{name} must be a lower and an upper limit, got {shown(value)}")
    return lower, upper


def limit_vectors(name: str, value: Sequence[ArrayLike] | Array, size: int) -> tuple[Array, Array]:
    """The same as read-only copies of shape (size,) each; batches are refused."""
    lower, upper = limits(name, value, size)
    if lower.ndim > 1:
        raise ValueError(f"{name} must be two numbers or of shape ({size},), got {lower.shape}")
    return frozen(np.broadcast_to(lower, size)), frozen(np.broadcast_to(upper, size))


def _side(name: str, value: ArrayLike, size: int) -> Array:
    if type(value) is float and abs(value) < LARGEST:
        return np.asarray(value)  # the common case
    A = value if is_plain(value) and is_moderate(value) else _extended(name, value)
    if A.ndim and A.shape[-1] != size:
        raise ValueError(
            f"{name} must be a pair of numbers or of shapes (..., {size}), got {A.shape}"
        )
    return A


def _extended(name: str, value: ArrayLike) -> Array:
    """A copy of real numbers of moderate size, or infinite."""
    A = as_float64(name, value)
    if np.isnan(A).any():
        raise ValueError(f"{name} must hold numbers or infinity, got NaN")
    if (largest := np.abs(A).max(where=np.isfinite(A), initial=0.0)) >= LARGEST:
        raise ValueError(f"{name} must be infinite or below {LARGEST:g}, got {largest:.3g}")
    return A
