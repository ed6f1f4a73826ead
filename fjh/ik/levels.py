"""Conversion of task functions in levels to the tasks and targets of a `Hierarchy`."""

from collections.abc import Sequence
from typing import NamedTuple

import mujoco
import numpy as np

import argument_checks as check
from argument_checks import Indices
from prioritized import ConstrainedSystem, Kinematics, Task
from sim import Array, TaskFunction
from sim.tasks import LocatedFunction, LocatedRates


class Levels(NamedTuple):
    """Tasks of each priority level, with their names resolved in a model.

    Attributes:
        model: The model.
        tasks: Tasks of each level.
        located: Tasks of each level with names resolved.
        read: Tasks, at least one, that have rows in the task Jacobian.
    """

    model: mujoco.MjModel
    tasks: tuple[tuple[TaskFunction, ...], ...]
    located: tuple[tuple[LocatedFunction, ...], ...]
    read: list[TaskFunction]

    @classmethod
    def of(
        cls, model: mujoco.MjModel, levels: Sequence[TaskFunction | Sequence[TaskFunction]]
    ) -> "Levels":
        """Return the levels located in a model.

        Raises:
            ModelError: A name does not exist.
            ValueError: No level, an empty level, or a task twice.
        """
        if not isinstance(levels, Sequence) or isinstance(levels, str) or not len(levels):
            raise ValueError(f"tasks must be a list of tasks, got {check.short_repr(levels)}")
        tasks = tuple(
            (level,)
            if isinstance(level, TaskFunction)
            else check.members(f"tasks[{k}]", level, TaskFunction)
            for k, level in enumerate(levels)
        )
        all_tasks = [task for level in tasks for task in level]
        if not all(tasks) or len(set(all_tasks)) < len(all_tasks):
            raise ValueError("tasks must have at least one task in each level, and no task twice")
        located = tuple(tuple(task.on(model) for task in level) for level in tasks)
        for task in all_tasks:
            task.fix()
        rows = [
            task
            for level, places in zip(tasks, located, strict=True)
            for task, place in zip(level, places, strict=True)
            if not isinstance(place, LocatedRates)
        ]
        return cls(model, tasks, located, rows or all_tasks[:1])

    def levels(self, system: ConstrainedSystem) -> list[list[Task]]:
        """Return the tasks of each level for the :class:`Hierarchy` of a mechanism."""
        first, levels = 0, []
        of_rows, of_rates = system.geometry.task_units, system.geometry.velocity_units
        for tasks, places in zip(self.tasks, self.located, strict=True):
            level, is_natural = [], all(task.weight is None for task in tasks)
            for task, place in zip(tasks, places, strict=True):
                if isinstance(place, LocatedRates):
                    rates, units = np.zeros(len(of_rates)), of_rates[place.velocities]
                    rates[place.velocities] = 1.0 / units if is_natural else _weight(task, units)
                    W = np.diag(rates[system.active])
                    level.append(Task(None, W[W.any(axis=1)], damping=task.damping or 0.0))
                    continue
                rows = slice(first, first + len(place.angular))
                W = 1.0 / of_rows[rows] if is_natural else _weight(task, of_rows[rows])
                level.append(Task(rows, W, damping=task.damping or 0.0))
                first = rows.stop
            levels.append(level)
        return levels

    def targets(self, kinematics: Kinematics) -> "Targets":
        """Return the targets of all tasks; joint tasks have targets for the remaining actuators."""
        parts, start = list[list[Part]](), 0
        for tasks, places in zip(self.tasks, self.located, strict=True):
            level = []
            for task, place in zip(tasks, places, strict=True):
                size = numbers = len(place.angular)
                rows, among = slice(start, start + size), None
                if isinstance(place, LocatedRates):
                    own = place.velocities == kinematics.active[:, None]
                    rates, among = np.nonzero(own)
                    rows, size = start + rates, len(own)
                own = slice(start, start := start + size)
                level.append(Part(task, place, numbers, rows, among, own))
            parts.append(level)
        return Targets(self.model, tuple(map(tuple, parts)), start)


class Part(NamedTuple):
    """Velocity target of one task.

    Attributes:
        task: The task, with its gain.
        located: The task located in the model.
        size: Number of components of its error.
        rows: Positions of these components among those of all tasks.
        among: Components of its error with a target; None: all.
        slot: Positions of the target's components, zeros for other rates included.
    """

    task: TaskFunction
    located: LocatedFunction
    size: int
    rows: slice | Indices
    among: Indices | None
    slot: slice


class Targets(NamedTuple):
    """Velocity targets of all tasks.

    Attributes:
        model: The model.
        levels: Targets of each level.
        size: Number of components.
    """

    model: mujoco.MjModel
    levels: tuple[tuple[Part, ...], ...]
    size: int

    def at(self, data: mujoco.MjData, period_s: float) -> Array:
        """Return the velocity targets at a state, one task after the other, shape (t,)."""
        requested = np.zeros(self.size)
        for level in self.levels:
            for task, located, size, rows, among, _ in level:
                error = located.error(self.model, data)
                is_plain = check.is_plain(error) and error.shape == (size,)
                if not (is_plain and check.is_moderate(error)):  # of a user-defined task
                    error = check.array(f"the error of {check.short_repr(task)}", error, size)
                velocity = task.gain / period_s * error
                requested[rows] = velocity if among is None else velocity[among]
        return check.array("velocity targets from the errors of the tasks in dt", requested)

    def of_rows(self) -> Indices:
        """Return the position among the targets of each row of J_T, shape (m,)."""
        parts = [part for level in self.levels for part in level if part.among is None]
        return np.concatenate([*(np.arange(self.size)[part.slot] for part in parts), _NO_ROWS])

    def of_levels(self, requested: Array) -> list[Array | list[Array]]:
        """Return targets by level: an array, or for a level of several tasks a list of arrays."""
        by_level = [[requested[part.slot] for part in level] for level in self.levels]
        return [level if len(level) > 1 else level[0] for level in by_level]


_NO_ROWS = np.zeros(0, dtype=np.intp)


def _weight(task: TaskFunction, units: Array) -> Array:
    size = len(units)
    weight = np.asarray(1.0 if task.weight is None else task.weight)
    if weight.ndim and len(weight) != size:
        label = check.short_repr(task)
        raise ValueError(
            f"weight of {label} must be one number or {size} numbers, got {len(weight)}"
        )
    return np.broadcast_to(weight, (size,))
