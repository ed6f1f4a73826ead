"""Tasks: what of a mechanism is to move, its Jacobian, its pose and the way to a target."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol, TypeAlias, runtime_checkable

import mujoco
import numpy as np

import argument_checks as check
from sim.array import Array
from sim.kinematics.pose import Pose
from sim.kinematics.target import Target, target_pose
from sim.mjcf.frame import Body, Located, frame_pose, located, rotation_vector
from sim.mjcf.model import check_state, element_id


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
        root: The same; motion that both share is none.
    """

    frame: str | Body
    root: str | Body

    def __post_init__(self) -> None:
        """Check the arguments."""
        check.instance("frame", self.frame, str, Body)
        check.instance("root", self.root, str, Body)


class LocatedRows(Protocol):
    """Rows of J_T, once their names are looked up in a model.

    Attributes:
        frames: Whose motion they are made of.
        angular: Whether each row is an angular velocity, shape (k,); otherwise a linear one.
    """

    @property
    def frames(self) -> tuple[Located, ...]:
        """See above."""
        ...

    @property
    def angular(self) -> tuple[bool, ...]:
        """See above."""
        ...

    def jacobian(self, model: mujoco.MjModel, data: mujoco.MjData) -> Array:
        """The rows in world axes per qvel, shape (k, nv); `data` is up to date."""
        ...


class WritesRows(LocatedRows, Protocol):
    """The same without an array in between, for every tick."""

    def write_jacobian(self, model: mujoco.MjModel, data: mujoco.MjData, out: Array) -> None:
        """Overwrite an array (k, nv) by the rows."""
        ...


def new_rows(located: WritesRows, model: mujoco.MjModel, data: mujoco.MjData) -> Array:
    """The rows in an array of their own, shape (k, nv)."""
    located.write_jacobian(model, data, rows := np.empty((len(located.angular), model.nv)))
    return rows


@runtime_checkable
class HasRows(Protocol):
    """What has rows in any model, such as a :class:`sim.TaskFunction`."""

    def on(self, model: mujoco.MjModel) -> LocatedRows:
        """The rows in one model."""
        ...


Task: TypeAlias = str | Body | CenterOfMass | Relative | HasRows
"""A site by name, the frame of a body, a centre of mass, one frame relative to another, or rows."""


def task_list(model: mujoco.MjModel, site: Task | Sequence[Task]) -> list[Task]:
    """The tasks of an argument `site`, all of which the model has.

    Raises:
        ModelError: A frame or body that does not exist.
        ValueError: No task, or one twice.
        TypeError: Something of another kind.
    """
    tasks: list[Task] = list(site) if isinstance(site, list | tuple) else [site]  # type: ignore[list-item]
    if not tasks:
        raise ValueError("site must name a task at least, got none")
    for task in tasks:
        located_task(model, task)
    if len(set(tasks)) < len(tasks):
        raise ValueError(f"site must not repeat a task, got {check.shown(tasks)}")
    return tasks


class LocatedFrame(NamedTuple):
    """The twist of a frame, by its number.

    Attributes:
        frame: The frame that moves.
        root: The frame that it is seen from; None is the world.
    """

    frame: Located
    root: Located | None = None

    @property
    def frames(self) -> tuple[Located, ...]:
        """The one or both."""
        return (self.frame,) if self.root is None else (self.frame, self.root)

    @property
    def angular(self) -> tuple[bool, ...]:
        """The first three."""
        return (True,) * 3 + (False,) * 3

    def jacobian(self, model: mujoco.MjModel, data: mujoco.MjData) -> Array:
        """Its twist in world axes per qvel, shape (6, nv)."""
        return new_rows(self, model, data)

    def write_jacobian(self, model: mujoco.MjModel, data: mujoco.MjData, out: Array) -> None:
        """Overwrite an array (6, nv) by it; without a root, one (3, nv) by its linear rows."""
        self.frame.write_jacobian(model, data, out)
        if self.root is not None:
            root = self.root.jacobian(model, data)
            out -= root
            x, y, z = self.frame.position_m(data) - self.root.position_m(data)
            out[3] -= root[1] * z - root[2] * y
            out[4] -= root[2] * x - root[0] * z
            out[5] -= root[0] * y - root[1] * x


class LocatedCenter(NamedTuple):
    """The velocity of a centre of mass.

    Attributes:
        body: With all that it carries.
        frames: Of all these bodies: the centre may be anywhere among them.
    """

    body: int
    frames: tuple[Located, ...]

    @property
    def angular(self) -> tuple[bool, ...]:
        """None."""
        return (False,) * 3

    def jacobian(self, model: mujoco.MjModel, data: mujoco.MjData) -> Array:
        """Its velocity in world axes per qvel, shape (3, nv)."""
        return new_rows(self, model, data)

    def write_jacobian(self, model: mujoco.MjModel, data: mujoco.MjData, out: Array) -> None:
        """Overwrite an array (3, nv) by it."""
        mujoco.mj_jacSubtreeCom(model, data, out, self.body)


def located_task(model: mujoco.MjModel, task: Task) -> LocatedRows:
    """The task, looked up by its names.

    Raises:
        ModelError: A frame or body that does not exist.
        TypeError: A name that is none.
    """
    if isinstance(task, CenterOfMass):
        return located_center(model, task)
    if isinstance(task, Relative):
        return LocatedFrame(located(model, "site", task.frame), located(model, "site", task.root))
    if isinstance(task, HasRows):
        return task.on(model)
    return LocatedFrame(located(model, "site", task))


def located_center(model: mujoco.MjModel, task: CenterOfMass) -> LocatedCenter:
    """The centre of mass, looked up by the name of its body."""
    check.instance("model", model, mujoco.MjModel)
    within = [_com_body(model, task)]
    for body, above in enumerate(model.body_parentid.tolist()):  # parents come first
        if body and above in within:
            within.append(body)
    bodies = tuple(Located(body, body, is_site=False) for body in within if body)
    return LocatedCenter(within[0], bodies)


def task_jacobian(model: mujoco.MjModel, data: mujoco.MjData, task: Task) -> Array:
    """:meth:`LocatedTask.jacobian` of a task by name."""
    return located_task(model, task).jacobian(model, data)


def pose_of(
    model: mujoco.MjModel, data: mujoco.MjData, site: Task, axes: str | None = None
) -> Pose:
    """Where a task is, at the present `data.qpos`; frames in `data` are brought up to date.

    Args:
        model: Any model.
        data: Its state.
        site: One task, as for :func:`jacobians`. The rotation of a centre of mass is the identity.
        axes: Site in whose frame; None is the world's. A :class:`Relative` is seen from its root.

    Raises:
        ModelError, ValueError, TypeError: As :func:`jacobians`.
    """
    check_state(model, data)
    (task,) = task_list(model, [site])
    if isinstance(task, HasRows):
        raise TypeError(f"site must be a frame or a centre of mass, got {check.shown(task)}")
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    if isinstance(task, CenterOfMass):
        rotation, position = np.eye(3), data.subtree_com[_com_body(model, task)].copy()
    else:
        rotation, position = frame_pose(data, task.frame if isinstance(task, Relative) else task)
    turned, origin = np.eye(3), np.zeros(3)
    if isinstance(task, Relative):
        turned, origin = frame_pose(data, task.root)
    elif axes is not None:
        frame = located_axes(model, axes)
        turned, origin = frame.rotation(data), frame.position_m(data)
    if not isinstance(task, CenterOfMass):
        rotation = turned.T @ rotation
    return Pose(rotation, turned.T @ (position - origin))


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

    Raises:
        ValueError: Not one target for each task, or one that is no pose or position.
        ModelError, TypeError: As :func:`jacobians`.
    """
    tasks = task_list(model, site)
    targets: Any = target if isinstance(site, list | tuple) else [target]
    if not isinstance(targets, list | tuple | np.ndarray) or len(targets) != len(tasks):
        raise ValueError(f"target must be a list of {len(tasks)}, got {check.shown(target)}")
    errors = []
    for task, goal in zip(tasks, targets, strict=True):
        here = pose_of(model, data, task, axes)
        there = target_pose("target", goal)
        if not isinstance(there, Pose):
            there = Pose(here.rotation, there)
        turn = rotation_vector(there.rotation @ here.rotation.T)
        shift = there.translation_m - here.translation_m
        if isinstance(task, Relative):
            to_axes = to_axes_of(model, data, axes) @ frame_pose(data, task.root)[0]
            turn, shift = to_axes @ turn, to_axes @ shift
        errors.append(shift if isinstance(task, CenterOfMass) else np.concatenate([turn, shift]))
    return np.concatenate(errors)


def to_axes_of(model: mujoco.MjModel, data: mujoco.MjData, axes: str | None) -> Array:
    """Rotation (3, 3) from world axes to those of a site; None is the world."""
    return np.eye(3) if axes is None else located_axes(model, axes).rotation(data).T


def located_axes(model: mujoco.MjModel, axes: str) -> Located:
    """The site that gives the axes, looked up by its name."""
    return located(model, "axes", check.instance("axes", axes, str))


def _com_body(model: mujoco.MjModel, task: CenterOfMass) -> int:
    if task.body is None:
        return 0
    return element_id(model, "body", task.body)
