"""Levels of least squares in the form that the compiled solver takes."""

from collections.abc import Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from argument_checks import Array
from prioritized._limits import Limits


class Packed(NamedTuple):
    """Minimize |A_k x - b_k| level by level, lower <= x <= upper; B problems of one shape.

    Attributes:
        A: Rows of all levels, one after the other, shape (B, k, n).
        b: Shape (B, k).
        ends: Where each level ends in A.
        scales: Size of the matrices that each level's rows were made from, (B, levels).
        tolerance: Fraction of the scale below which a row depends on others.
        lower: Shape (n,).
        upper: Shape (n,).
    """

    A: Array
    b: Array
    ends: NDArray[np.int64]
    scales: Array
    tolerance: float
    lower: Array
    upper: Array

    def rest(self, x: Array) -> Array:
        """b - A x of every row, shape (B, k)."""
        return self.b - (self.A @ x[..., None])[..., 0]


class Point(NamedTuple):
    """Where the solver ended, the batch axis first.

    Attributes:
        x: Shape (B, n).
        active: -1 where a lower bound is active, 1 where an upper one is, 0 elsewhere, (B, n).
        steps: Of the active set, (B,).
        ended: Whether x is the optimum: it always obeys the bounds, (B,).
        gap: Smallest gap of the rank decisions, (B,).
    """

    x: Array
    active: NDArray[np.int8]
    steps: NDArray[np.int64]
    ended: NDArray[np.bool_]
    gap: Array


@cache
def _solver() -> Any:
    """The compiled solver; loading the compiler takes some 0.3 s."""
    from prioritized import _bounded

    return _bounded


def solve(
    packed: Packed,
    optimum: Array | None = None,
    start: Point | None = None,
    most_steps: int | None = None,
) -> Point:
    """The solution of each problem.

    Args:
        packed: The problems.
        optimum: Their solutions without bounds, where known, (B, n).
        start: The solution of similar problems: they start from its active set.
        most_steps: Of the active set, for each problem; None is 20 (n + 1) for each level.
    """
    count, _, n = packed.A.shape
    solver, how = _solver(), 0
    x, active = np.zeros((count, n)), np.zeros((count, n), np.int8)
    if start is not None and start.x.shape == x.shape:
        how, x[:], active[:] = solver.WARM, start.x, start.active
    elif optimum is not None:
        how, x[:] = solver.FROM_OPTIMUM, optimum
    most = 20 * (n + 1) * len(packed.ends) if most_steps is None else most_steps
    steps, ended, gap = np.zeros(count, np.int64), np.zeros(count, np.bool_), np.zeros(count)
    solver.solve_each(*packed, x, active, how, most, steps, ended, gap)
    return Point(x, active, steps, ended, gap)


class Rows(NamedTuple):
    """Inequality rows: lower <= G x <= upper, G (..., r, n)."""

    G: Array
    limits: Limits


def with_slack(blocks: Sequence[tuple[Array, Array] | Rows], box: Limits) -> tuple[list[tuple[Array, Array]], Limits]:
    """Levels of equations in [x; s] for levels of equations (A, b) or inequality rows.

    A row g of inequalities becomes the equation g x = |g| s with s between its limits over |g|: its
    residual is then what g x lacks to lie between them.
    """
    count = sum(each.G.shape[-2] for each in blocks if isinstance(each, Rows))
    levels, bounds, at = [], [box], 0
    for each in blocks:
        A = each.G if isinstance(each, Rows) else each[0]
        wide = np.concatenate([A, np.zeros((*A.shape[:-1], count))], axis=-1)
        if isinstance(each, Rows):
            r, n = A.shape[-2:]
            size = np.sqrt((A.reshape(-1, r, n) ** 2).sum(axis=-1).max(axis=0))
            size[size == 0.0] = 1.0
            wide[..., range(r), range(n + at, n + at + r)] = -size
            bounds.append((each.limits[0] / size, each.limits[1] / size))
            at += r
            levels.append((wide, np.zeros(A.shape[:-1])))
        else:
            levels.append((wide, each[1]))
    lower, upper = (np.concatenate(side) for side in zip(*bounds, strict=True))
    return levels, (lower, upper)
