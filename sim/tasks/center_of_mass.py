"""The centre of mass: where it is to be."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, NamedTuple

import mujoco

import argument_checks as check
from sim.array import Array
from sim.kinematics.task import CenterOfMass, LocatedCenter, located_center, new_rows
from sim.mjcf.frame import Located
from sim.tasks.function import TaskFunction, chosen_rows, rows_among


@dataclass(eq=False)
class CenterOfMassTask(TaskFunction):
    """The centre of mass of the model, or of a body with all that it carries, is to be somewhere.

    Attributes:
        body: Name of the body; None is everything.
        rows: Which of the world's x, y and z, among 0..2.
        target: Position in the world, shape (3,), whichever rows count.

    Further attributes are those of :class:`TaskFunction`.

    Raises:
        ValueError: A row out of range or repeated, or as :class:`TaskFunction`.
        TypeError: An argument is of another kind.
    """

    _checks: ClassVar = {
        "rows": lambda _, value: rows_among(value, 3),
        "body": lambda _, value: CenterOfMass(value).body,
    }

    body: str | None = None
    rows: Sequence[int] = field(default=range(3), kw_only=True)

    def checked(self, target: Any) -> Array:
        """A position (3,)."""
        return check.frozen(check.exactly("target", target, 3))

    def on(self, model: mujoco.MjModel) -> "LocatedCenterTask":
        """As :meth:`TaskFunction.on`."""
        center = located_center(model, CenterOfMass(self.body))
        return LocatedCenterTask(self, center, rows_among(self.rows, 3))


class LocatedCenterTask(NamedTuple):
    """The same in one model."""

    task: CenterOfMassTask
    center: LocatedCenter
    rows: tuple[int, ...]

    @property
    def frames(self) -> tuple[Located, ...]:
        """Of all bodies."""
        return self.center.frames

    @property
    def angular(self) -> tuple[bool, ...]:
        """None."""
        return (False,) * len(self.rows)

    def jacobian(self, model: mujoco.MjModel, data: mujoco.MjData) -> Array:
        """Rows of its velocity per qvel, shape (k, nv)."""
        return new_rows(self, model, data)

    def write_jacobian(self, model: mujoco.MjModel, data: mujoco.MjData, out: Array) -> None:
        """Overwrite an array (k, nv) by it."""
        out[:] = chosen_rows(self.center.jacobian(model, data), self.rows)

    def error(self, model: mujoco.MjModel, data: mujoco.MjData) -> Array:
        """Translation to the target, its rows, shape (k,)."""
        way = self.task.needed() - data.subtree_com[self.center.body]
        return chosen_rows(way, self.rows)
