"""Operations on batches of matrices and vectors."""

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

import argument_checks as check
from argument_checks import Array
from argument_checks import read_only as read_only


def stack(top: Array, bottom: Array) -> Array:
    """Stack one matrix above another, broadcasting leading axes."""
    if top.shape[:-2] == bottom.shape[:-2]:
        return np.concatenate([top, bottom], axis=-2)
    lead = np.broadcast_shapes(top.shape[:-2], bottom.shape[:-2])
    wide = [np.broadcast_to(A, lead + A.shape[-2:]) for A in (top, bottom)]
    return np.concatenate(wide, axis=-2)


def product(A: Array, B: Array) -> Array:
    """Return A B, broadcasting leading axes."""
    # For small matrices call overhead dominates, and that of dot is half that of @.
    return A.dot(B) if A.ndim == 2 and B.ndim <= 2 else A @ B


def transposed(A: Array) -> Array:
    """Return the transpose of each matrix of a batch."""
    return np.swapaxes(A, -1, -2)


def apply(gain: Array, name: str, value: ArrayLike | None) -> Array:
    """Return a gain (..., i, j) times a checked argument (..., j)."""
    v = check.array(name, value, ..., gain.shape[-1])
    if gain.ndim == 2 and v.ndim == 1:
        return gain.dot(v)
    check.common_axes({"the mapping": gain.shape[:-2], name: v.shape[:-1]})
    return np.einsum("...ij,...j->...i", gain, v)


def times(A: Array, x: Array) -> Array:
    """Return A (..., i, j) times x (..., j), broadcasting leading axes."""
    return (A @ x[..., None])[..., 0]


def concatenated(*vectors: Array) -> Array:
    """Concatenate vectors (..., i), (..., j) to (..., i + j), broadcasting leading axes."""
    lead = np.broadcast_shapes(*(vector.shape[:-1] for vector in vectors))
    wide = [np.broadcast_to(vector, (*lead, vector.shape[-1])) for vector in vectors]
    return np.concatenate(wide, axis=-1)


def joined(lead: tuple[int, ...], required: str, **inputs: tuple[ArrayLike | None, int]) -> Array:
    """Join checked inputs (..., size), each given with its size, in one vector; None is zero."""
    given = {
        name: np.zeros(size)
        if value is None and name != required
        else check.array(name, value, ..., size)
        for name, (value, size) in inputs.items()
    }
    check.common_axes({"the mapping": lead, **{name: v.shape[:-1] for name, v in given.items()}})
    return concatenated(np.zeros((*lead, 0)), *given.values())


def on_axes(A: Array, lead: tuple[int, ...]) -> Array:
    """Broadcast matrices to all batch axes."""
    return A if A.shape[:-2] == lead else np.broadcast_to(A, (*lead, *A.shape[-2:]))


@lru_cache
def none(shape: tuple[int, ...]) -> Array:
    """Return a shared read-only array of zeros, mostly an empty one."""
    return read_only(np.zeros(shape))


@lru_cache
def ones(size: int) -> Array:
    """Return a shared read-only vector of ones."""
    return read_only(np.ones(size))


@lru_cache
def identity(size: int) -> Array:
    """Return a shared read-only identity matrix."""
    return read_only(np.eye(size))


class ReadOnly:
    """Base of frozen dataclasses whose arrays, also those in tuples, are read-only."""

    def __post_init__(self) -> None:
        """Make every array field read-only."""
        for value in vars(self).values():
            for A in value if isinstance(value, tuple) else (value,):
                if isinstance(A, np.ndarray):
                    A.setflags(write=False)
