"""Task functions: frames and centres of mass, where an axis is to point, joints."""

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
"""Of a point to the frame that looks at it: nearer, no direction leads there."""


def _frame(name: str, value: Any) -> str | Body:
    return check.instance(name, value, str, Body)


def _direction(name: str, value: ArrayLike) -> Array:
    given = check.array(name, value, 3)
    length = np.linalg.norm(given)
    if not check.SMALLEST <= length < check.LARGEST:
        raise ValueError(f"{name} must have a length, got {check.short_repr(value)}")
    return check.frozen(given / length)


def _rows_among(rows: Sequence[int], count: int) -> tuple[int, ...]:
    """Rows by number, each once, one at least."""
    chosen = tuple(check.indices("rows", rows, count).tolist())
    if not chosen:
        raise ValueError("rows must have one at least, got none")
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

    Further attributes, and errors, are those of :class:`TaskFunction`.
    """

    frame: str | Body
    axes: str | Body | None = field(default=None, kw_only=True)

    def on(self, model: mujoco.MjModel) -> Motion:
        """As :meth:`TaskFunction.on`."""
        axes = None if self.axes is None else located(model, "axes", self.axes)
        frame = located(model, "frame", self.frame)
        return Motion(frame, None, axes, tuple(self.rows), self.needed)


@dataclass(eq=False)
class RelativeFrameTask(_OnTwist):
    """A frame is to be at a pose as seen from another one, which may move too.

    Attributes:
        frame: Name of a site or else of a body, or a :class:`sim.Body`.
        root: Likewise; rows and target are in its axes.
        rows: Which rows of the relative twist [angular; linear], among 0..5.
        target: A pose as seen from `root`, as of :class:`FrameTask`.

    Further attributes, and errors, are those of :class:`TaskFunction`.
    """

    frame: str | Body
    root: str | Body

    def on(self, model: mujoco.MjModel) -> Motion:
        """As :meth:`TaskFunction.on`."""
        root, frame = located(model, "root", self.root), located(model, "frame", self.frame)
        return Motion(frame, root, root, tuple(self.rows), self.needed)


@dataclass(eq=False)
class CenterOfMassTask(TaskFunction):
    """The centre of mass of the model, or of a body with all that it carries, is to be somewhere.

    Attributes:
        body: Name of the body; None is everything.
        rows: Which of the world's x, y and z, among 0..2.
        target: Position in the world, shape (3,), whichever rows count.

    Further attributes, and errors, are those of :class:`TaskFunction`.
    """

    _checks: ClassVar = {
        "rows": lambda _, value: _rows_among(value, 3),
        "body": lambda _, value: CenterOfMass(value).body,
    }

    body: str | None = None
    rows: Sequence[int] = field(default=range(3), kw_only=True)

    def checked(self, target: Any) -> Array:
        """A position (3,)."""
        return check.frozen(check.array("target", target, 3))

    def on(self, model: mujoco.MjModel) -> Motion:
        """As :meth:`TaskFunction.on`."""
        rows = tuple(3 + row for row in self.rows)
        return Motion(mass_center(model, self.body), None, None, rows, self.needed)


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

    Further attributes, and errors, are those of :class:`TaskFunction`.
    """

    _checks: ClassVar = {"frame": _frame, "axis": _direction}

    frame: str | Body
    axis: ArrayLike

    def checked(self, target: Any) -> Array:
        """A position (3,)."""
        return check.frozen(check.array("target", target, 3))

    def on(self, model: mujoco.MjModel) -> "LocatedSight":
        """As :meth:`TaskFunction.on`."""
        axis, frame = np.asarray(self.axis), located(model, "frame", self.frame)
        first = np.cross(axis, np.eye(3)[least(np.abs(axis))])
        first /= np.linalg.norm(first)
        across = np.column_stack([first, np.cross(axis, first)])
        return LocatedSight(self, (frame,), axis, across)


@dataclass(frozen=True, eq=False)
class LocatedSight:
    """A frame of one model, an axis of which is to point at a position.

    Attributes:
        task: With its target.
        frames: The one that looks.
        axis: That looks, in the frame, shape (3,).
        across: Two axes of the frame, perpendicular to that which looks, shape (3, 2).
    """

    task: LookAtTask
    frames: tuple[Located]
    axis: Array
    across: Array
    angular = True, True

    def jacobian(self, model: mujoco.MjModel, data: mujoco.MjData) -> Array:
        """The rows per qvel, (2, nv): the axis turns, less the direction."""
        twist = self.frames[0].jacobian(model, data)
        across = self.frames[0].rotation(data) @ self.across
        rows = across.T @ twist[:3]
        if self.task.target is None:  # as far away as can be
            return rows
        direction, distance = self._sight(data)
        if distance >= _NEAREST_M:
            # The direction turns with -(direction x velocity) / distance.
            rows += np.cross(across.T, direction) / distance @ twist[3:]
        return rows

    def error(self, model: mujoco.MjModel, data: mujoco.MjData) -> Array:
        """The rotation vector from the axis to the direction, about the two axes, shape (2,)."""
        direction, distance = self._sight(data)
        if distance < _NEAREST_M:
            return np.zeros(2)
        rotation = self.frames[0].rotation(data)
        axis = rotation @ self.axis
        turn = (rotation @ self.across).T @ np.cross(axis, direction)
        sine, cosine = float(np.linalg.norm(turn)), float(axis @ direction)
        if sine < check.SMALLEST:  # straight there, or straight away from it
            return np.zeros(2) if cosine > 0.0 else np.array([np.pi, 0.0])
        return turn * (np.arctan2(sine, cosine) / sine)

    def _sight(self, data: mujoco.MjData) -> tuple[Array, float]:
        """Unit vector to the target in the world, (3,), and how far that is [m]."""
        way = self.task.needed() - self.frames[0].position_m(data)
        distance = float(np.linalg.norm(way))
        return way / max(distance, _NEAREST_M), distance


def _names(name: str, value: Iterable[str] | None) -> tuple[str, ...] | None:
    return None if value is None else check.members(name, value, str)


def _factors(name: str, value: Mapping[str, float]) -> Mapping[str, float]:
    given = check.instance(name, value, Mapping)
    factors = {each: check.number(name, given[each]) for each in check.members(name, given, str)}
    if not any(factors.values()):
        raise ValueError(f"{name} must name a joint at least, with a factor, got none")
    return factors


@dataclass(eq=False, kw_only=True)
class _OnRates(TaskFunction):
    _checks: ClassVar = {"joints": _names}
    _with_free: ClassVar = True
    """Whether all joints are free ones, too."""

    joints: Iterable[str] | None = None

    def on(self, model: mujoco.MjModel) -> "LocatedRates":
        """As :meth:`TaskFunction.on`."""
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
    """Joints are to be where they are in a posture: rows on the rates themselves.

    Of joints that have an actuator, or are variables; others follow from these. Where the tasks
    before it do not allow the posture, take a gain of 0.1 to 0.5: at 1 each step goes the whole way
    to first order, and a robot that must bend far may swing between two postures.

    Attributes:
        joints: Names of the joints; None is all but free ones.
        target: Positions of all joints, as `data.qpos`, shape (nq,).
        weight: One number, or one for each velocity of these joints, (k,).

    Further attributes and errors are those of :class:`TaskFunction`.
    """

    _with_free: ClassVar = False

    def checked(self, target: Any) -> Array:
        """Positions (nq,)."""
        return check.frozen(check.array("target", target, None))


@dataclass(eq=False)
class DampingTask(_OnRates):
    """Joints are to rest: what no level before it asks for is as little motion as can be.

    A level of its own. Whatever comes after it has nothing left to move these joints with.

    Attributes:
        joints: Names of the joints; None is all, free ones too.
        weight: As of :class:`PostureTask`.

    A gain and damping have no effect, and a target is refused. Other errors are those of
    :class:`TaskFunction`.
    """

    def checked(self, target: Any) -> Any:
        """None: the target is to rest."""
        if target is not None:
            raise ValueError(
                f"target must be None, which is to rest, got {check.short_repr(target)}"
            )
        return None


@dataclass(frozen=True, eq=False)
class LocatedRates:
    """A task on rates in one model: rows of the identity, at any pose.

    Attributes:
        task: With its target.
        velocities: Which, shape (k,).
        angular: Whether each is one of an angle.
    """

    task: _OnRates
    velocities: NDArray[np.intp]
    angular: tuple[bool, ...]
    frames: tuple[Located, ...] = ()

    def jacobian(self, model: mujoco.MjModel, data: mujoco.MjData) -> Array:
        """The rows per qvel, shape (k, nv)."""
        return np.eye(model.nv)[self.velocities]

    def error(self, model: mujoco.MjModel, data: mujoco.MjData) -> Array:
        """Displacement of each of these velocities to the target, shape (k,)."""
        if isinstance(self.task, DampingTask):
            return np.zeros(len(self.velocities))
        target = self.task.needed()
        if len(target) != model.nq:
            raise ValueError(f"target of PostureTask must be ({model.nq},), got ({len(target)},)")
        way = np.empty(model.nv)
        mujoco.mj_differentiatePos(model, way, 1.0, data.qpos, target)
        return way[self.velocities]


@dataclass(eq=False)
class JointCouplingTask(TaskFunction):
    """A sum of joint positions is to have a value, as of a finger that follows another: one row.

    Attributes:
        coefficients: Factor of the position of each slide or hinge joint, by its name.
        target: What coefficient times position adds up to, one number.

    Further attributes, and errors, are those of :class:`TaskFunction`.
    """

    _checks: ClassVar = {"coefficients": _factors}

    coefficients: Mapping[str, float]
    target: float = field(default=0.0, kw_only=True, repr=False)

    def checked(self, target: Any) -> float:
        """A number."""
        return check.number("target", target)

    def on(self, model: mujoco.MjModel) -> "LocatedCoupling":
        """As :meth:`TaskFunction.on`."""
        row = np.zeros(check.instance("model", model, mujoco.MjModel).nv)
        for name, factor in self.coefficients.items():
            joint = element_id(model, "joint", name)
            if not one_axis(model)[joint]:
                raise ModelError(f'coefficients: joint "{name}" is no slide and no hinge')
            row[model.jnt_dofadr[joint]] = factor
        used = np.flatnonzero(row)
        bodies = {int(body) for body in model.dof_bodyid[used]}
        frames = tuple(Located(body, body, is_site=False) for body in sorted(bodies))
        angular = (bool(turning(model)[used[0]]),)
        return LocatedCoupling(self, row, frames, angular)


@dataclass(frozen=True, eq=False)
class LocatedCoupling:
    """A sum of positions of joints of one model, with a target.

    Attributes:
        task: With its target.
        row: Factor of each velocity, shape (nv,).
        frames: Of the bodies that these joints move.
        angular: Whether the first is an angle.
    """

    task: JointCouplingTask
    row: Array
    frames: tuple[Located, ...]
    angular: tuple[bool, ...]

    def jacobian(self, model: mujoco.MjModel, data: mujoco.MjData) -> Array:
        """The row per qvel, (1, nv)."""
        return self.row[None]

    def error(self, model: mujoco.MjModel, data: mujoco.MjData) -> Array:
        """What the sum lacks to its target, shape (1,)."""
        return np.array([self.task.needed() - self.row @ joint_positions(model, data.qpos)])
