"""Frames: where they are to be, in the world or as seen from one another."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, NamedTuple

import mujoco

from sim.array import Array
from sim.kinematics.pose import Pose, way_between
from sim.kinematics.target import target_pose
from sim.kinematics.task import LocatedFrame, new_rows
from sim.mjcf.frame import Body, Located, located
from sim.tasks.function import TaskFunction, chosen_rows, frame_name, rows_among, turned

_AS_WRITTEN = tuple(range(6)), tuple(range(3, 6))
"""Rows that a frame writes itself."""


@dataclass(eq=False, kw_only=True)
class _OnTwist(TaskFunction):
    _checks: ClassVar = {
        "rows": lambda _, value: rows_among(value, 6),
        "frame": frame_name,
        "root": frame_name,
        "axes": lambda name, value: None if value is None else frame_name(name, value),
    }

    rows: Sequence[int] = range(6)

    def checked(self, target: Any) -> Any:
        """A pose, or a position (3,)."""
        return target_pose("target", target)


@dataclass(eq=False)
class FrameTask(_OnTwist):
    """A frame is to be at a pose: rows of its twist [angular; linear].

    The error is [rotation vector; translation] from the frame to the target. So the frame turns
    about one axis, and its origin takes the straight line.

    Attributes:
        frame: Name of a site or else of a body, or a :class:`sim.Body`.
        axes: Site or body in whose axes the rows are, which may be the frame itself; None is the
            world.
        rows: Which rows of the twist, among 0..5.
        target: A pose in the world in any form that :func:`sim.pose_error` takes; a position (3,)
            has the rotation as it is.

    Further attributes are those of :class:`TaskFunction`.

    Raises:
        ValueError: A row out of range or repeated, or as :class:`TaskFunction`.
        TypeError: An argument is of another kind.
    """

    frame: str | Body
    axes: str | Body | None = field(default=None, kw_only=True)

    def on(self, model: mujoco.MjModel) -> "LocatedTwist":
        """As :meth:`TaskFunction.on`."""
        axes = None if self.axes is None else located(model, "axes", self.axes)
        frame = LocatedFrame(located(model, "frame", self.frame))
        return LocatedTwist(self, frame, axes, rows_among(self.rows, 6))


@dataclass(eq=False)
class RelativeFrameTask(_OnTwist):
    """A frame is to be at a pose as seen from another one, which may move too.

    Attributes:
        frame: Name of a site or else of a body, or a :class:`sim.Body`.
        root: The same; rows and target are in its axes.
        rows: Which rows of the relative twist [angular; linear], among 0..5.
        target: A pose as seen from `root`, as of :class:`FrameTask`.

    Further attributes and errors are those of :class:`FrameTask`.
    """

    frame: str | Body
    root: str | Body

    def on(self, model: mujoco.MjModel) -> "LocatedTwist":
        """As :meth:`TaskFunction.on`."""
        root = located(model, "root", self.root)
        frame = LocatedFrame(located(model, "frame", self.frame), root)
        return LocatedTwist(self, frame, root, rows_among(self.rows, 6))


class LocatedTwist(NamedTuple):
    """A task on the twist of a frame in one model.

    Attributes:
        task: What is asked for.
        moving: The frame, and what it is seen from.
        axes: Of rows; None is the world.
        rows: Which of the twist.
    """

    task: FrameTask | RelativeFrameTask
    moving: LocatedFrame
    axes: Located | None
    rows: tuple[int, ...]

    @property
    def frames(self) -> tuple[Located, ...]:
        """The frame, and that which it is seen from."""
        return self.moving.frames

    @property
    def angular(self) -> tuple[bool, ...]:
        """The first three of a twist."""
        return tuple(row < 3 for row in self.rows)

    def jacobian(self, model: mujoco.MjModel, data: mujoco.MjData) -> Array:
        """Rows of the twist per qvel, shape (k, nv)."""
        return new_rows(self, model, data)

    def write_jacobian(self, model: mujoco.MjModel, data: mujoco.MjData, out: Array) -> None:
        """Overwrite an array (k, nv) by it."""
        if self.axes is None and self.moving.root is None and self.rows in _AS_WRITTEN:
            self.moving.write_jacobian(model, data, out)
            return
        twist = self.moving.jacobian(model, data)
        if self.axes is not None:
            twist = turned(self.axes.rotation(data), twist)
        out[:] = chosen_rows(twist, self.rows)

    def error(self, model: mujoco.MjModel, data: mujoco.MjData) -> Array:
        """[rotation vector; translation] to the target, its rows, shape (k,)."""
        target, (frame, root) = self.task.needed(), self.moving
        rotation, position = frame.rotation(data), frame.position_m(data)
        is_pose = isinstance(target, Pose)
        there, goal = (target.rotation, target.translation_m) if is_pose else (rotation, target)
        if root is not None:
            from_root = root.rotation(data)
            goal = root.position_m(data) + from_root @ goal
            there = from_root @ there if is_pose else there
        way = way_between(rotation, position, there, goal)
        if not is_pose:
            way[:3] = 0.0  # but for round-off
        if self.axes is not None:
            way = turned(self.axes.rotation(data), way)
        return chosen_rows(way, self.rows)
