"""Tasks: what of a mechanism is to move, its rows of J_T, its pose and the way to a target."""

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
from sim.kinematics.pose import NOMINAL, Pose, Target, target_pose, way_between
from sim.mjcf.frame import Body, Located, located
from sim.mjcf.model import check_state, element_id

TWIST, LINEAR = tuple(range(6)), tuple(range(3, 6))
_AS_WRITTEN = TWIST, LINEAR
"""Rows that MuJoCo writes as they are."""


@dataclass(frozen=True)
class CenterOfMass:
    """The centre of mass of the whole model, or of a body with all that it carries: three rows.

    Attributes:
        body: Name of that body; None is everything.
    """

    body: str | None = None

    def __post_init__(self) -> None:
        """Check the argument."""
        if self.body is not None:
            check.instance("body", self.body, str)


@dataclass(frozen=True)
class Relative:
    """A frame as seen from another one, which may move too: six rows.

    Attributes:
        frame: Name of a site or else of a body, or a :class:`Body`.
        root: Likewise; motion that both share is none.
    """

    frame: str | Body
    root: str | Body

    def __post_init__(self) -> None:
        """Check the arguments."""
        check.instance("frame", self.frame, str, Body)
        check.instance("root", self.root, str, Body)


class LocatedFunction(Protocol):
    """A task, once its names are looked up in a model: rows of J_T, and the way to a target."""

    @property
    def frames(self) -> tuple[Located, ...]:
        """Frames whose motion the rows are made of."""
        ...

    @property
    def angular(self) -> tuple[bool, ...]:
        """Whether each row is an angular velocity, shape (k,); otherwise a linear one."""
        ...

    def jacobian(self, model: mujoco.MjModel, data: mujoco.MjData) -> Array:
        """The rows per qvel, shape (k, nv).

        `data` is up to date: positions of frames and centres of mass belong to its `qpos`.
        """
        ...

    def error(self, model: mujoco.MjModel, data: mujoco.MjData) -> Array:
        """The way to the target, (k,): J qvel times a second leads there to first order.

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
        raise ValueError(f"{name} must be one number or (k,), got {check.short_repr(value)}")
    return weight


_CHECKS: dict[str, Callable[[str, Any], Any]] = {
    "gain": lambda name, value: check.number(name, value, 0.0, 1.0),
    "weight": _weight,
    "damping": lambda name, value: None if value is None else check.number(name, value, 0.0),
}


Task: TypeAlias = str | Body | CenterOfMass | Relative | TaskFunction
"""A site by name, the frame of a body, a centre of mass, one frame relative to another, or rows."""


class MassCenter(NamedTuple):
    """The centre of mass of a body and of all that it carries, as a frame with the world's axes.

    It may be anywhere among the frames, which are those of all these bodies.
    """

    body: int
    frames: tuple[Located, ...]

    def rotation(self, _: mujoco.MjData) -> Array:
        """Axes of the world, (3, 3)."""
        return NOMINAL.rotation

    def position_m(self, data: mujoco.MjData) -> Array:
        """Where it is in the world, (3,): a view."""
        return data.subtree_com[self.body]

    def write_jacobian(self, model: mujoco.MjModel, data: mujoco.MjData, out: Array) -> None:
        """Overwrite an array (3, nv) by its velocity in world axes per qvel."""
        mujoco.mj_jacSubtreeCom(model, data, out, self.body)

    def jacobian(self, model: mujoco.MjModel, data: mujoco.MjData) -> Array:
        """Its twist in world axes per qvel, of which it turns never, shape (6, nv)."""
        self.write_jacobian(model, data, (twist := np.zeros((6, model.nv)))[3:])
        return twist


@dataclass(frozen=True, eq=False)
class Motion:
    """Rows of the twist [angular; linear] of a frame or centre of mass, and the way to a target.

    A :class:`LocatedFunction` that writes its rows into J_T at every tick.

    Attributes:
        frame: What moves.
        root: The frame that it is seen from; None is the world.
        axes: Of the rows; None is the world.
        rows: Which of the six.
        target: Gives the target of a task function, and raises where there is none yet.
    """

    frame: Located | MassCenter
    root: Located | None = None
    axes: Located | None = None
    rows: tuple[int, ...] = TWIST
    target: Callable[[], Any] | None = None

    @property
    def frames(self) -> tuple[Located, ...]:
        """See :class:`LocatedFunction`."""
        frames = self.frame.frames if isinstance(self.frame, MassCenter) else (self.frame,)
        return frames if self.root is None else (*frames, self.root)

    @property
    def angular(self) -> tuple[bool, ...]:
        """See :class:`LocatedFunction`."""
        return tuple(row < 3 for row in self.rows)

    @cached_property
    def _index(self) -> NDArray[np.intp]:
        return np.array(self.rows)

    def jacobian(self, model: mujoco.MjModel, data: mujoco.MjData) -> Array:
        """The rows per qvel, shape (k, nv); `data` is up to date."""
        self.write_jacobian(model, data, rows := np.empty((len(self.rows), model.nv)))
        return rows

    def write_jacobian(self, model: mujoco.MjModel, data: mujoco.MjData, out: Array) -> None:
        """Overwrite an array (k, nv) by the rows."""
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
        twist.take(self._index, axis=0, out=out, mode="clip")  # which needs no buffer

    def error(self, model: mujoco.MjModel, data: mujoco.MjData) -> Array:
        """[rotation vector; translation] to the target, its rows, shape (k,)."""
        assert self.target is not None
        return self.way(data, self.target())

    def way(
        self, data: mujoco.MjData, target: Pose | Array, seen_from: Located | None = None
    ) -> Array:
        """[rotation vector; translation] to a target, its rows, shape (k,).

        A position (3,) leaves the rotation as it is. Targets are seen from the root, or else from
        another frame; None is the world.
        """
        rotation, position_m = self.frame.rotation(data), self.frame.position_m(data)
        is_pose, seen_from = isinstance(target, Pose), self.root or seen_from
        there = target.rotation if isinstance(target, Pose) else rotation
        goal = target.translation_m if isinstance(target, Pose) else target
        if seen_from is not None:
            outer = seen_from.rotation(data)
            goal = seen_from.position_m(data) + outer @ goal
            there = outer @ there if is_pose else there
        way = way_between(rotation, position_m, there, goal)
        if not is_pose:
            way[:3] = 0.0  # but for round-off
        if self.axes is not None:
            way = (way.reshape(2, 3) @ self.axes.rotation(data)).ravel()
        return way[self._index]


def mass_center(model: mujoco.MjModel, body: str | None) -> MassCenter:
    """The centre of mass of a body by name with all that it carries; None is everything."""
    check.instance("model", model, mujoco.MjModel)
    within = carried_bodies(model, 0 if body is None else element_id(model, "body", body))
    return MassCenter(within[0], tuple(Located(k, k, is_site=False) for k in within if k))


def carried_bodies(model: mujoco.MjModel, body: int) -> list[int]:
    """Numbers of a body and of all bodies that hang from it, ascending."""
    carried = [body]
    for k in range(body + 1, model.nbody):  # parents come before their children
        if model.body_parentid[k] in carried:
            carried.append(k)
    return carried


def located_task(model: mujoco.MjModel, task: Task, axes: Located | None = None) -> LocatedFunction:
    """The task, looked up by its names; rows are in these axes, but those of task functions."""
    if isinstance(task, CenterOfMass):
        return Motion(mass_center(model, task.body), None, axes, LINEAR)
    if isinstance(task, Relative):
        frame, root = (located(model, "site", each) for each in (task.frame, task.root))
        return Motion(frame, root, axes)
    if isinstance(task, TaskFunction):
        return task.on(model)
    return Motion(located(model, "site", task), axes=axes)


def located_tasks(
    model: mujoco.MjModel, site: Task | Sequence[Task], axes: Located | None = None
) -> dict[Task, LocatedFunction]:
    """The tasks of an argument `site`, one at least, each looked up; see :func:`located_task`."""
    tasks: Any = list(site) if isinstance(site, list | tuple) else [site]
    if not tasks:
        raise ValueError("site must name a task at least, got none")
    found = {task: located_task(model, task, axes) for task in tasks}
    if len(found) < len(tasks):
        raise ValueError(f"site must not repeat a task, got {check.short_repr(tasks)}")
    return found


def located_axes(model: mujoco.MjModel, axes: str | None) -> Located | None:
    """The site that gives the axes, looked up by its name; None is the world."""
    return None if axes is None else located(model, "axes", check.instance("axes", axes, str))


def pose_of(
    model: mujoco.MjModel, data: mujoco.MjData, site: Task, axes: str | None = None
) -> Pose:
    """Where a task is, at the present `data.qpos`; frames in `data` are brought up to date.

    Args:
        model: Any model.
        data: Its state.
        site: One task, as for :func:`jacobians`. The rotation of a centre of mass is the identity.
        axes: Site in whose frame; None is the world's. A :class:`Relative` is seen from its root.
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
    """The displacement from where tasks are to their targets, in the rows of `jacobians`.

    [rotation vector; translation], so that J_T qvel times a second leads there to first order.

    Args:
        model: Any model.
        data: Its state; frames in it are brought up to date.
        site: The tasks, as for :func:`jacobians`.
        target: For each a pose, as :func:`pose_of` gives it; or as a homogeneous matrix (4, 4), a
            pair of a position (3,) and a quaternion (w, x, y, z), or a `RigidTransform` of scipy;
            or a position (3,) alone, with the rotation as it is.
        axes: As for :func:`jacobians`; a site that does not move.
    """
    seen_from, tasks = _motions(model, data, site, axes)
    targets: Any = target if isinstance(site, list | tuple) else [target]
    if not isinstance(targets, list | tuple | np.ndarray) or len(targets) != len(tasks):
        raise ValueError(f"target must be a list of {len(tasks)}, got {check.short_repr(target)}")
    ways = []
    for task, given in zip(tasks, targets, strict=True):
        ways.append(task.way(data, target_pose("target", given), seen_from))
    return np.concatenate(ways)


def _motions(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    site: Task | Sequence[Task],
    axes: str | None,
) -> tuple[Located | None, list[Motion]]:
    """The axes, and the tasks on frames and centres of mass, in a state brought up to date."""
    check_state(model, data)
    in_axes = located_axes(model, axes)
    found = list[Motion]()
    for task, rows in located_tasks(model, site, in_axes).items():
        if not isinstance(rows, Motion):
            raise TypeError(
                f"site must be a frame or a centre of mass, got {check.short_repr(task)}"
            )
        found.append(rows)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    return in_axes, found
