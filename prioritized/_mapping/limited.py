"""Optima of Problems 1 and 6 under limits."""

from collections.abc import Sequence
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

import argument_checks as check
from argument_checks import Array
from argument_checks.ties import exceeds
from prioritized._mapping.levels import Level, damped
from prioritized._solver.arrays import concatenated, times
from prioritized._solver.limits import Limits, limits
from prioritized._solver.packed import Equations, Packed, Point, Rows, pack, solved

WhenLimited = Literal["least_squares", "scaled"]
"""Treatment of a major task beyond the limits: least error, or its direction preserved."""
_CHOICES = get_args(WhenLimited)


class Limiting(NamedTuple):
    """Limits of the unknowns of a problem.

    Attributes:
        box: Bounds of the unknowns.
        rows: Inequality rows.
        when: Treatment of a major task beyond these limits.
    """

    box: Limits
    rows: tuple[Rows, ...] = ()
    when: WhenLimited = "least_squares"

    @property
    def is_box(self) -> bool:
        """Return whether there are bounds of the unknowns only."""
        return not self.rows and self.when == "least_squares"

    def natural(self, units: Array) -> "Limiting":
        """Return these limits for unknowns in natural units, (n,)."""
        rows = tuple(Rows(block.G * units, block.limits) for block in self.rows)
        return self._replace(box=np.asarray(self.box) / units, rows=rows)


def limiting(
    n: int,
    name: str,
    box: tuple[ArrayLike, ArrayLike] | None,
    rows: dict[str, tuple[ArrayLike, ArrayLike, ArrayLike] | None],
    when_limited: WhenLimited = "least_squares",
) -> Limiting | None:
    """Check limits and rows of n unknowns, given by argument name; None is no limit."""
    if not isinstance(when_limited, str) or when_limited not in _CHOICES:
        choices = " or ".join(map(repr, _CHOICES))
        raise ValueError(f"when_limited must be {choices}, got {check.short_repr(when_limited)}")
    checked = [checked_rows(label, value, n) for label, value in rows.items() if value is not None]
    if box is None and not checked:
        return None
    return Limiting(limits(name, box, n), tuple(checked), when_limited)


def checked_rows(name: str, value: tuple[ArrayLike, ArrayLike, ArrayLike], n: int) -> Rows:
    """Check inequality rows (R, lower, upper) of n unknowns."""
    try:
        R, lower, upper = value
    except (TypeError, ValueError):
        got = check.short_repr(value)
        raise ValueError(f"{name} must be (R, lower, upper), got {got}") from None
    G = check.array(name, R, None, n, copy=True)
    return Rows(G, limits(name, (lower, upper), len(G)))


class Optimum(NamedTuple):
    """Optimum of each problem of a batch, whose axes lead.

    Attributes:
        packed: Problems in the form of the solver: unknowns are x, then if `scaled` the scale of
            the major task, then one slack for each inequality row.
        point: Result of the solver, which can warm-start a similar problem.
        n: Number of unknowns x.
        hard: Number of levels that must hold: inequality rows and constraints.
        scaled: Whether the direction of the major task is preserved.
        lead: Batch axes.
    """

    packed: Packed
    point: Point
    n: int
    hard: int
    scaled: bool
    lead: tuple[int, ...]

    @property
    def x(self) -> Array:
        """Solution, shape (..., n)."""
        return self.point.x[:, : self.n].reshape(*self.lead, self.n)

    @property
    def active(self) -> NDArray[np.int8]:
        """Limits that x is at: -1 a lower, 1 an upper, 0 none, shape (..., n)."""
        return self._at_bounds[:, : self.n].reshape(*self.lead, self.n)

    @property
    def active_rows(self) -> NDArray[np.int8]:
        """Limits that the inequality rows are at: -1 a lower, 1 an upper, 0 none, (..., r)."""
        active = self._at_bounds[:, self.n + self.scaled :]
        return active.reshape(*self.lead, active.shape[1])

    @property
    def _at_bounds(self) -> NDArray[np.int8]:
        return self.packed.at_bounds(self.point.x)

    @property
    def scale(self) -> Array:
        """Fraction of the achievable major task that remains within the limits, (...)."""
        part = np.ones(len(self.point.x))
        if self.scaled:
            most = np.broadcast_to(self.packed.upper[:, self.n], part.shape)
            np.divide(self.point.x[:, self.n], most, out=part, where=most > 0.0)
            part[~exceeds(1.0, part)] = 1.0
        return part.reshape(self.lead)

    @property
    def infeasible(self) -> bool:
        """Return whether limits and constraints contradict each other in any problem."""
        hard = slice(0, self.hard)
        return self.hard > 0 and bool(self.packed.is_violated(hard, self.point.x).any())


def optimum(
    levels: Sequence[Level],
    p: Array,
    limiting: Limiting | None,
    tolerance: float,
    start: Point | None = None,
) -> Optimum:
    """Solve levels under limits; the first is the constraint, the second the major task.

    The targets of the levels are `target @ p`, p (..., p); `start` is a solution of a similar
    problem.
    """
    lead, n = p.shape[:-1], levels[0].A.shape[-1]
    if limiting is not None and not limiting.is_box and levels[1].damping:
        levels = [*damped(levels[:2], tolerance), *levels[2:]]
    equations = [
        Equations(level.A, _target_rows(level, p), np.asarray(level.scale), level.damping)
        for level in levels
    ]
    if limiting is None:
        packed = pack(equations, limits("", None, n), tolerance)
        return Optimum(packed, solved(packed, start), n, 1, False, lead)
    box, rows, scaled = limiting.box, limiting.rows, limiting.when == "scaled"
    if scaled:
        achieved = times(levels[1].A, optimum(levels, p, None, tolerance).x)
        equations, rows, box = _keeping_direction(equations, rows, box, achieved)
    packed = pack([*rows, *equations], box, tolerance)
    if scaled:
        packed = packed._replace(unknowns=n)
    return Optimum(packed, solved(packed, start), n, len(rows) + 1, scaled, lead)


def _target_rows(level: Level, p: Array) -> Array:
    """Return the targets of the rows of a level, (..., k)."""
    target = times(level.target, p)
    rows = level.A.shape[-2]
    return target if target.shape[-1] == rows else np.broadcast_to(target, (*p.shape[:-1], rows))


def _keeping_direction(
    equations: Sequence[Equations], rows: Sequence[Rows], box: Limits, achieved: Array
) -> tuple[list[Equations], list[Rows], Limits]:
    """Add an unknown that scales the motion achieved without limits, and a level to maximize it."""
    wide = [level._replace(A=_with_column(level.A, 0.0)) for level in equations]
    constraint, major, *lower_levels = wide
    size = np.linalg.norm(achieved, axis=-1, keepdims=True)
    unit = achieved / np.where(size > 0.0, size, 1.0)
    # Scaled as the major rows, so that no rank depends on the speed of the motion.
    scale = np.where(major.scale > 0.0, major.scale, 1.0)[..., None]
    most = size / scale
    along = major._replace(A=_with_column(equations[1].A, -unit * scale), b=np.zeros(unit.shape))
    unit_row = np.zeros((1, along.A.shape[-1]))
    unit_row[0, -1] = 1.0
    levels = [constraint, along, Equations(unit_row, most, np.asarray(1.0)), *lower_levels]
    wide_rows = [block._replace(G=_with_column(block.G, 0.0)) for block in rows]
    low, high = box
    return levels, wide_rows, (concatenated(low, np.zeros_like(most)), concatenated(high, most))


def _with_column(A: Array, column: Array | float) -> Array:
    """Append a column to a matrix, broadcasting leading axes."""
    lead = np.broadcast_shapes(A.shape[:-1], np.shape(column))
    last = np.broadcast_to(column, lead)[..., None]
    return np.concatenate([np.broadcast_to(A, (*lead, A.shape[-1])), last], axis=-1)
