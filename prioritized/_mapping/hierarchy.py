"""Tasks of any number of levels, under limits."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

import argument_checks as check
from argument_checks import Array
from prioritized._mapping.limited import Limiting, checked_rows
from prioritized._mapping.task import Status, rows_of
from prioritized._mechanism.measure import metric_of, units_of
from prioritized._solver.arrays import ReadOnly, none, read_only
from prioritized._solver.limits import limits
from prioritized._solver.packed import Equations, Packed, Point, Rows, Unknowns, pack, solve
from prioritized._solver.rank import RANK_TOLERANCE, norm


class Mechanism(Protocol):
    """What a hierarchy takes from :class:`prioritized.Kinematics`, which imports this module."""

    @property
    def J(self) -> Array: ...
    @property
    def rate_units(self) -> Array: ...
    @property
    def task_units(self) -> Array: ...
    def in_order(
        self, levels: list[tuple[Array, Array]]
    ) -> tuple[list[tuple[Array, float]], bool]: ...


@dataclass(frozen=True, eq=False)
class Task(ReadOnly):
    """What one level of a hierarchy asks for, |W (S J rates - target)|.

    Attributes:
        rows: Task rows S: numbers, a slice such as `jac.rows["tool"]`, or directions (k, m); None
            are the rates themselves.
        weight: W, diagonal (k,) or matrix (., k); None is the identity. Where no task of a level
            has one, its angles and lengths are measured with the mechanism's own length.
        interval: Whether the target is a pair (lower, upper) for S J rates to lie between.

    Raises:
        ValueError: A weight for an interval.
    """

    rows: Sequence[int] | slice | ArrayLike | None
    weight: ArrayLike | None = None
    interval: bool = False

    def __post_init__(self) -> None:
        """Refuse what has no meaning; keep copies of arrays."""
        check.flag("interval", self.interval)
        if self.interval and self.weight is not None:
            raise ValueError("weight must be None for an interval, whose rows count alike")
        for name in ("rows", "weight"):
            value = getattr(self, name)
            if isinstance(value, np.ndarray) and not check.is_masked(value):
                object.__setattr__(self, name, check.frozen(value))

    @classmethod
    def joints(cls, weight: ArrayLike | None = None) -> "Task":
        """The rates of all actuators, |W (rates - target)|: W of the survivors, or of all n."""
        return cls(None, weight)


class _Part(NamedTuple):
    """A task of a mechanism: rows S (k, m), None for rates, A = S J, (k, n), and W (., k)."""

    S: Array | None
    A: Array
    W: Array
    interval: bool


@dataclass(frozen=True, eq=False)
class Hierarchy:
    """Levels of tasks of one mechanism at one pose; made by :meth:`Kinematics.hierarchy`.

    Attributes:
        levels: The tasks of each level.
        decided: Their weighted rows (k, n) without what counts as lost, and the size of these.
        constraint: C, orthonormal rows, shape (r, n).
        limiting: Limits of the rates.
        tie_metric: T, (k, n).
        is_held: Whether the first level's tasks stand still with every actuator locked.
    """

    levels: tuple[tuple[_Part, ...], ...]
    decided: tuple[tuple[Array, float], ...]
    constraint: Array
    limiting: Limiting
    tie_metric: Array
    is_held: bool

    def __call__(self, targets: Sequence[ArrayLike | Sequence[ArrayLike] | None]) -> Array:
        """Optimal rates, shape (n,)."""
        return self.solve(targets).rates

    def solve(
        self,
        targets: Sequence[ArrayLike | Sequence[ArrayLike] | None],
        *,
        start: "HierarchySolution | None" = None,
    ) -> "HierarchySolution":
        """The rates that meet each level as well as limits, constraints and levels before it let.

        Args:
            targets: Of each level, in the order of the levels: shape (k,), a pair for an interval,
                or a list with one for each task where a level has several. None is zero.
            start: Solution of a similar problem, such as that of the tick before.

        Raises:
            ValueError: Another number of targets, or one of the wrong shape or not finite.
        """
        count = len(self.levels)
        if not isinstance(targets, Sequence | np.ndarray) or len(targets) != count:
            raise ValueError(f"targets must be {count}, one a level, got {check.shown(targets)}")
        asked = [
            _level_targets(f"targets[{k}]", parts, target)
            for k, (parts, target) in enumerate(zip(self.levels, targets, strict=True))
        ]
        blocks = list(map(_block, self.levels, self.decided, asked))
        n = self.constraint.shape[1]
        hard = [*self.limiting.rows, _equations(self.constraint)]
        ties = [_equations(self.tie_metric), _equations(np.eye(n))]
        packed, _ = pack([*hard, *blocks, *ties], Unknowns(self.limiting.box), RANK_TOLERANCE)
        begun = None
        if start is not None:
            begun = check.instance("start", start, HierarchySolution).point
        return HierarchySolution(self, tuple(asked), packed, solve(packed, None, begun))


@dataclass(frozen=True, eq=False)
class HierarchySolution:
    """The optimal rates of a hierarchy.

    Attributes:
        hierarchy: That gave it.
        targets: Of each task of each level.
        packed: The problem as it was solved.
        point: Where the solver ended, from which it can start again.
    """

    hierarchy: Hierarchy
    targets: tuple[tuple[Array, ...], ...]
    packed: Packed
    point: Point

    @property
    def rates(self) -> Array:
        """Of the surviving actuators, within the limits exactly, shape (n,)."""
        return self.point.x[0, : self._n]

    @property
    def active_limits(self) -> NDArray[np.int8]:
        """Limits that the rates are at: -1 the lower, 1 the upper, 0 none, shape (n,)."""
        return self._at_bounds[: self._n]

    @property
    def active_rows(self) -> NDArray[np.int8]:
        """The same for the inequality rows, (r,)."""
        count = sum(len(each.G) for each in self.hierarchy.limiting.rows)
        return self._at_bounds[self._n : self._n + count]

    @cached_property
    def _at_bounds(self) -> NDArray[np.int8]:
        return read_only(self.packed.at_bounds(self.point.x))[0]

    @property
    def gap(self) -> float:
        """Factor by which the rank threshold could change before any rank would."""
        return float(self.point.gap[0])

    @cached_property
    def residuals(self) -> tuple[Array, ...]:
        """Target less what is achieved, of each level; its tasks one after the other.

        For an interval, what is lacking to lie in it.
        """
        rates = self.rates
        return tuple(
            read_only(
                np.concatenate(
                    [_lacking(part, target, rates) for part, target in zip(*each, strict=True)]
                )
            )
            for each in zip(self.hierarchy.levels, self.targets, strict=True)
        )

    @cached_property
    def status(self) -> Status:
        """How the first level is met, and whether limits and constraints are."""
        hard = len(self.hierarchy.limiting.rows) + 1
        if self.packed.unmet(slice(0, hard), self.point.x)[0]:
            return Status.INFEASIBLE
        if not self.point.ended[0]:
            return Status.UNFINISHED
        if not self.hierarchy.is_held:
            return Status.SELF_MOTION
        if not self.packed.unmet(slice(hard, hard + 1), self.point.x)[0]:
            return Status.EXACT
        lower, upper = self.packed.lower.copy(), self.packed.upper.copy()
        count = self._n + len(self.active_rows)
        lower[:, :count], upper[:, :count] = -np.inf, np.inf
        unlimited = self.packed._replace(lower=lower, upper=upper)
        x = solve(unlimited).x
        now, before = (norm(self.packed.level(hard, each)) for each in (self.point.x, x))
        return Status.LIMITED if now > (1 + 1e-9) * before else Status.LEAST_SQUARES

    @property
    def _n(self) -> int:
        return self.hierarchy.constraint.shape[1]


def hierarchy(
    mechanism: Mechanism,
    levels: Sequence[Task | Sequence[Task]],
    constraint: Array,
    rate_limits: tuple[ArrayLike, ArrayLike] | None,
    rate_rows: tuple[ArrayLike, ArrayLike, ArrayLike] | None,
    tie_metric: ArrayLike | None,
) -> Hierarchy:
    """The hierarchy of a mechanism; see :meth:`Kinematics.hierarchy`."""
    J = mechanism.J
    m, n = J.shape
    if not isinstance(levels, Sequence) or not len(levels):
        raise ValueError(f"levels must be a list of tasks, got {check.shown(levels)}")
    parts = tuple(
        _measured(tuple(_part(f"levels[{k}]", task, J) for task in tasks), tasks, mechanism)
        for k, tasks in enumerate(_tasks(f"levels[{k}]", each) for k, each in enumerate(levels))
    )
    decided, is_held = mechanism.in_order([_rows(each, m, n) for each in parts])
    rows = () if rate_rows is None else (checked_rows("rate_rows", rate_rows, n),)
    limiting = Limiting(limits("rate_limits", rate_limits, n), rows)
    if tie_metric is None:
        tie_metric = metric_of(mechanism.rate_units)
    T = none((0, n))
    if tie_metric is not None:
        T = check.sized("tie_metric", check.weight("tie_metric", tie_metric, n))
    decided = tuple((read_only(A), size) for A, size in decided)
    return Hierarchy(parts, decided, constraint, limiting, T, is_held)


def _tasks(name: str, level: Task | Sequence[Task]) -> Sequence[Task]:
    """The tasks of a level."""
    tasks = [level] if isinstance(level, Task) else level
    if not isinstance(tasks, Sequence) or not tasks:
        raise ValueError(f"{name} must be a Task or a list of tasks, got {check.shown(level)}")
    for task in tasks:
        check.instance(name, task, Task)
    if len(tasks) > 1 and any(task.interval for task in tasks):
        raise ValueError(f"{name} must have an interval as its only task, got {len(tasks)}")
    return tasks


def _rows(parts: tuple[_Part, ...], m: int, n: int) -> tuple[Array, Array]:
    """The weighted rows of a level, on the task (k, m) and on the rates (k, n): their sum."""
    on_task = [part.W @ (np.zeros((n, m)) if part.S is None else part.S) for part in parts]
    on_rates = [
        part.W @ (np.eye(n) if part.S is None else np.zeros((len(part.S), n))) for part in parts
    ]
    return np.concatenate(on_task), np.concatenate(on_rates)


def _selected(name: str, task: Task, m: int) -> Array | None:
    """Rows S of the task, (k, m); None for rates."""
    rows = task.rows
    if rows is None:
        return None
    if isinstance(rows, slice):
        rows = list(range(m))[rows]
    return rows_of(f"rows of {name}", rows, m)


def _part(name: str, task: Task, J: Array) -> _Part:
    S, label = _selected(name, task, len(J)), f"weight of {name}"
    A = np.eye(J.shape[1]) if S is None else S @ J
    W = (
        np.eye(len(A))
        if task.weight is None
        else check.sized(label, check.weight(label, task.weight, len(A)))
    )
    return _Part(S, A, W, task.interval)


def _measured(
    parts: tuple[_Part, ...], tasks: Sequence[Task], mechanism: Mechanism
) -> tuple[_Part, ...]:
    """A level's parts, its angles and lengths in one norm where no weight of it is stated."""
    if any(task.weight is not None or task.interval for task in tasks):
        return parts
    on_task, on_rates = mechanism.task_units, mechanism.rate_units
    units = [on_rates if part.S is None else units_of(part.S, on_task) for part in parts]
    if metric_of(np.concatenate(units)) is None:
        return parts
    return tuple(
        part._replace(W=np.diag(1.0 / unit)) for part, unit in zip(parts, units, strict=True)
    )


def _level_targets(name: str, parts: tuple[_Part, ...], target: Any) -> tuple[Array, ...]:
    """Target of each task: (k,), or (2, k) for an interval."""
    if target is None:
        target = [None] * len(parts) if len(parts) > 1 else None
    each = [target] if len(parts) == 1 else target
    if not isinstance(each, Sequence) or len(each) != len(parts):
        raise ValueError(
            f"{name} must be {len(parts)} targets, one a task, got {check.shown(target)}"
        )
    pairs = zip(parts, each, strict=True)
    return tuple(read_only(_target(name, part, one)) for part, one in pairs)


def _target(name: str, part: _Part, target: Any) -> Array:
    if target is None:
        return np.zeros((2, len(part.A)) if part.interval else len(part.A))
    if part.interval:
        return np.array(limits(name, target, len(part.A)))
    return check.exactly(name, target, len(part.A)).copy()


def _block(
    parts: tuple[_Part, ...], decided: tuple[Array, float], targets: tuple[Array, ...]
) -> Equations | Rows:
    A, size = decided
    if parts[0].interval:
        lower, upper = targets[0]
        return Rows(A, (lower, upper))
    target = [part.W @ one for part, one in zip(parts, targets, strict=True)]
    return Equations(A, np.concatenate(target), np.asarray(size))


def _equations(A: Array) -> Equations:
    """A x = 0."""
    return Equations(A, np.zeros(len(A)), np.asarray(norm(A)))


def _lacking(part: _Part, target: Array, rates: Array) -> Array:
    achieved = part.A @ rates
    if part.interval:
        return achieved.clip(*target) - achieved
    return target - achieved
