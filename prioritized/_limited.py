"""The optimum of Problems 1 and 6 under limits."""

from collections.abc import Sequence
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

import argument_checks as check
from argument_checks import Array, Mask
from prioritized._arrays import times
from prioritized._levels import Level
from prioritized._limits import Limits, limits
from prioritized._packed import Equations, Point, Rows, Unknowns, pack, solve

WhenLimited = Literal["least_squares", "scaled"]
"""What becomes of a major task that limits hold back: least error, or its direction kept."""


class Limiting(NamedTuple):
    """What limits the unknowns of a problem.

    Attributes:
        box: Bounds of the unknowns.
        rows: Inequality rows.
        when: What becomes of a major task that these hold back.
    """

    box: Limits
    rows: tuple[Rows, ...] = ()
    when: WhenLimited = "least_squares"


def limiting(
    n: int,
    name: str,
    box: tuple[ArrayLike, ArrayLike] | None,
    rows: dict[str, tuple[ArrayLike, ArrayLike, ArrayLike] | None],
    when_limited: WhenLimited = "least_squares",
) -> Limiting | None:
    """Checked limits of n unknowns and rows of them, under their names; None is no limit."""
    if when_limited not in get_args(WhenLimited):
        choices = " or ".join(map(repr, get_args(WhenLimited)))
        raise ValueError(f"when_limited must be {choices}, got {check.shown(when_limited)}")
    given = [checked_rows(label, value, n) for label, value in rows.items() if value is not None]
    if box is None and not given:
        return None
    return Limiting(limits(name, box, n), tuple(given), when_limited)


def checked_rows(name: str, value: tuple[ArrayLike, ArrayLike, ArrayLike], n: int) -> Rows:
    """Inequality rows (R, lower, upper) of n unknowns.

    Raises:
        ValueError: No triple, or a wrong shape or number in it.
    """
    try:
        R, lower, upper = value
    except (TypeError, ValueError):
        raise ValueError(f"{name} must be (R, lower, upper), got {check.shown(value)}") from None
    G = check.matrix(name, R, columns=n)
    return Rows(G, limits(name, (lower, upper), len(G)))


class Optimum(NamedTuple):
    """The optimum of each problem of a batch, whose axes lead.

    Attributes:
        x: Shape (..., n).
        active: Which limits hold x and the rows: -1 a lower, 1 an upper, 0 none, (..., n + r).
        scale: Part of the major task that is asked for in the end, (...).
        infeasible: Whether limits and constraints contradict each other, (...).
        ended: Whether the solver came to an end, (...).
        point: From which a similar problem can start.
    """

    x: Array
    active: NDArray[np.int8]
    scale: Array
    infeasible: Mask
    ended: Mask
    point: Point


def optimum(
    levels: Sequence[Level],
    p: Array,
    unlimited: Array,
    limiting: Limiting | None,
    tolerance: float,
    start: Point | None = None,
) -> Optimum:
    """The optimum under limits of levels whose first is the constraint, the second the major task.

    Args:
        levels: As of the problem without limits.
        p: What the targets of the levels multiply, (..., p).
        unlimited: The solution without limits, (..., n).
        limiting: The limits; None is none.
        tolerance: Of the rank decisions.
        start: Solution of a similar problem.
    """
    lead, n = p.shape[:-1], unlimited.shape[-1]
    if limiting is None:
        limiting = Limiting(limits("", None, n))
    equations = [Equations(one.A, times(one.target, p), np.asarray(one.scale)) for one in levels]
    equations.append(Equations(np.eye(n), np.zeros(n), np.asarray(1.0)))
    unknowns, rows = Unknowns(limiting.box, unlimited), limiting.rows
    scaled = limiting.when == "scaled"
    if scaled:
        equations, rows, unknowns = _keeping_direction(equations, rows, unknowns, unlimited)
    hard = len(rows) + 1
    packed, without = pack([*rows, *equations], unknowns, tolerance)
    point = solve(packed, without, start)
    part = np.ones(len(point.x))
    if scaled:
        most = np.broadcast_to(packed.upper[:, n], part.shape)
        np.divide(point.x[:, n], most, out=part, where=most > 0.0)
    kept = np.r_[:n, n + scaled : point.x.shape[1]]
    return Optimum(
        x=point.x[:, :n].reshape(*lead, n),
        active=point.active[:, kept].reshape(*lead, len(kept)),
        scale=part.reshape(lead),
        infeasible=packed.unmet(slice(0, hard), point.x).reshape(lead),
        ended=point.ended.reshape(lead),
        point=point,
    )


def _keeping_direction(
    equations: Sequence[Equations], rows: Sequence[Rows], unknowns: Unknowns, unlimited: Array
) -> tuple[list[Equations], list[Rows], Unknowns]:
    """One more unknown: how much of what is achieved without limits; as much as possible."""
    constraint, major, *rest = (each._replace(A=_with_column(each.A, 0.0)) for each in equations)
    achieved = times(equations[1].A, unlimited)
    size = np.linalg.norm(achieved, axis=-1, keepdims=True)
    unit = achieved / np.where(size > 0.0, size, 1.0)
    # Of the size of the major rows, so that no rank depends on how fast the motion is.
    scale = np.where(major.scale > 0.0, major.scale, 1.0)[..., None]
    most = size / scale
    along = major._replace(A=_with_column(equations[1].A, -unit * scale), b=np.zeros(unit.shape))
    one = np.zeros((1, along.A.shape[-1]))
    one[0, -1] = 1.0
    levels = [constraint, along, Equations(one, most, np.asarray(1.0)), *rest]
    wide = [each._replace(G=_with_column(each.G, 0.0)) for each in rows]
    return levels, wide, unknowns.and_also(np.zeros_like(most), most, most)


def _with_column(A: Array, column: Array | float) -> Array:
    """A matrix with one more column, leading axes broadcast."""
    lead = np.broadcast_shapes(A.shape[:-1], np.shape(column))
    last = np.broadcast_to(column, lead)[..., None]
    return np.concatenate([np.broadcast_to(A, (*lead, A.shape[-1])), last], axis=-1)
