"""Pose-independent specification of the levels of a hierarchy."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

import argument_checks as check
from argument_checks import Array, Indices
from prioritized._mapping.limited import Limiting, checked_rows
from prioritized._mapping.tasks import Level, Task, level_of, tasks_of
from prioritized._mechanism.elimination import Joints
from prioritized._mechanism.ordered import LevelRows
from prioritized._solver.arrays import none, read_only
from prioritized._solver.limits import limits
from prioritized._solver.packed import Equations, equations

if TYPE_CHECKING:
    from prioritized._kinematics import Kinematics


class Survivors(NamedTuple):
    """Restriction of arguments for all n actuators to the survivors; others stay unchanged."""

    actuators: Indices
    n: int

    @classmethod
    def of(cls, joints: Joints) -> "Survivors":
        """Return the restriction to the surviving actuators of a mechanism."""
        return cls(joints.actuators, len(joints.actuated))

    def matrix(self, name: str, value: ArrayLike | None) -> Array | None:
        """Restrict a weight, or rows, with a column for each actuator."""
        if value is None:
            return None
        W = check.array(name, value)
        if W.ndim and W.shape[-1] == self.n > len(self.actuators):
            return W[..., self.actuators]
        return W

    def pair(self, value: Any) -> Any:
        """Restrict limits (lower, upper)."""
        all_survive = len(self.actuators) == self.n
        if value is None or all_survive or not _is_of(value, 2) or check.is_masked(value):
            return value
        return tuple(
            np.asarray(side)[self.actuators] if self._is_wide(side) else side for side in value
        )

    def _is_wide(self, side: Any) -> bool:
        return not check.is_masked(side) and np.shape(side) == (self.n,)

    def rows(self, name: str, value: Any) -> Any:
        """Restrict inequality rows (R, lower, upper)."""
        if value is None or not _is_of(value, 3):
            return value
        R, lower, upper = value
        return self.matrix(name, R), lower, upper

    def task(self, task: Task) -> Task:
        """Return a task on rates with the weights of the survivors; other tasks stay unchanged."""
        if task.rows is not None or task.weight is None:
            return task
        return dataclasses.replace(task, weight=self.matrix("weight", task.weight))


def _is_of(value: Any, size: int) -> bool:
    return isinstance(value, Sequence | np.ndarray) and len(value) == size


@dataclass(frozen=True, eq=False)
class LevelSpecs:
    """Pose-independent levels of tasks for the surviving actuators of a mechanism.

    Attributes:
        tasks: Tasks of each level, with weights of rates for all actuators or the survivors.
        tie_metric: T for all actuators or the survivors, or None.
        survivors: Surviving actuators.
        units: Natural units of the task rows (m,) and of the rates (n,).
        levels: Tasks with the weights of the survivors.
        damping: Damping of each level.
        level_rows: Weighted rows of all levels, on task and rates in natural units.
        ties: Level |T rates| that breaks ties before |rates|, in natural units.
    """

    tasks: tuple[tuple[Task, ...], ...]
    tie_metric: Array | None
    survivors: Survivors
    units: tuple[Array, Array]
    levels: tuple[Level, ...]
    damping: tuple[float, ...]
    level_rows: LevelRows
    ties: Equations

    @classmethod
    def of(
        cls,
        mechanism: "Kinematics",
        tasks: tuple[tuple[Task, ...], ...],
        tie_metric: ArrayLike | None,
    ) -> "LevelSpecs":
        """Return the levels of tasks of a mechanism; see :meth:`Kinematics.hierarchy`."""
        survivors, reduced = mechanism._survivors, mechanism._reduced
        units = reduced.task_units, reduced.rate_units
        levels = tuple(
            level_of(f"levels[{k}]", tuple(map(survivors.task, level)), *units)
            for k, level in enumerate(tasks)
        )
        metric = None if tie_metric is None else check.array("tie_metric", tie_metric, copy=True)
        T, n = survivors.matrix("tie_metric", metric), len(survivors.actuators)
        if T is not None:
            T = check.array("tie_metric", check.weight("tie_metric", T, n), None, n) * units[1]
        return cls(
            tasks,
            metric,
            survivors,
            units,
            levels,
            tuple(max(task.damping for task in level) for level in tasks),
            LevelRows.of([_weighted(level, *units) for level in levels]),
            equations(none((0, n)) if T is None else read_only(T)),
        )

    def at(self, mechanism: "Kinematics") -> "LevelSpecs":
        """Return these levels for the mechanism at another pose, or after other failures."""
        survivors, reduced = mechanism._survivors, mechanism._reduced
        units = reduced.task_units, reduced.rate_units
        if all(map(_equal, (survivors.actuators, *units), (self.survivors.actuators, *self.units))):
            return self
        return LevelSpecs.of(mechanism, self.tasks, self.tie_metric)


def checked_specs(mechanism: "Kinematics", levels: Any, tie_metric: ArrayLike | None) -> LevelSpecs:
    """Check levels and tie metric."""
    if not isinstance(levels, Sequence) or not len(levels):
        raise ValueError(f"levels must be a list of tasks, got {check.short_repr(levels)}")
    tasks = tuple(tasks_of(f"levels[{k}]", level) for k, level in enumerate(levels))
    return LevelSpecs.of(mechanism, tasks, tie_metric)


def _equal(a: Array | Indices, b: Array | Indices) -> bool:
    return a is b or (a.shape == b.shape and bool((a == b).all()))


def _weighted(level: Level, task_units: Array, rate_units: Array) -> tuple[Array, Array]:
    """Return weighted rows of a level on the task (k, m) and on the rates (k, n), to be added."""
    sizes = len(task_units), len(rate_units)
    on_task, on_rates = zip(*(part.weighted(*sizes) for part in level), strict=True)
    return np.concatenate(on_task) * task_units, np.concatenate(on_rates) * rate_units


class Bounds(NamedTuple):
    """Limits of the rates, and inequality rows of them, for all actuators or the survivors."""

    limits: Any
    rows: Any

    def of(self, survivors: Survivors) -> Limiting:
        """Check the limits and restrict them to the survivors."""
        n = len(survivors.actuators)
        box = limits("rate_limits", survivors.pair(self.limits), n)
        if self.rows is None:
            return Limiting(box)
        rows = checked_rows("rate_rows", survivors.rows("rate_rows", self.rows), n)
        return Limiting(box, (rows,) if len(rows.G) else ())

    def copied(self) -> "Bounds":
        """Return a copy of checked limits."""
        copies = (None if value is None else tuple(map(check.frozen, value)) for value in self)
        return Bounds(*copies)
