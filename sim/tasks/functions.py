"""Task functions for frames, centres of mass, pointing directions and joints."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

import argument_checks as check
from argument_checks.ties import least
from sim.array import Array
from sim.errors import ModelError
from sim.kinematics.pose import target_pose
from sim.kinematics.task import CenterOfMass, Motion, TaskFunction, mass_center
from sim.mjcf.frame import Body, Located, located
from sim.mjcf.joints import joint_positions, one_axis, turning
from sim.mjcf.model import element_id

_FREE = int(mujoco.mjtJoint.mjJNT_FREE)
_NEAREST_M = 1e-9
"""Distance [m] of a target below which the direction to it is undefined."""


def _frame(name: str, value: Any) -> str | Body:
    return check.instance(name, value, str, Body)


def _direction(name: str, value: ArrayLike) -> Array:
    given = check.array(name, value, 3)
    length = np.linalg.norm(given)
    if not check.SMALLEST <= length < check.LARGEST:
        raise ValueError(f"{name} must have a length, got {check.short_repr(value)}")
    return check.frozen(given / length)


def _rows_among(rows: Sequence[int], count: int) -> tuple[int, ...]:
    """Check row numbers below `count`: distinct, at least one."""
    chosen = tuple(check.indices("rows", rows, count).tolist())
    if not chosen:
        raise ValueError("rows must have at least one, got none")
    return chosen


@dataclass(eq=False, kw_only=True)
class _OnTwist(TaskFunction):
    _checks: ClassVar = {
        "rows": lambda _, value: _rows_among(value, 6),
        "frame": _frame,
        "root": _frame,
        "axes": lambda name, value: None if value is None else _frame(name, value),
    }

    rows: Sequence[int] = range(6)

    def checked(self, target: Any) -> Any:
        """Return the target as a pose, or as a position (3,) [m]."""
        return target_pose("target", target)


@dataclass(eq=False)
class FrameTask(_OnTwist):
    """Task that moves a frame to a pose: rows of its twist [angular; linear].

    The error is [rotation vector; translation] from the frame to the target: the frame rotates
    about one axis while its origin moves along a straight line.

    Attributes:
        frame: Name of a site or else of a body, or a :class:`sim.Body`.
        axes: Site or body in whose axes the rows are, which may be the frame itself; None is the
            world.
        rows: Rows of the twist, among 0..5.
        target: A pose in the world in any form that :func:`sim.pose_error` takes; a position (3,)
            keeps the present rotation.

    Further attributes, and errors, are those of :class:`TaskFunction`.
    """

    frame: str | Body
    axes: str | Body | None = field(default=None, kw_only=True)

    def on(self, model: mujoco.MjModel) -> Motion:
        """Look up the names in a model; see :meth:`TaskFunction.on`."""
        axes = None if self.axes is None else located(model, "axes", self.axes)
        frame = located(model, "frame", self.frame)
        return Motion(frame, None, axes, tuple(self.rows), self.needed)


@dataclass(eq=False)
class RelativeFrameTask(_OnTwist):
    """Task that moves a frame to a pose relative to another frame, which may move.

    Attributes:
        frame: Name of a site or else of a body, or a :class:`sim.Body`.
        root: Name or :class:`sim.Body` of the other frame; rows and target are in its axes.
        rows: Rows of the relative twist [angular; linear], among 0..5.
        target: Pose relative to `root`, in the forms of :class:`FrameTask`.

    Further attributes, and errors, are those of :class:`TaskFunction`.
    """

    frame: str | Body
    root: str | Body

    def on(self, model: mujoco.MjModel) -> Motion:
        """Look up the names in a model; see :meth:`TaskFunction.on`."""
        root, frame = located(model, "root", self.root), located(model, "frame", self.frame)
        return Motion(frame, root, root, tuple(self.rows), self.needed)


@dataclass(eq=False)
class CenterOfMassTask(TaskFunction):
    """Task that moves the centre of mass of the model, or of a body with its subtree.

    Attributes:
        body: Name of the body; None is the whole model.
        rows: Rows among 0..2: the world's x, y and z.
        target: Position in the world [m], shape (3,), for any rows.

    Further attributes, and errors, are those of :class:`TaskFunction`.
    """

    _checks: ClassVar = {
        "rows": lambda _, value: _rows_among(value, 3),
        "body": lambda _, value: CenterOfMass(value).body,
    }

    body: str | None = None
    rows: Sequence[int] = field(default=range(3), kw_only=True)

    def checked(self, target: Any) -> Array:
        """Return the target as a checked position (3,) [m]."""
        return check.frozen(check.array("target", target, 3))

    def on(self, model: mujoco.MjModel) -> Motion:
        """Look up the names in a model; see :meth:`TaskFunction.on`."""
        rows = tuple(3 + row for row in self.rows)
        return Motion(mass_center(model, self.body), None, None, rows, self.needed)


@dataclass(eq=False)
class LookAtTask(TaskFunction):
    """Task of two rows that points an axis of a frame at a position.

    It is the paper's pointing for a target at any distance: the rows are the angular velocity of
    the axis minus that of the direction to the target, about two axes of the frame that are
    perpendicular to it. Rotation about the axis is free.

    Attributes:
        frame: Name of a site or else of a body, or a :class:`sim.Body`.
        axis: Pointing axis in the frame, shape (3,), of any length but zero; a camera of MuJoCo
            looks along (0, 0, -1).
        target: Position in the world [m], shape (3,).

    Further attributes, and errors, are those of :class:`TaskFunction`.
    """

    _checks: ClassVar = {"frame": _frame, "axis": _direction}

    frame: str | Body
    axis: ArrayLike

    def checked(self, target: Any) -> Array:
        """Return the target as a checked position (3,) [m]."""
        return check.frozen(check.array("target", target, 3))

    def on(self, model: mujoco.MjModel) -> "LocatedLookAt":
        """Look up the names in a model; see :meth:`TaskFunction.on`."""
        axis, frame = np.asarray(self.axis), located(model, "frame", self.frame)
        first = np.cross(axis, np.eye(3)[least(np.abs(axis))])
        first /= np.linalg.norm(first)
        return LocatedLookAt(self, (frame,), axis, np.column_stack([first, np.cross(axis, first)]))


@dataclass(frozen=True, eq=False)
class LocatedLookAt:
    """Pointing task :class:`LookAtTask` of one model.

    Attributes:
        task: The task, which has the target.
        frames: The frame that points.
        axis: Pointing axis in the frame, shape (3,).
        across: Two axes of the frame perpendicular to it, shape (3, 2).
    """

    task: LookAtTask
    frames: tuple[Located]
    axis: Array
    across: Array
    angular = True, True

    def jacobian(self, model: mujoco.MjModel, data: mujoco.MjData) -> Array:
        """Return the rows per qvel, (2, nv): rotation of the axis minus that of the direction."""
        twist = self.frames[0].jacobian(model, data)
        across = self.frames[0].rotation(data) @ self.across
        rows = across.T @ twist[:3]
        if self.task.target is None:  # treated as infinitely far away
            return rows
        direction, distance = self._line_of_sight(data)
        if distance >= _NEAREST_M:
            # The direction turns with -(direction x velocity) / distance.
            rows += np.cross(across.T, direction) / distance @ twist[3:]
        return rows

    def error(self, model: mujoco.MjModel, data: mujoco.MjData) -> Array:
        """Return the rotation vector from the axis to the direction, about two axes, (2,)."""
        direction, distance = self._line_of_sight(data)
        if distance < _NEAREST_M:
            return np.zeros(2)
        rotation = self.frames[0].rotation(data)
        axis = rotation @ self.axis
        turn = (rotation @ self.across).T @ np.cross(axis, direction)
        sine, cosine = float(np.linalg.norm(turn)), float(axis @ direction)
        if sine < check.SMALLEST:  # the axis points at the target, or exactly away from it
            return np.zeros(2) if cosine > 0.0 else np.array([np.pi, 0.0])
        return turn * (np.arctan2(sine, cosine) / sine)

    def _line_of_sight(self, data: mujoco.MjData) -> tuple[Array, float]:
        """Return the unit vector to the target in the world, (3,), and its distance [m]."""
        offset = self.task.needed() - self.frames[0].position_m(data)
        distance = float(np.linalg.norm(offset))
        return offset / max(distance, _NEAREST_M), distance


def _names(name: str, value: Iterable[str] | None) -> tuple[str, ...] | None:
    return None if value is None else check.members(name, value, str)


def _factors(name: str, value: Mapping[str, float]) -> Mapping[str, float]:
    given = check.instance(name, value, Mapping)
    factors = {joint: check.number(name, given[joint]) for joint in check.members(name, given, str)}
    if not any(factors.values()):
        raise ValueError(f"{name} must name at least one joint with a factor, got none")
    return factors


@dataclass(eq=False, kw_only=True)
class _OnRates(TaskFunction):
    _checks: ClassVar = {"joints": _names}
    _with_free: ClassVar = True
    """True if free joints are included when `joints` is None."""

    joints: Iterable[str] | None = None

    def on(self, model: mujoco.MjModel) -> "LocatedRates":
        """Look up the names in a model; see :meth:`TaskFunction.on`."""
        check.instance("model", model, mujoco.MjModel)
        if self.joints is None:
            among = self._with_free | (model.jnt_type != _FREE)
        else:
            among = np.zeros(model.njnt, dtype=bool)
            among[[element_id(model, "joint", name) for name in self.joints]] = True
        velocities = np.flatnonzero(among[model.dof_jntid])
        return LocatedRates(self, velocities, tuple(turning(model)[velocities].tolist()))


@dataclass(eq=False)
class PostureTask(_OnRates):
    """Task that moves joints to a posture; its rows are joint velocities.

    Only joints that have an actuator or are variables have rows, since others depend on these. If
    tasks of higher priority do not allow the posture, use a gain of 0.1 to 0.5: at 1 each step
    corrects the whole error to first order, and large motions may oscillate between two postures.

    Attributes:
        joints: Names of the joints; None is all except free joints.
        target: Positions of all joints, as `data.qpos`, shape (nq,).
        weight: One number, or one for each velocity of these joints, (k,).

    Further attributes and errors are those of :class:`TaskFunction`.
    """

    _with_free: ClassVar = False

    def checked(self, target: Any) -> Array:
        """Return the target as checked joint positions (nq,)."""
        return check.frozen(check.array("target", target, None))


@dataclass(eq=False)
class DampingTask(_OnRates):
    """Task that minimizes joint velocities in the null space of the levels before it.

    It must be a level of its own. Later levels cannot move these joints.

    Attributes:
        joints: Names of the joints; None is all, including free joints.
        weight: Weight as for :class:`PostureTask`.

    Gain and damping have no effect; a target raises ValueError. Other errors are those of
    :class:`TaskFunction`.
    """

    def checked(self, target: Any) -> Any:
        """Check that the target is None: the target is zero velocity."""
        if target is not None:
            raise ValueError(f"target must be None (zero velocity), got {check.short_repr(target)}")
        return None


@dataclass(frozen=True, eq=False)
class LocatedRates:
    """Task on joint velocities of one model: rows of the identity matrix, at any pose.

    Attributes:
        task: The task, which has the target.
        velocities: Indices of the velocities, shape (k,).
        angular: Whether each of them is angular.
    """

    task: _OnRates
    velocities: NDArray[np.intp]
    angular: tuple[bool, ...]
    frames: tuple[Located, ...] = ()

    def jacobian(self, model: mujoco.MjModel, data: mujoco.MjData) -> Array:
        """Return the rows per qvel, shape (k, nv)."""
        return np.eye(model.nv)[self.velocities]

    def error(self, model: mujoco.MjModel, data: mujoco.MjData) -> Array:
        """Return the displacement of each of these velocities to the target, shape (k,)."""
        if isinstance(self.task, DampingTask):
            return np.zeros(len(self.velocities))
        target = self.task.needed()
        if len(target) != model.nq:
            raise ValueError(f"target must have shape ({model.nq},), got ({len(target)},)")
        displacement = np.empty(model.nv)
        mujoco.mj_differentiatePos(model, displacement, 1.0, data.qpos, target)
        return displacement[self.velocities]


@dataclass(eq=False)
class JointCouplingTask(TaskFunction):
    """Task of one row that moves a weighted sum of joint positions to a value.

    An example is a finger joint that follows another one.

    Attributes:
        coefficients: Factor of the position of each slide or hinge joint, by its name.
        target: Value of the sum of coefficients times positions.

    Further attributes, and errors, are those of :class:`TaskFunction`.
    """

    _checks: ClassVar = {"coefficients": _factors}

    coefficients: Mapping[str, float]
    target: float = field(default=0.0, kw_only=True, repr=False)

    def checked(self, target: Any) -> float:
        """Return the target as a checked number."""
        return check.number("target", target)

    def on(self, model: mujoco.MjModel) -> "LocatedCoupling":
        """Look up the names in a model; see :meth:`TaskFunction.on`."""
        row = np.zeros(check.instance("model", model, mujoco.MjModel).nv)
        for name, factor in self.coefficients.items():
            joint = element_id(model, "joint", name)
            if not one_axis(model)[joint]:
                raise ModelError(f'coefficients: joint "{name}" is no slide and no hinge')
            row[model.jnt_dofadr[joint]] = factor
        used = np.flatnonzero(row)
        bodies = {int(body) for body in model.dof_bodyid[used]}
        frames = tuple(Located(body, body, is_site=False) for body in sorted(bodies))
        return LocatedCoupling(self, row, frames, (bool(turning(model)[used[0]]),))


@dataclass(frozen=True, eq=False)
class LocatedCoupling:
    """Joint-coupling task of one model.

    Attributes:
        task: The task, which has the target.
        row: Factor of each velocity, shape (nv,).
        frames: Frames of the bodies that these joints move.
        angular: Whether the first joint is a hinge.
    """

    task: JointCouplingTask
    row: Array
    frames: tuple[Located, ...]
    angular: tuple[bool, ...]

    def jacobian(self, model: mujoco.MjModel, data: mujoco.MjData) -> Array:
        """Return the row per qvel, (1, nv)."""
        return self.row[None]

    def error(self, model: mujoco.MjModel, data: mujoco.MjData) -> Array:
        """Return the difference between the target and the sum, shape (1,)."""
        return np.array([self.task.needed() - self.row @ joint_positions(model, data.qpos)])
