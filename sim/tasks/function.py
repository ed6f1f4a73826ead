"""What a task function is, and what all of them share."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, ClassVar, Protocol

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

import argument_checks as check
from sim.array import Array
from sim.kinematics.task import LocatedRows
from sim.mjcf.frame import Body


class LocatedFunction(LocatedRows, Protocol):
    """A task function, once its names are looked up in a model."""

    def error(self, model: mujoco.MjModel, data: mujoco.MjData) -> Array:
        """The way to the target, (k,): J qvel times a second leads there to first order.

        `data` is up to date: positions of frames and centres of mass belong to its `qpos`.

        Raises:
            ValueError: There is no target, or none of this model.
        """
        ...


@dataclass(eq=False, kw_only=True)
class TaskFunction(ABC):
    """One thing to do: rows of a Jacobian, and the way to a target that the loop may move.

    A class of your own is a dataclass with a method :meth:`on`. Arguments are checked whenever they
    are set. The target and the gain may be set at any time; what else is checked is fixed once the
    task is given to `fjh.Ik`, which has looked it up by then: to set it raises.

    Attributes:
        target: What is to be reached; None is nothing yet.
        gain: Part of the way to the target that is asked for in one tick, in 0..1.
        weight: Of the rows, against others of the same level: one number or (k,); None is 1, in
            natural units.
        damping: Tikhonov damping of this task's level, in units of the singular values of its rows;
            see :class:`prioritized.Task`. None damps only a step that would not come nearer, as
            before a target out of reach, by what is asked for (Levenberg and Marquardt).

    Raises:
        ValueError: A gain outside of 0..1, a weight or damping that is negative or not finite, or a
            target of the wrong shape.
        TypeError: An argument is of another kind.
        AttributeError: What is fixed is set.
    """

    _checks: ClassVar[Mapping[str, Callable[[str, Any], Any]]] = {}
    """Of attributes of a class of its own, by their names."""
    _is_given: ClassVar[bool] = False

    target: Any = field(default=None, repr=False)
    gain: float = field(default=1.0, repr=False)
    weight: ArrayLike | None = field(default=None, repr=False)
    damping: float | None = field(default=None, repr=False)

    def __setattr__(self, name: str, value: Any) -> None:
        """Check what is set."""
        checks = {**_CHECKS, **self._checks}
        if self._is_given and name in checks and name != "gain":
            raise AttributeError(
                f"{name} of {type(self).__name__} is fixed once an Ik has the task, only target "
                "and gain may be set: make another task, and another Ik"
            )
        if name == "target":
            value = None if value is None else self.checked(value)
        elif name in checks:
            value = checks[name](name, value)
        object.__setattr__(self, name, value)

    def give(self) -> None:
        """Fix what :meth:`on` looks up."""
        object.__setattr__(self, "_is_given", True)

    def checked(self, target: Any) -> Any:
        """The target in the form that the error is computed with.

        Raises:
            ValueError: It is none.
        """
        return target

    @abstractmethod
    def on(self, model: mujoco.MjModel) -> LocatedFunction:
        """Look up the names in a model.

        Raises:
            ModelError: A name that does not exist, with the nearest that does.
        """

    def needed(self) -> Any:
        """The target, which there must be.

        Raises:
            ValueError: There is none yet.
        """
        if self.target is None:
            raise ValueError(f"target of {type(self).__name__} must be set before the first tick")
        return self.target


def _weight(name: str, value: ArrayLike | None) -> Array | None:
    if value is None:
        return None
    weight = check.frozen(check.not_negative(name, value))
    if weight.ndim > 1:
        raise ValueError(f"{name} must be one number or (k,), got {check.shown(value)}")
    return weight


def _damping(name: str, value: float | None) -> float | None:
    return None if value is None else check.number(name, value)


_CHECKS: dict[str, Callable[[str, Any], Any]] = {
    "gain": check.at_most_one,
    "weight": _weight,
    "damping": _damping,
}


def rows_among(rows: Sequence[int], count: int) -> tuple[int, ...]:
    """Rows by number.

    Raises:
        ValueError: One out of range or repeated, or none at all.
    """
    chosen = tuple(check.indices("rows", rows, count).tolist())
    if not chosen:
        raise ValueError("rows must have one at least, got none")
    return chosen


def frame_name(name: str, value: Any) -> str | Body:
    """The name of a site, or a body.

    Raises:
        TypeError: It is neither.
    """
    return check.instance(name, value, str, Body)


def turned(rotation: Array, rows: Array) -> Array:
    """Vectors in the axes of a frame, of stacked vectors (3 k, .) or (3 k,) in world axes."""
    return (rotation.T @ rows.reshape(-1, 3, *rows.shape[1:] or (1,))).reshape(rows.shape)


def chosen_rows(A: Array, rows: tuple[int, ...]) -> Array:
    """These rows of a matrix or vector, in their order; a view where they follow one another."""
    return A[_chosen(rows)]


@lru_cache(maxsize=1024)
def _chosen(rows: tuple[int, ...]) -> slice | NDArray[np.intp]:
    """Rows as an index: looked up once, because they are the same at every tick."""
    first = rows[0]
    if rows == tuple(range(first, first + len(rows))):
        return slice(first, first + len(rows))
    return check.read_only(np.array(rows))
