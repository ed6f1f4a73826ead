"""Tasks of the levels of a hierarchy, and their targets."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

import argument_checks as check
from argument_checks import Array
from prioritized._mapping.task import rows_of
from prioritized._mechanism.measure import metric_of, units_of
from prioritized._solver.arrays import ReadOnly, read_only
from prioritized._solver.limits import limits


@dataclass(frozen=True, eq=False)
class Task(ReadOnly):
    """Task of one level of a hierarchy: minimize |W (S J rates - target)|, J the task Jacobian.

    Attributes:
        rows: Rows of the task, S: numbers, a slice such as `jac.rows["tool"]`, or directions (k,
            m); None is the rates themselves.
        weight: W, diagonal (k,) or matrix (., k); None is the identity. If no task of a level has a
            weight, its angles and lengths are related by the mechanism's own length.
        interval: Whether the target is a pair (lower, upper) of bounds of S J rates.
        damping: Tikhonov damping of this level alone, in units of the singular values of W S J on
            the null space of the previous levels. It keeps the rates that the level adds below |W
            target| / (2 damping) and makes the level inexact; the null space of later levels is
            unchanged. If a level has several tasks, the largest value applies.

    Raises:
        ValueError: An interval has a weight or damping, or the damping is negative.
    """

    rows: Sequence[int] | slice | ArrayLike | None
    weight: ArrayLike | None = None
    interval: bool = False
    damping: float = 0.0

    def __post_init__(self) -> None:
        """Check the fields and copy arrays and lists."""
        check.flag("interval", self.interval)
        if self.interval and self.weight is not None:
            raise ValueError("weight must be None for an interval, whose rows have equal weights")
        object.__setattr__(self, "damping", check.number("damping", self.damping, 0.0))
        if self.interval and self.damping:
            raise ValueError(f"damping must be 0 for an interval, got {self.damping:g}")
        for name in ("rows", "weight"):
            value = getattr(self, name)
            if isinstance(value, np.ndarray) and not check.is_masked(value):
                object.__setattr__(self, name, check.frozen(value))
            elif isinstance(value, list):
                object.__setattr__(self, name, list(value))

    @classmethod
    def joints(cls, weight: ArrayLike | None = None, damping: float = 0.0) -> "Task":
        """Return a task on the rates, |W (rates - target)|, with W of the survivors or of all n."""
        return cls(None, weight, damping=damping)


class Part(NamedTuple):
    """Task of a level: rows S (k, m), None for the n rates; W (., k), None for the identity."""

    S: Array | None
    W: Array | None
    interval: bool
    size: int

    def of(self, J: Array) -> Array:
        """Return the rows of the task on the rates for J (m, n), shape (k, n)."""
        return np.eye(J.shape[1]) if self.S is None else self.S @ J

    @property
    def matrix(self) -> Array:
        """Weight W, shape (., k)."""
        return np.eye(self.size) if self.W is None else self.W

    def weighted(self, m: int, n: int) -> tuple[Array, Array]:
        """Return weighted rows on m task rows, W S (., m), and on n rates, W (., n)."""
        W = self.matrix
        if self.S is None:
            return np.zeros((len(W), m)), W
        return W @ self.S, np.zeros((len(W), n))

    def residual(self, target: Array, J: Array, rates: Array) -> Array:
        """Return target (k,) minus achieved value; for an interval (2, k) the distance to it."""
        achieved = self.of(J) @ rates
        return achieved.clip(*target) - achieved if self.interval else target - achieved


Level = tuple[Part, ...]


def tasks_of(name: str, level: Task | Sequence[Task]) -> tuple[Task, ...]:
    """Check and return the tasks of a level."""
    tasks = [level] if isinstance(level, Task) else level
    if not isinstance(tasks, Sequence) or not tasks:
        raise ValueError(f"{name} must be a Task or a list of tasks, got {check.short_repr(level)}")
    for task in tasks:
        check.instance(name, task, Task)
    if len(tasks) > 1 and any(task.interval for task in tasks):
        raise ValueError(f"{name} must have an interval as its only task, got {len(tasks)}")
    return tuple(tasks)


def level_of(name: str, tasks: tuple[Task, ...], task_units: Array, rate_units: Array) -> Level:
    """Return the parts of a level, with a metric for angles and lengths if it has no weights."""
    parts = tuple(_part(name, task, len(task_units), len(rate_units)) for task in tasks)
    if any(task.weight is not None or task.interval for task in tasks):
        return parts
    units = [rate_units if part.S is None else units_of(part.S, task_units) for part in parts]
    if metric_of(np.concatenate(units)) is None:
        return parts
    pairs = zip(parts, units, strict=True)
    return tuple(part._replace(W=read_only(np.diag(1.0 / unit))) for part, unit in pairs)


def _part(name: str, task: Task, m: int, n: int) -> Part:
    S, label, W = _selected(name, task, m), f"weight of {name}", None
    size = n if S is None else len(S)
    if task.weight is not None:
        W = read_only(check.array(label, check.weight(label, task.weight, size), None, size))
    return Part(S, W, task.interval, size)


def _selected(name: str, task: Task, m: int) -> Array | None:
    """Return the rows S of the task, (k, m); None for rates."""
    rows = task.rows
    if rows is None:
        return None
    if isinstance(rows, slice):
        rows = list(range(m))[rows]
    return read_only(rows_of(f"rows of {name}", rows, m))


def targets_of(name: str, level: Level, target: Any) -> tuple[Array, ...]:
    """Check the target of each task of a level: (k,), or (2, k) for an interval."""
    if len(level) == 1:
        return (_target(name, level[0], target),)
    targets = [None] * len(level) if target is None else target
    if not isinstance(targets, Sequence) or len(targets) != len(level):
        raise ValueError(
            f"{name} must be a target for each of {len(level)} tasks, got "
            f"{check.short_repr(target)}"
        )
    return tuple(_target(name, part, value) for part, value in zip(level, targets, strict=True))


def _target(name: str, part: Part, target: Any) -> Array:
    if target is None:
        return read_only(np.zeros((2, part.size) if part.interval else part.size))
    if part.interval:
        return read_only(np.array(limits(name, target, part.size)))
    return read_only(check.array(name, target, part.size).copy())
