"""Lexicographic least squares: each level decides only what those above it leave free."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from prioritized import _check
from prioritized._check import Array
from prioritized._rank import RankedSvd, ranked_svd


@dataclass(frozen=True)
class Level:
    """Bring A x as close to target p as the levels above allow, for whatever p comes.

    Attributes:
        A: Shape (..., k, n).
        target: Shape (..., k, p).
        scale: Size of the matrices that A was made from, shape (...); ranks are decided against it.
        damping: Tikhonov damping of this level alone, in units of A's singular values.
    """

    A: Array
    target: Array
    scale: Array | float
    damping: float = 0.0


def lexicographic(levels: Sequence[Level], tolerance: float) -> tuple[Array, list[RankedSvd]]:
    """Gain X of x = X p, shape (..., n, p), and the rank decision of each level.

    What ties remain after the last level are broken by the least norm of x. Batches need
    projectors instead of bases: they have one shape whatever the rank.
    """
    n, p = levels[0].A.shape[-1], levels[0].target.shape[-1]
    X, free = np.zeros((n, p)), np.eye(n)
    decisions = []
    for level in levels:
        decided = ranked_svd(level.A @ free, level.scale, tolerance)
        decisions.append(decided)
        if level.A.shape[-2] == 0:
            continue
        # The step lies in `free` and across the null space left to the next level: least norm.
        step = free @ decided.pseudo_inverse(level.damping)
        X = X + step @ (level.target - level.A @ X)
        free = free @ decided.null_projector()
    return X, decisions


def stack(top: Array, bottom: Array) -> Array:
    """One matrix above another, leading axes broadcast."""
    if top.shape[:-2] == bottom.shape[:-2]:
        return np.concatenate([top, bottom], axis=-2)
    lead = np.broadcast_shapes(top.shape[:-2], bottom.shape[:-2])
    wide = [np.broadcast_to(A, lead + A.shape[-2:]) for A in (top, bottom)]
    return np.concatenate(wide, axis=-2)


def transposed(A: Array) -> Array:
    """The transpose of each matrix of a batch."""
    return np.swapaxes(A, -1, -2)


def respond(gains: Sequence[Array], required: str, **wishes: ArrayLike | None) -> Array:
    """Sum of each gain (..., i, j) times its wish (..., j); what is None counts as zero.

    Raises:
        ValueError: A wish of the wrong shape or not finite, or the required one None; by its name.
    """
    total = np.zeros(gains[0].shape[-2])
    for gain, (name, wish) in zip(gains, wishes.items(), strict=True):
        if wish is not None or name == required:
            total = total + apply(gain, name, wish)
    return total


def apply(gain: Array, name: str, value: ArrayLike | None) -> Array:
    """Gain (..., i, j) times a checked argument (..., j)."""
    v = _check.vector(name, value, gain.shape[-1])
    _check.common_axes({"the mapping": gain.shape[:-2], name: v.shape[:-1]})
    return np.einsum("...ij,...j->...i", gain, v)
