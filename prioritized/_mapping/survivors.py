"""Arguments given for all actuators, cut to those that survive."""

import dataclasses
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

import argument_checks as check
from argument_checks import Array, Indices
from prioritized._mapping.tasks import Task
from prioritized._mechanism.elimination import Joints


class Survivors(NamedTuple):
    """The surviving `actuators` of `n`; what is not as wide as n is returned as it is."""

    actuators: Indices
    n: int

    @classmethod
    def of(cls, joints: Joints) -> "Survivors":
        """Those of a mechanism."""
        return cls(joints.actuators, len(joints.actuated))

    def matrix(self, name: str, value: ArrayLike | None) -> Array | None:
        """A weight, or rows, with a column for each actuator."""
        if value is None:
            return None
        W = value if check.is_plain(value) else check.real(name, value)
        if W.ndim and W.shape[-1] == self.n > len(self.actuators):
            return W[..., self.actuators]
        return W

    def pair(self, value: Any) -> Any:
        """Limits (lower, upper)."""
        whole = len(self.actuators) == self.n
        if value is None or whole or not _is_of(value, 2) or check.is_masked(value):
            return value
        return tuple(
            np.asarray(side)[self.actuators] if self._is_wide(side) else side for side in value
        )

    def _is_wide(self, side: Any) -> bool:
        return not check.is_masked(side) and np.shape(side) == (self.n,)

    def rows(self, name: str, value: Any) -> Any:
        """Inequality rows (R, lower, upper)."""
        if value is None or not _is_of(value, 3):
            return value
        R, lower, upper = value
        return self.matrix(name, R), lower, upper

    def task(self, task: Task) -> Task:
        """A task: the weight of one that is rates."""
        if task.rows is not None or task.weight is None:
            return task
        return dataclasses.replace(task, weight=self.matrix("weight", task.weight))


def _is_of(value: Any, size: int) -> bool:
    return isinstance(value, Sequence | np.ndarray) and len(value) == size
