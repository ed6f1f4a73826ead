"""What a task function is, and what all of them share."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import mujoco
from numpy.typing import ArrayLike

import argument_checks as check
from sim.array import Array
from sim.kinematics.task import LocatedFunction


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
        ValueError: A gain outside of 0..1, a negative weight or damping, rows out of range, or a
            target of the wrong shape.
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
        """The target in the form that the error is computed with."""
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
    weight = check.frozen(check.array(name, value, least=0.0))
    if weight.ndim > 1:
        raise ValueError(f"{name} must be one number or (k,), got {check.shown(value)}")
    return weight


_CHECKS: dict[str, Callable[[str, Any], Any]] = {
    "gain": lambda name, value: check.number(name, value, 0.0, 1.0),
    "weight": _weight,
    "damping": lambda name, value: None if value is None else check.number(name, value, 0.0),
}


def rows_among(rows: Sequence[int], count: int) -> tuple[int, ...]:
    """Rows by number, each once, one at least."""
    chosen = tuple(check.indices("rows", rows, count).tolist())
    if not chosen:
        raise ValueError("rows must have one at least, got none")
    return chosen
