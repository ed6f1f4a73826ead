"""Lexicographic least squares under bounds and inequality rows."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

import argument_checks as check
from argument_checks import Array
from kernels import lib, pointer
from prioritized._mapping.solving import thresholds
from prioritized._mapping.task import Status
from prioritized._solver.arrays import read_only, workspace
from prioritized._solver.limits import Limits, limits
from prioritized._solver.packed import (
    Equations,
    Packed,
    Point,
    Rows,
    Unknowns,
    active_of,
    ends_of,
    pack,
    point_of,
    solve,
    unpacked,
)
from prioritized._solver.rank import RANK_TOLERANCE, norm

_MOST = 10**8
"""Numbers up to which places in C's room for work are integers of 32 bits."""
_FLOAT64, _INT8 = np.dtype(np.float64), np.dtype(np.int8)
_Solved = tuple[Array, NDArray[np.int64], float, Array, NDArray[np.int8], int] | None
"""What the compiled solver took and found: levels, their ends, and tolerance; x with limits and
norms of levels, active bounds, and steps. None where the other was needed."""
Level = tuple[ArrayLike, ArrayLike] | tuple[ArrayLike, ArrayLike, ArrayLike]
"""(A, b), or (A, lower, upper) for an A x that is to lie between two vectors."""


@dataclass(frozen=True, eq=False)
class Solution:
    """What :func:`lexicographic_least_squares` found.

    Attributes:
        n: Number of unknowns x.
        hard_rows: Number of inequality rows that hold first.
        levels: Number of levels.
    """

    n: int
    hard_rows: int
    levels: int
    _solved: _Solved

    @cached_property
    def packed(self) -> Packed:
        """The problem as it was solved: unknowns are x, then one for each inequality row."""
        assert self._solved is not None
        given, ends, tolerance, found, _, _ = self._solved
        limits, scales = found[self.n : 3 * self.n].reshape(2, self.n), found[3 * self.n :]
        return unpacked(given, ends, tolerance, limits, scales)

    @cached_property
    def point(self) -> Point:
        """Its solution, from which another call can start."""
        assert self._solved is not None
        *_, found, active, steps = self._solved
        return point_of(found[None, : self.n], active[None], steps)

    @property
    def x(self) -> Array:
        """The solution, shape (n,); within the bounds exactly, whatever the status."""
        return self.point.x[0, : self.n]

    @property
    def active(self) -> NDArray[np.int8]:
        """Which bounds x is at: -1 the lower, 1 the upper, 0 none, (n,); equal ones are -1."""
        return self._at_bounds[: self.n]

    @property
    def active_rows(self) -> NDArray[np.int8]:
        """The same for the inequality rows, shape (r,)."""
        return self._at_bounds[self.n : self.n + self.hard_rows]

    @cached_property
    def _at_bounds(self) -> NDArray[np.int8]:
        return read_only(self.packed.at_bounds(self.point.x))[0]

    @cached_property
    def gap(self) -> float:
        """Factor by which the rank threshold could change before any rank would."""
        decided = self.point.gap
        if decided is None:
            decided = solve(self.packed).gap
        assert decided is not None
        return float(decided[0])

    @property
    def steps(self) -> int:
        """Steps of the active set that were taken."""
        return int(self.point.steps[0])

    @property
    def residuals(self) -> tuple[Array, ...]:
        """b_k - A_k x of each level; for an interval, what A_k x lacks to lie in it."""
        first = 1 if self.hard_rows else 0
        return self._rests[first : first + self.levels]

    @cached_property
    def certificate(self) -> Array | None:
        """The y (r,) that proves that the inequality rows G are infeasible; None if they are not.

        y . (G x - s) > 0 for all x within the bounds and all s within the limits of the rows.
        """
        if not self.hard_rows:
            return None
        infeasible = self.packed.unmet(slice(0, 1), self.point.x)[0]
        return read_only(-self._rests[0]) if infeasible else None

    @property
    def status(self) -> Status:
        """OPTIMAL, INFEASIBLE or UNFINISHED; the value says what it means."""
        if not self.point.ended[0]:
            return Status.UNFINISHED
        return Status.OPTIMAL if self.certificate is None else Status.INFEASIBLE

    @cached_property
    def _rests(self) -> tuple[Array, ...]:
        return tuple(np.split(read_only(self.packed.rest(self.point.x))[0], self.packed.ends[:-1]))


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
    """The x within its bounds that makes |A_k x - b_k| least, level by level.

    Each level is solved without changing what bounds, rows and the levels before it leave:

    1. lower <= x <= upper, always and exactly
    2. rows_lower <= rows x <= rows_upper, or the least violation where that is infeasible
    3. |A_1 x - b_1|, then |A_2 x - b_2|, ...   smallest
    4. |T x|, then |x|                         smallest (ties)

    Where all ranks are clearly full and all levels before the one that determines x can be met, a
    dual active-set method (Goldfarb, Idnani, Math. Programming 27, 1983). Elsewhere a primal one
    with one orthogonal decomposition of each level on the unknowns that are free (Escande, Mansard,
    Wieber, IJRR 33(7), 2014, with bounds alone: an inequality row is an equation with one more
    bounded unknown), whose levels never see the data of those after them, except for the start.
    Cycling is excluded by Bland's rule and a bound on the number of steps.

    Args:
        levels: (A_k, b_k), shapes (m_k, n) and (m_k,); or (A_k, lower, upper), whose distance to
            the interval is made least.
        lower: Shape (n,) or one number; may be infinite; None is no bound.
        upper: Likewise; equal to `lower` it fixes an unknown.
        rows: Inequality rows, shape (r, n).
        rows_lower: Shape (r,) or one number, as above.
        rows_upper: Likewise.
        tie_metric: T, diagonal (n,) or matrix (k, n); None is zero.
        start: Solution of a similar problem of the same shape, from which to start.
        most_steps: Of the active set in all; None is 20 (n + 1) for each level.
        rank_tolerance: Rows smaller than this fraction of their level are dependent on others.

    Returns:
        A solution that obeys the bounds, finite, whatever its status.

    Raises:
        ValueError: No level, or an argument of the wrong shape, with NaN, or a lower bound above
            the upper one; it is named.
    """
    tolerance = check.fraction("rank_tolerance", rank_tolerance)
    if not (type(levels) is list or isinstance(levels, Sequence)) or not len(levels):
        raise ValueError(f"levels must be a list of (A, b), got {check.shown(levels)}")
    if most_steps is not None:
        most_steps = check.index("most_steps", most_steps, 10**9)
    begun = None if start is None else check.instance("start", start, Solution).point
    if rows is rows_lower is rows_upper is tie_metric is most_steps is None:
        quick = _of_plain_arrays(levels, lower, upper, tolerance, begun)
        if quick is not None:
            return quick
    n = check.matrix("levels[0][0]", _parts(0, levels[0])[0]).shape[1]
    blocks = [_block(k, level, n) for k, level in enumerate(levels)]
    box = _between("lower and upper", lower, upper, n)
    hard = _hard_rows(rows, rows_lower, rows_upper, n)
    ties = (
        []
        if tie_metric is None
        else [check.sized("tie_metric", check.weight("tie_metric", tie_metric, n))]
    )
    last = [_equations(T, np.zeros(len(T))) for T in (*ties, np.eye(n))]
    packed, _ = pack([*hard, *blocks, *last], Unknowns(box), tolerance)
    hard_rows = sum(len(each.G) for each in hard)
    solution = Solution(n, hard_rows, len(levels), None)
    vars(solution).update(packed=packed, point=solve(packed, None, begun, most_steps))
    return solution


def _of_plain_arrays(
    levels: Sequence[Any], lower: Any, upper: Any, tolerance: float, start: Point | None
) -> Solution | None:
    """The solution within bounds, where all levels are (A, b) as they should be.

    None elsewhere: the checks then say what is wrong, or take what is right in another form.
    """
    given, counts, n = [], [], -1
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
        given += A.ravel(), b
        counts.append(rows)
    low = limits("", None, n)[0] if lower is None else lower
    high = limits("", None, n)[1] if upper is None else upper
    if not (check.is_plain(low) and check.is_plain(high) and low.shape == high.shape == (n,)):
        return None
    low, high = np.ascontiguousarray(low), np.ascontiguousarray(high)
    clear, ends = thresholds(tolerance)[0], ends_of(*counts, n)
    numbers, found = np.concatenate(given), np.empty(3 * n + len(ends))
    if numbers.size > _MOST:
        return None
    active = np.zeros(n, _INT8) if start is None else active_of(start, (1, n))[0]
    rows, count, work = _levels(*counts, n)
    packed = n, count, rows, pointer(numbers), clear, check.LARGEST
    last = workspace(work), pointer(found), pointer(active)
    steps = lib.single_levels_within(*packed, pointer(low), pointer(high), *last)
    if steps < -1:
        return None
    solution = Solution(n, 0, len(counts), (numbers, ends, tolerance, found, active, steps))
    if steps < 0:
        vars(solution)["point"] = solve(solution.packed, None, start)
    return solution


@lru_cache
def _levels(*rows: int) -> tuple[Any, int, int]:
    """Where levels of so many rows each end, as C takes it, their number, and the room for work."""
    return pointer(ends_of(*rows)), len(rows), lib.single_levels_work(rows[-1], sum(rows))


def _hard_rows(
    rows: ArrayLike | None, lower: ArrayLike | None, upper: ArrayLike | None, n: int
) -> list[Rows]:
    """The inequality rows, if there are any."""
    if rows is None:
        if lower is not None or upper is not None:
            raise ValueError("rows must be given with rows_lower and rows_upper, got None")
        return []
    G = check.matrix("rows", rows, columns=n)
    between = _between("rows_lower and rows_upper", lower, upper, len(G))
    return [Rows(G, between)] if len(G) else []


def _between(names: str, lower: ArrayLike | None, upper: ArrayLike | None, n: int) -> Limits:
    """Limits that are two arguments; None is infinite."""
    return limits(
        names, (-np.inf if lower is None else lower, np.inf if upper is None else upper), n
    )


def _parts(k: int, level: Level) -> Level:
    if not isinstance(level, tuple | list) or len(level) not in (2, 3):
        raise ValueError(
            f"levels[{k}] must be (A, b) or (A, lower, upper), got {check.shown(level)}"
        )
    return level


def _block(k: int, level: Level, n: int) -> Equations | Rows:
    A, *target = _parts(k, level)
    A = check.matrix(f"levels[{k}][0]", A, columns=n)
    if len(target) == 2:
        return Rows(A, limits(f"levels[{k}][1:]", (target[0], target[1]), len(A)))
    return _equations(A, check.exactly(f"levels[{k}][1]", target[0], len(A)))


def _equations(A: Array, b: Array) -> Equations:
    return Equations(A, b, np.asarray(norm(A)))
