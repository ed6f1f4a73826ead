"""Lexicographic least squares: each level decides only what those above it leave free."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from argument_checks import Array
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


def smallest_gap(decisions: Sequence[RankedSvd]) -> Array:
    """Smallest gap of the decisions, shape (...)."""
    gap = np.asarray(np.inf)
    for decided in decisions:
        if decided.sigma.size:
            gap = np.minimum(gap, decided.gap)
    return gap
