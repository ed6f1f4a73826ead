"""Lexicographic least squares under bounds and inequality rows."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

import argument_checks as check
from argument_checks import Array
from prioritized._mapping.task import Status, status_of
from prioritized._solver.arrays import read_only
from prioritized._solver.limits import Limits, limits, plain_limits
from prioritized._solver.packed import Equations, Packed, Point, Rows, ends_of, pack, solve, solved
from prioritized._solver.rank import RANK_TOLERANCE, norm

_FLOAT64 = np.dtype(np.float64)
Level = tuple[ArrayLike, ArrayLike] | tuple[ArrayLike, ArrayLike, ArrayLike]
"""Level (A, b), or (A, lower, upper) for an A x that should lie between two vectors."""


@dataclass(frozen=True, eq=False)
class Solution:
    """Solution of :func:`lexicographic_least_squares`.

    Attributes:
        n: Number of unknowns x.
        hard_rows: Number of inequality rows, which precede the levels.
        levels: Number of levels.
        packed: Problem in the form of the solver: unknowns are x, then one slack for each
            inequality row.
        point: Result of the solver, which can warm-start another call.
    """

    n: int
    hard_rows: int
    levels: int
    packed: Packed
    point: Point

    @property
    def x(self) -> Array:
        """Solution, shape (n,), within the bounds exactly for any status."""
        return self.point.x[0, : self.n]

    @property
    def active(self) -> NDArray[np.int8]:
        """Bounds that x is at: -1 the lower, 1 the upper, 0 none, (n,); equal ones are -1."""
        return self._at_bounds[: self.n]

    @property
    def active_rows(self) -> NDArray[np.int8]:
        """Limits that the inequality rows are at: -1 the lower, 1 the upper, 0 none, (r,)."""
        return self._at_bounds[self.n : self.n + self.hard_rows]

    @cached_property
    def _at_bounds(self) -> NDArray[np.int8]:
        return read_only(self.packed.at_bounds(self.point.x))[0]

    @property
    def gap(self) -> float:
        """Factor by which the rank threshold could change before any rank would."""
        return float(self.point.gap[0])

    @property
    def steps(self) -> int:
        """Number of steps of the active set."""
        return int(self.point.steps[0])

    @property
    def residuals(self) -> tuple[Array, ...]:
        """Residual b_k - A_k x of each level; for an interval, the distance of A_k x to it."""
        first = 1 if self.hard_rows else 0
        return self._residuals[first : first + self.levels]

    @cached_property
    def certificate(self) -> Array | None:
        """Vector y (r,) that proves that the inequality rows G are infeasible, otherwise None.

        y . (G x - s) > 0 for all x within the bounds and all s within the limits of the rows.
        """
        if not self.hard_rows:
            return None
        infeasible = self.packed.is_violated(slice(0, 1), self.point.x)[0]
        return read_only(-self._residuals[0]) if infeasible else None

    @property
    def status(self) -> Status:
        """Status OPTIMAL, INFEASIBLE or UNFINISHED; its value is an explanation."""
        conditions = {
            Status.UNFINISHED: lambda: not self.point.ended[0],
            Status.INFEASIBLE: lambda: self.certificate is not None,
        }
        return status_of(conditions, Status.OPTIMAL)

    @cached_property
    def _residuals(self) -> tuple[Array, ...]:
        residual = read_only(self.packed.residual(self.point.x))[0]
        return tuple(np.split(residual, self.packed.ends[:-1]))


def lexicographic_least_squares(
    levels: Sequence[Level],
    lower: ArrayLike | None = None,
    upper: ArrayLike | None = None,
    *,
    rows: ArrayLike | None = None,
    rows_lower: ArrayLike | None = None,
    rows_upper: ArrayLike | None = None,
    tie_metric: ArrayLike | None = None,
    start: Solution | None = None,
    most_steps: int | None = None,
    rank_tolerance: float = RANK_TOLERANCE,
) -> Solution:
    """Minimize |A_k x - b_k| level by level over the x within bounds.

    Each level is solved in the set that bounds, rows and previous levels leave:

    1. lower <= x <= upper, exactly
    2. rows_lower <= rows x <= rows_upper, or the least violation where that is infeasible
    3. |A_1 x - b_1|, then |A_2 x - b_2|, ...   smallest
    4. |T x|, then |x|                         smallest (ties)

    The method is a primal active-set method with one orthogonal decomposition of each level on the
    null space of the previous ones (Escande, Mansard, Wieber, IJRR 33(7), 2014; an inequality row
    is an equation with one more bounded unknown). Apart from the start, no level depends on data of
    later ones. Bland's rule and a bound on the number of steps exclude cycling.

    Args:
        levels: (A_k, b_k), shapes (m_k, n) and (m_k,); or (A_k, lower, upper), whose distance to
            the interval is minimized.
        lower: Shape (n,) or one number; may be infinite; None is no bound.
        upper: Shape (n,) or one number; may be infinite; equal to `lower` it fixes an unknown.
        rows: Inequality rows, shape (r, n).
        rows_lower: Shape (r,) or one number; may be infinite.
        rows_upper: Shape (r,) or one number; may be infinite.
        tie_metric: T, diagonal (n,) or matrix (k, n); None is zero.
        start: Solution of a similar problem of the same shape, whose active set is the initial one.
        most_steps: Bound on the steps of the active set in total; None is 20 (n + 1) for each
            level.
        rank_tolerance: Rows smaller than this fraction of their level are linearly dependent.

    Returns:
        A finite solution within the bounds, for any status.
    """
    tolerance = check.number("rank_tolerance", rank_tolerance, 0.0, 0.5)
    if not (type(levels) is list or isinstance(levels, Sequence)) or not len(levels):
        raise ValueError(f"levels must be a list of (A, b), got {check.short_repr(levels)}")
    if most_steps is not None:
        most_steps = check.integer("most_steps", most_steps, 10**9)
    warm = None if start is None else check.instance("start", start, Solution).point
    if rows is rows_lower is rows_upper is tie_metric is most_steps is None:
        solution = _of_plain_arrays(levels, lower, upper, tolerance, warm)
        if solution is not None:
            return solution
    n = check.array("levels[0][0]", _parts(0, levels[0])[0], None, None).shape[1]
    blocks = [_block(k, level, n) for k, level in enumerate(levels)]
    box = _between("lower and upper", lower, upper, n)
    hard = _hard_rows(rows, rows_lower, rows_upper, n)
    last = []
    if tie_metric is not None:
        T = check.array("tie_metric", check.weight("tie_metric", tie_metric, n), None, n)
        last = [_equations(T, np.zeros(len(T)))]
    packed = pack([*hard, *blocks, *last], box, tolerance)
    hard_rows = sum(len(block.G) for block in hard)
    return Solution(n, hard_rows, len(levels), packed, solved(packed, warm, most_steps))


def _of_plain_arrays(
    levels: Sequence[Any], lower: Any, upper: Any, tolerance: float, start: Point | None
) -> Solution | None:
    """Return the solution within bounds if all levels are pairs of plain arrays, else None."""
    matrices, counts, n = [], [], -1
    # Calls of the argument checks would take as long as the arithmetic.
    for level in levels:
        if type(level) is not tuple or len(level) != 2:
            return None
        A, b = level
        if not (
            type(A) is type(b) is np.ndarray
            and A.dtype is b.dtype is _FLOAT64
            and A.ndim == 2
            and A.shape[:1] == b.shape
        ):
            return None
        rows, columns = A.shape
        n = columns if n < 0 else n
        if columns != n:
            return None
        matrices += A, b
        counts.append(rows)
    low, high = limits("", None, n)
    box = plain_limits((low if lower is None else lower, high if upper is None else upper), n)
    if box is None:
        return None
    A = np.ascontiguousarray(np.concatenate(matrices[::2]))[None]
    b = np.concatenate(matrices[1::2])[None]
    packed = Packed(A, b, ends_of(*counts), None, tolerance, box[None], n)
    point = solve(packed, start)
    return None if point.is_invalid else Solution(n, 0, len(counts), packed, point)


def _hard_rows(
    rows: ArrayLike | None, lower: ArrayLike | None, upper: ArrayLike | None, n: int
) -> list[Rows]:
    """Return the checked inequality rows, if there are any."""
    if rows is None:
        if lower is not None or upper is not None:
            raise ValueError("rows must be given with rows_lower and rows_upper, got None")
        return []
    G = check.array("rows", rows, None, n, copy=True)
    between = _between("rows_lower and rows_upper", lower, upper, len(G))
    return [Rows(G, between)] if len(G) else []


def _between(names: str, lower: ArrayLike | None, upper: ArrayLike | None, n: int) -> Limits:
    """Return limits given as two arguments; None is infinite."""
    both = -np.inf if lower is None else lower, np.inf if upper is None else upper
    return limits(names, both, n)


def _parts(k: int, level: Level) -> Level:
    if not isinstance(level, tuple | list) or len(level) not in (2, 3):
        raise ValueError(
            f"levels[{k}] must be (A, b) or (A, lower, upper), got {check.short_repr(level)}"
        )
    return level


def _block(k: int, level: Level, n: int) -> Equations | Rows:
    A, *target = _parts(k, level)
    A = check.array(f"levels[{k}][0]", A, None, n, copy=True)
    if len(target) == 2:
        return Rows(A, limits(f"levels[{k}][1:]", (target[0], target[1]), len(A)))
    return _equations(A, check.array(f"levels[{k}][1]", target[0], len(A)))


def _equations(A: Array, b: Array) -> Equations:
    return Equations(A, b, np.asarray(norm(A)))
