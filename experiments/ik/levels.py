"""Levels of task functions as the hierarchy of a mechanism takes them."""

from collections.abc import Sequence
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import ArrayLike

import argument_checks as check
from prioritized import ConstrainedSystem, Kinematics, Task
from sim import Array, LocatedFunction, LocatedRates, TaskFunction


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
            TypeError: Something of another kind.
        """
        if not isinstance(levels, Sequence) or isinstance(levels, str) or not len(levels):
            raise ValueError(f"tasks must be a list of tasks, got {check.shown(levels)}")
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
                    rates[place.velocities] = natural if is_natural else _weight(task)
                    W = np.diag(rates[system.active])
                    level.append(Task(None, W[W.any(axis=1)], damping=task.damping))
                    continue
                rows = slice(first, first + len(place.angular))
                natural = 1.0 / of_rows[rows]
                W = natural if is_natural else np.broadcast_to(_weight(task), natural.shape)
                level.append(Task(rows, W, damping=task.damping))
                first = rows.stop
            levels.append(level)
        return levels

    def targets(
        self, data: mujoco.MjData, kinematics: Kinematics, N: int, period_s: float
    ) -> list[Array | list[Array]]:
        """Velocity that each task asks for; for joints the rates of the survivors among N."""
        asked = []
        for tasks, places in zip(self.tasks, self.located, strict=True):
            level = []
            for task, place in zip(tasks, places, strict=True):
                velocity = task.gain / period_s * place.error(self.model, data)
                if isinstance(place, LocatedRates):
                    every = np.zeros(N)
                    every[place.velocities] = velocity
                    velocity = every[kinematics.active]
                level.append(velocity)
            asked.append(level if len(level) > 1 else level[0])
        return asked


def _weight(task: TaskFunction) -> ArrayLike:
    return 1.0 if task.weight is None else task.weight
