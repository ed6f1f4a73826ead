"""Levels of task functions as the hierarchy of a mechanism takes them."""

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
    """Tasks of each level, with their names looked up.

    Attributes:
        model: Where.
        tasks: Of each level.
        located: The same in the model.
        read: Those whose rows are to be read from it, one at least.
    """

    model: mujoco.MjModel
    tasks: tuple[tuple[TaskFunction, ...], ...]
    located: tuple[tuple[LocatedFunction, ...], ...]
    read: list[TaskFunction]

    @classmethod
    def of(
        cls, model: mujoco.MjModel, levels: Sequence[TaskFunction | Sequence[TaskFunction]]
    ) -> "Levels":
        """The levels in a model.

        Raises:
            ModelError: A name that does not exist.
            ValueError: No level, an empty one, or one task twice.
        """
        if not isinstance(levels, Sequence) or isinstance(levels, str) or not len(levels):
            raise ValueError(f"tasks must be a list of tasks, got {check.short_repr(levels)}")
        tasks = tuple(
            (each,)
            if isinstance(each, TaskFunction)
            else check.members(f"tasks[{k}]", each, TaskFunction)
            for k, each in enumerate(levels)
        )
        every = [task for level in tasks for task in level]
        if not all(tasks) or len(set(every)) < len(every):
            raise ValueError("tasks must have one at least in each level, and none twice")
        located = tuple(tuple(task.on(model) for task in level) for level in tasks)
        for task in every:
            task.give()
        rows = [
            task
            for level, places in zip(tasks, located, strict=True)
            for task, place in zip(level, places, strict=True)
            if not isinstance(place, LocatedRates)
        ]
        return cls(model, tasks, located, rows or every[:1])

    def levels(self, system: ConstrainedSystem) -> list[list[Task]]:
        """What the hierarchy of a mechanism minimizes."""
        first, levels = 0, []
        of_rows, of_rates = system.geometry.task_units, system.geometry.velocity_units
        for tasks, places in zip(self.tasks, self.located, strict=True):
            level, is_natural = [], all(task.weight is None for task in tasks)
            for task, place in zip(tasks, places, strict=True):
                if isinstance(place, LocatedRates):
                    rates = np.zeros(len(of_rates))
                    natural = 1.0 / of_rates[place.velocities]
                    rates[place.velocities] = natural if is_natural else _weight(task, len(natural))
                    W = np.diag(rates[system.active])
                    level.append(Task(None, W[W.any(axis=1)], damping=task.damping or 0.0))
                    continue
                rows = slice(first, first + len(place.angular))
                natural = 1.0 / of_rows[rows]
                W = natural if is_natural else _weight(task, len(natural))
                level.append(Task(rows, W, damping=task.damping or 0.0))
                first = rows.stop
            levels.append(level)
        return levels

    def targets(self, kinematics: Kinematics) -> "Targets":
        """What asks for velocities at any state, for joints for the rates of the survivors."""
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
    """What one task asks for.

    Attributes:
        task: With its gain.
        located: The same in the model.
        size: How many numbers its error has.
        rows: Where they are among those of all tasks.
        among: Which of them count; None is all.
        own: Where its numbers and zeros are, of rates that it does not ask for.
    """

    task: TaskFunction
    located: LocatedFunction
    size: int
    rows: slice | Indices
    among: Indices | None
    own: slice


class Targets(NamedTuple):
    """Velocities that tasks ask for.

    Attributes:
        model: Where.
        levels: The tasks of each.
        size: How many numbers they ask for.
    """

    model: mujoco.MjModel
    levels: tuple[tuple[Part, ...], ...]
    size: int

    def at(self, data: mujoco.MjData, period_s: float) -> Array:
        """Those at a state, one task after the other, shape (t,)."""
        asked = np.zeros(self.size)
        for level in self.levels:
            for task, located, size, rows, among, _ in level:
                error = located.error(self.model, data)
                is_plain = check.is_plain(error) and error.shape == (size,)
                if not (is_plain and check.is_moderate(error)):  # of a user's own task
                    error = check.array(f"the error of {check.short_repr(task)}", error, size)
                velocity = task.gain / period_s * error
                asked[rows] = velocity if among is None else velocity[among]
        return check.array("what the errors of the tasks ask for in dt", asked)

    def of_rows(self) -> Indices:
        """Where those of each row of J_T are among them, shape (m,)."""
        parts = [part for level in self.levels for part in level if part.among is None]
        return np.concatenate([*(np.arange(self.size)[part.own] for part in parts), _NO_ROWS])

    def of_levels(self, asked: Array) -> list[Array | list[Array]]:
        """The same as a hierarchy takes them: of each level an array, or a list of arrays."""
        every = [[asked[part.own] for part in level] for level in self.levels]
        return [level if len(level) > 1 else level[0] for level in every]


_NO_ROWS = np.zeros(0, dtype=np.intp)


def _weight(task: TaskFunction, size: int) -> Array:
    """Of each row, shape (k,)."""
    weight = np.asarray(1.0 if task.weight is None else task.weight)
    if weight.ndim and len(weight) != size:
        task_named = check.short_repr(task)
        raise ValueError(f"weight of {task_named} must be one number or {size}, got {len(weight)}")
    return np.broadcast_to(weight, (size,))
