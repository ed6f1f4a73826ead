"""Tasks: frames, centres of mass and task functions; rows of J_T, poses, errors to targets."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar, NamedTuple, Protocol, TypeAlias

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

import argument_checks as check
from sim.array import Array
from sim.kinematics.pose import NOMINAL, Pose, Target, pose_difference, target_pose
from sim.mjcf.frame import Body, Located, located
from sim.mjcf.model import check_state, element_id

TWIST, LINEAR = tuple(range(6)), tuple(range(3, 6))
_AS_WRITTEN = TWIST, LINEAR
"""Row selections that MuJoCo writes directly."""


@dataclass(frozen=True)
class CenterOfMass:
    """Task of three rows: the centre of mass of the model, or of a body with its subtree.

    Attributes:
        body: Name of the body; None is the whole model.
    """

    body: str | None = None

    def __post_init__(self) -> None:
        """Check the argument."""
        if self.body is not None:
            check.instance("body", self.body, str)


@dataclass(frozen=True)
class Relative:
    """Task of six rows: a frame relative to another one, which may move.

    Attributes:
        frame: Name of a site or else of a body, or a :class:`Body`.
        root: Name or :class:`Body` of the reference frame.
    """

    frame: str | Body
    root: str | Body

    def __post_init__(self) -> None:
        """Check the arguments."""
        check.instance("frame", self.frame, str, Body)
        check.instance("root", self.root, str, Body)


class LocatedFunction(Protocol):
    """Protocol of a task whose names are looked up in a model: rows of J_T, error to a target."""

    @property
    def frames(self) -> tuple[Located, ...]:
        """Frames whose motion the rows depend on."""
        ...

    @property
    def angular(self) -> tuple[bool, ...]:
        """Flags (k,) that are True for angular rows and False for linear ones."""
        ...

    def jacobian(self, model: mujoco.MjModel, data: mujoco.MjData) -> Array:
        """Return the rows per qvel, shape (k, nv).

        Positions of frames and centres of mass in `data` are up to date.
        """
        ...

    def error(self, model: mujoco.MjModel, data: mujoco.MjData) -> Array:
        """Return the error (k,): J qvel times 1 s reaches the target to first order.

        Raises:
            ValueError: The target is not set, or does not fit the model.
        """
        ...


@dataclass(eq=False, kw_only=True)
class TaskFunction(ABC):
    """Base class of task functions: rows of a Jacobian and the error to a target, which may change.

    A subclass is a dataclass with a method :meth:`on`. Attributes are checked when they are set.
    Target and gain may be set at any time; the other checked attributes are fixed once the task is
    passed to `fjh.Ik`, which looks up their names.

    Attributes:
        target: Target value; None until it is set.
        gain: Fraction of the error to correct in one tick, in 0..1.
        weight: Weight of the rows within their level: one number or (k,); None is 1, in natural
            units.
        damping: Tikhonov damping of this task's level, in units of the singular values of its rows;
            see :class:`prioritized.Task`. None damps only steps that would not reduce the error,
            for example towards an unreachable target, by the error (Levenberg and Marquardt).

    Raises:
        ValueError: A gain outside 0..1, a negative weight or damping, rows out of range, or a
            target of the wrong shape.
        AttributeError: A fixed attribute is set.
    """

    _checks: ClassVar[Mapping[str, Callable[[str, Any], Any]]] = {}
    """Checks of a subclass's attributes, by name."""
    _is_fixed: ClassVar[bool] = False

    target: Any = field(default=None, repr=False)
    gain: float = field(default=1.0, repr=False)
    weight: ArrayLike | None = field(default=None, repr=False)
    damping: float | None = field(default=None, repr=False)

    def __setattr__(self, name: str, value: Any) -> None:
        """Check a value and set it; raise AttributeError if the attribute is fixed."""
        checks = {**_CHECKS, **self._checks}
        if self._is_fixed and name in checks and name != "gain":
            raise AttributeError(
                f"{name} of {type(self).__name__} is fixed once an Ik has the task, only target "
                "and gain may be set: create another task and another Ik"
            )
        if name == "target":
            value = None if value is None else self.checked(value)
        elif name in checks:
            value = checks[name](name, value)
        object.__setattr__(self, name, value)

    def fix(self) -> None:
        """Make the attributes that :meth:`on` looks up read-only."""
        object.__setattr__(self, "_is_fixed", True)

    def checked(self, target: Any) -> Any:
        """Check a target and return it in the form from which the error is computed."""
        return target

    @abstractmethod
    def on(self, model: mujoco.MjModel) -> LocatedFunction:
        """Look up the names in a model.

        Raises:
            ModelError: A name does not exist; the message suggests the nearest one.
        """

    def needed(self) -> Any:
        """Return the target, which must be set.

        Raises:
            ValueError: The target is not set.
        """
        if self.target is None:
            raise ValueError(f"target of {type(self).__name__} must be set before the first tick")
        return self.target


def _weight(name: str, value: ArrayLike | None) -> Array | None:
    if value is None:
        return None
    weight = check.frozen(check.array(name, value, least=0.0))
    if weight.ndim > 1:
        raise ValueError(f"{name} must be one number or (k,), got {check.short_repr(value)}")
    return weight


_CHECKS: dict[str, Callable[[str, Any], Any]] = {
    "gain": lambda name, value: check.number(name, value, 0.0, 1.0),
    "weight": _weight,
    "damping": lambda name, value: None if value is None else check.number(name, value, 0.0),
}


Task: TypeAlias = str | Body | CenterOfMass | Relative | TaskFunction
"""Task: a site's name, a body's frame, a centre of mass, a relative frame, a task function."""


class MassCenter(NamedTuple):
    """Centre of mass of a body and its subtree, as a frame with the world's axes.

    `frames` are the frames of all these bodies.
    """

    body: int
    frames: tuple[Located, ...]

    def rotation(self, _: mujoco.MjData) -> Array:
        """Return the axes of the world, (3, 3)."""
        return NOMINAL.rotation

    def position_m(self, data: mujoco.MjData) -> Array:
        """Return the position in the world [m], (3,); a view of `data`."""
        return data.subtree_com[self.body]

    def write_jacobian(self, model: mujoco.MjModel, data: mujoco.MjData, out: Array) -> None:
        """Write the Jacobian of the velocity in world axes to an array (3, nv)."""
        mujoco.mj_jacSubtreeCom(model, data, out, self.body)

    def jacobian(self, model: mujoco.MjModel, data: mujoco.MjData) -> Array:
        """Return the twist in world axes per qvel, (6, nv), whose angular rows are zero."""
        self.write_jacobian(model, data, (twist := np.zeros((6, model.nv)))[3:])
        return twist


@dataclass(frozen=True, eq=False)
class Motion:
    """Rows of the twist [angular; linear] of a frame or centre of mass, and the error to a target.

    It is a :class:`LocatedFunction` that writes its rows directly to J_T at every tick.

    Attributes:
        frame: Frame or centre of mass that moves.
        root: Reference frame; None is the world.
        axes: Axes of the rows; None is the world.
        rows: Numbers of the rows, among 0..5.
        target: Function that returns the target of a task function, or raises if it is not set.
    """

    frame: Located | MassCenter
    root: Located | None = None
    axes: Located | None = None
    rows: tuple[int, ...] = TWIST
    target: Callable[[], Any] | None = None

    @property
    def frames(self) -> tuple[Located, ...]:
        """Frames whose motion the rows depend on."""
        frames = self.frame.frames if isinstance(self.frame, MassCenter) else (self.frame,)
        return frames if self.root is None else (*frames, self.root)

    @property
    def angular(self) -> tuple[bool, ...]:
        """Flags (k,) that are True for angular rows and False for linear ones."""
        return tuple(row < 3 for row in self.rows)

    @cached_property
    def _index(self) -> NDArray[np.intp]:
        return np.array(self.rows)

    def jacobian(self, model: mujoco.MjModel, data: mujoco.MjData) -> Array:
        """Return the rows per qvel, shape (k, nv); `data` is up to date."""
        self.write_jacobian(model, data, rows := np.empty((len(self.rows), model.nv)))
        return rows

    def write_jacobian(self, model: mujoco.MjModel, data: mujoco.MjData, out: Array) -> None:
        """Write the rows per qvel to an array (k, nv)."""
        frame, root, axes = self.frame, self.root, self.axes
        if root is None and axes is None and self.rows in _AS_WRITTEN:
            frame.write_jacobian(model, data, out)
            return
        twist = frame.jacobian(model, data)
        if root is not None:
            of_root = root.jacobian(model, data)
            twist -= of_root
            x, y, z = frame.position_m(data) - root.position_m(data)
            twist[3] -= of_root[1] * z - of_root[2] * y
            twist[4] -= of_root[2] * x - of_root[0] * z
            twist[5] -= of_root[0] * y - of_root[1] * x
        if axes is not None:
            twist = np.matmul(axes.rotation(data).T, twist.reshape(2, 3, -1)).reshape(6, -1)
        twist.take(self._index, axis=0, out=out, mode="clip")  # avoids a buffer

    def error(self, model: mujoco.MjModel, data: mujoco.MjData) -> Array:
        """Return the rows of [rotation vector; translation] to the task's target, shape (k,)."""
        assert self.target is not None
        return self.displacement_to(data, self.target())

    def displacement_to(
        self, data: mujoco.MjData, target: Pose | Array, seen_from: Located | None = None
    ) -> Array:
        """Return the rows of [rotation vector; translation] to a target, shape (k,).

        For a position (3,) the rotation vector is zero. Targets are relative to the root, or
        else to `seen_from`; None is the world.
        """
        rotation, position_m = self.frame.rotation(data), self.frame.position_m(data)
        is_pose, seen_from = isinstance(target, Pose), self.root or seen_from
        there = target.rotation if isinstance(target, Pose) else rotation
        goal = target.translation_m if isinstance(target, Pose) else target
        if seen_from is not None:
            outer = seen_from.rotation(data)
            goal = seen_from.position_m(data) + outer @ goal
            there = outer @ there if is_pose else there
        displacement = pose_difference(rotation, position_m, there, goal)
        if not is_pose:
            displacement[:3] = 0.0  # removes round-off
        if self.axes is not None:
            displacement = (displacement.reshape(2, 3) @ self.axes.rotation(data)).ravel()
        return displacement[self._index]


def mass_center(model: mujoco.MjModel, body: str | None) -> MassCenter:
    """Look up the centre of mass of a named body with its subtree; None is the whole model."""
    check.instance("model", model, mujoco.MjModel)
    within = subtree_bodies(model, 0 if body is None else element_id(model, "body", body))
    return MassCenter(within[0], tuple(Located(k, k, is_site=False) for k in within if k))


def subtree_bodies(model: mujoco.MjModel, body: int) -> list[int]:
    """Return the numbers of a body and of all bodies in its subtree, ascending."""
    subtree = [body]
    for k in range(body + 1, model.nbody):  # parents come before their children
        if model.body_parentid[k] in subtree:
            subtree.append(k)
    return subtree


def located_task(model: mujoco.MjModel, task: Task, axes: Located | None = None) -> LocatedFunction:
    """Look up a task by its names; `axes` are those of its rows, except for task functions."""
    if isinstance(task, CenterOfMass):
        return Motion(mass_center(model, task.body), None, axes, LINEAR)
    if isinstance(task, Relative):
        frame, root = (located(model, "site", name) for name in (task.frame, task.root))
        return Motion(frame, root, axes)
    if isinstance(task, TaskFunction):
        return task.on(model)
    return Motion(located(model, "site", task), axes=axes)


def located_tasks(
    model: mujoco.MjModel, site: Task | Sequence[Task], axes: Located | None = None
) -> dict[Task, LocatedFunction]:
    """Look up the tasks of an argument `site`, at least one; see :func:`located_task`."""
    tasks: Any = list(site) if isinstance(site, list | tuple) else [site]
    if not tasks:
        raise ValueError("site must name at least one task, got none")
    functions = {task: located_task(model, task, axes) for task in tasks}
    if len(functions) < len(tasks):
        raise ValueError(f"site must not repeat a task, got {check.short_repr(tasks)}")
    return functions


def located_axes(model: mujoco.MjModel, axes: str | None) -> Located | None:
    """Look up the site that gives the axes; None is the world."""
    return None if axes is None else located(model, "axes", check.instance("axes", axes, str))


def pose_of(
    model: mujoco.MjModel, data: mujoco.MjData, site: Task, axes: str | None = None
) -> Pose:
    """Return the pose of a task at the present `data.qpos`; frames in `data` are updated.

    Args:
        model: Any model.
        data: State of the model.
        site: One task, as for :func:`jacobians`. The rotation of a centre of mass is the identity.
        axes: Site that is the reference frame; None is the world. A :class:`Relative` is relative
            to its root.
    """
    seen_from, (task,) = _motions(model, data, [site], axes)
    rotation, position_m = task.frame.rotation(data), task.frame.position_m(data)
    if (seen_from := task.root or seen_from) is None:
        return Pose(rotation, position_m)
    to_axes = seen_from.rotation(data).T
    turned = rotation if isinstance(task.frame, MassCenter) else to_axes @ rotation
    return Pose(turned, to_axes @ (position_m - seen_from.position_m(data)))


def pose_error(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    site: Task | Sequence[Task],
    target: Target | Sequence[Target],
    axes: str | None = None,
) -> Array:
    """Return the displacement from tasks to their targets, in the rows of `jacobians`.

    It is [rotation vector; translation]: J_T qvel times 1 s reaches the target to first order.

    Args:
        model: Any model.
        data: State of the model; frames in it are brought up to date.
        site: Tasks, as for :func:`jacobians`.
        target: One target per task: a pose as of :func:`pose_of`, a homogeneous matrix (4, 4), a
            pair of a position (3,) and a quaternion (w, x, y, z), or a `RigidTransform` of scipy;
            or a position (3,) alone, which keeps the present rotation.
        axes: Site whose axes express rows and targets, as for :func:`jacobians`; it must not move.
    """
    seen_from, tasks = _motions(model, data, site, axes)
    targets: Any = target if isinstance(site, list | tuple) else [target]
    if not isinstance(targets, list | tuple | np.ndarray) or len(targets) != len(tasks):
        raise ValueError(f"target must be a list of {len(tasks)}, got {check.short_repr(target)}")
    displacements = []
    for task, given in zip(tasks, targets, strict=True):
        displacements.append(task.displacement_to(data, target_pose("target", given), seen_from))
    return np.concatenate(displacements)


def _motions(
    model: mujoco.MjModel, data: mujoco.MjData, site: Task | Sequence[Task], axes: str | None
) -> tuple[Located | None, list[Motion]]:
    """Look up axes and tasks, which must be frames or centres of mass, and update a state."""
    check_state(model, data)
    in_axes = located_axes(model, axes)
    motions = list[Motion]()
    for task, rows in located_tasks(model, site, in_axes).items():
        if not isinstance(rows, Motion):
            raise TypeError(
                f"site must be a frame or a centre of mass, got {check.short_repr(task)}"
            )
        motions.append(rows)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    return in_axes, motions
