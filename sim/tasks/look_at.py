"""Pointing: an axis of a frame is to look at a point."""

from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import mujoco
import numpy as np
from numpy.typing import ArrayLike

import argument_checks as check
from argument_checks.ties import least
from sim.array import Array
from sim.kinematics.task import new_rows
from sim.mjcf.frame import Body, Located, located
from sim.tasks.function import TaskFunction, frame_name

_NEAREST_M = 1e-9
"""Of a point to the frame: nearer, no direction leads there."""


def _direction(name: str, value: ArrayLike) -> Array:
    given = check.exactly(name, value, 3)
    length = np.linalg.norm(given)
    if not check.SMALLEST <= length < check.LARGEST:
        raise ValueError(f"{name} must have a length, got {check.shown(value)}")
    return check.frozen(given / length)


@dataclass(eq=False)
class LookAtTask(TaskFunction):
    """An axis of a frame is to point at a position: two rows, however the frame turns about it.

    It is the paper's pointing for a target at any distance: the rows are the angular velocity of
    the axis less that of the direction to the target, about two axes of the frame that are
    perpendicular to it.

    Attributes:
        frame: Name of a site or else of a body, or a :class:`sim.Body`.
        axis: The axis that looks, a vector in the frame of any length but zero, shape (3,); a
            camera of MuJoCo looks along (0, 0, -1).
        target: Position in the world, shape (3,).

    Further attributes are those of :class:`TaskFunction`.

    Raises:
        ValueError: An axis of no length, or as :class:`TaskFunction`.
        TypeError: An argument is of another kind.
    """

    _checks: ClassVar = {"frame": frame_name, "axis": _direction}

    frame: str | Body
    axis: ArrayLike

    def checked(self, target: Any) -> Array:
        """A position (3,)."""
        return check.frozen(check.exactly("target", target, 3))

    def on(self, model: mujoco.MjModel) -> "LocatedGaze":
        """As :meth:`TaskFunction.on`."""
        axis = np.asarray(self.axis)
        first = np.cross(axis, np.eye(3)[least(np.abs(axis))])
        first /= np.linalg.norm(first)
        across = np.column_stack([first, np.cross(axis, first)])
        return LocatedGaze(self, located(model, "frame", self.frame), axis, across)


class LocatedGaze(NamedTuple):
    """The same in one model.

    Attributes:
        task: What is asked for.
        frame: That looks.
        axis: That looks, in the frame, shape (3,).
        across: Two axes of the frame, perpendicular to that which looks, shape (3, 2).
    """

    task: LookAtTask
    frame: Located
    axis: Array
    across: Array

    @property
    def frames(self) -> tuple[Located, ...]:
        """The frame."""
        return (self.frame,)

    @property
    def angular(self) -> tuple[bool, ...]:
        """Both."""
        return True, True

    def jacobian(self, model: mujoco.MjModel, data: mujoco.MjData) -> Array:
        """Angular velocity of the axis less that of the direction, per qvel, shape (2, nv)."""
        return new_rows(self, model, data)

    def write_jacobian(self, model: mujoco.MjModel, data: mujoco.MjData, out: Array) -> None:
        """Overwrite an array (2, nv) by it."""
        twist = self.frame.jacobian(model, data)
        across = self.frame.rotation(data) @ self.across
        if self.task.target is None:  # as far away as can be
            out[:] = across.T @ twist[:3]
            return
        direction, distance = self._sight(data)
        if distance < _NEAREST_M:
            out[:] = across.T @ twist[:3]
            return
        # The direction turns with -(direction x velocity) / distance.
        out[:] = across.T @ twist[:3] + np.cross(across.T, direction) / distance @ twist[3:]

    def error(self, model: mujoco.MjModel, data: mujoco.MjData) -> Array:
        """The rotation vector from the axis to the direction, about the two axes, shape (2,)."""
        direction, distance = self._sight(data)
        if distance < _NEAREST_M:
            return np.zeros(2)
        rotation = self.frame.rotation(data)
        axis = rotation @ self.axis
        turn = (rotation @ self.across).T @ np.cross(axis, direction)
        sine, cosine = float(np.linalg.norm(turn)), float(axis @ direction)
        if sine < check.SMALLEST:  # straight there, or straight away from it
            return np.zeros(2) if cosine > 0.0 else np.array([np.pi, 0.0])
        return turn * (np.arctan2(sine, cosine) / sine)

    def _sight(self, data: mujoco.MjData) -> tuple[Array, float]:
        """Unit vector to the target in the world, (3,), and how far that is [m]."""
        way = self.task.needed() - self.frame.position_m(data)
        distance = float(np.linalg.norm(way))
        return way / max(distance, _NEAREST_M), distance
