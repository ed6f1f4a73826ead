"""Joints: a posture, damping, and couplings of joints."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

import argument_checks as check
from sim.array import Array
from sim.errors import ModelError
from sim.kinematics.task import new_rows
from sim.mjcf.frame import Located
from sim.mjcf.model import element_id
from sim.mjcf.ranges import joint_positions, one_axis, turning
from sim.tasks.function import TaskFunction

_FREE = int(mujoco.mjtJoint.mjJNT_FREE)


def _names(name: str, value: Iterable[str] | None) -> tuple[str, ...] | None:
    return None if value is None else check.members(name, value, str)


def _factors(name: str, value: Mapping[str, float]) -> Mapping[str, float]:
    given = check.instance(name, value, Mapping)
    factors = {each: check.signed(name, given[each]) for each in check.members(name, given, str)}
    if not any(factors.values()):
        raise ValueError(f"{name} must name a joint at least, with a factor, got none")
    return factors


@dataclass(eq=False)
class PostureTask(TaskFunction):
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

    _checks: ClassVar = {"joints": _names}

    joints: Iterable[str] | None = field(default=None, kw_only=True)

    def checked(self, target: Any) -> Array:
        """Positions (nq,)."""
        return check.frozen(check.series("target", target))

    def on(self, model: mujoco.MjModel) -> "LocatedRates":
        """As :meth:`TaskFunction.on`."""
        return _rates(self, model, free=False)


@dataclass(eq=False)
class DampingTask(TaskFunction):
    """Joints are to rest: what no level before it asks for is as little motion as can be.

    A level of its own. Whatever comes after it has nothing left to move these joints with.

    Attributes:
        joints: Names of the joints; None is all, free ones too.
        weight: As of :class:`PostureTask`.

    A gain and damping have no effect, and a target is refused. Other errors are those of
    :class:`TaskFunction`.
    """

    _checks: ClassVar = {"joints": _names}

    joints: Iterable[str] | None = field(default=None, kw_only=True)

    def checked(self, target: Any) -> Any:
        """None: the target is to rest."""
        raise ValueError(f"target must be None, which is to rest, got {check.shown(target)}")

    def on(self, model: mujoco.MjModel) -> "LocatedRates":
        """As :meth:`TaskFunction.on`."""
        return _rates(self, model, free=True)


class LocatedRates(NamedTuple):
    """A task on rates in one model.

    Attributes:
        task: What is asked for.
        velocities: Which, shape (k,).
        angular: Whether each of them turns.
        frames: None: rates are rates at any pose.
    """

    task: PostureTask | DampingTask
    velocities: NDArray[np.intp]
    angular: tuple[bool, ...]
    frames: tuple[Located, ...] = ()

    def jacobian(self, model: mujoco.MjModel, data: mujoco.MjData) -> Array:
        """Rows of the identity, shape (k, nv)."""
        return new_rows(self, model, data)

    def write_jacobian(self, model: mujoco.MjModel, data: mujoco.MjData, out: Array) -> None:
        """Overwrite an array (k, nv) by them."""
        out[:] = 0.0
        out[np.arange(len(out)), self.velocities] = 1.0

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

    Further attributes are those of :class:`TaskFunction`.

    Raises:
        ValueError: No joint, or only factors of zero; or as :class:`TaskFunction`.
        TypeError: An argument is of another kind.
    """

    _checks: ClassVar = {"coefficients": _factors}

    coefficients: Mapping[str, float]
    target: float = field(default=0.0, kw_only=True, repr=False)

    def checked(self, target: Any) -> float:
        """A number."""
        return check.signed("target", target)

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
        return LocatedCoupling(self, row, frames, (bool(turning(model)[used[0]]),))


class LocatedCoupling(NamedTuple):
    """The same in one model.

    Attributes:
        task: What is asked for.
        row: Factor of each velocity, shape (nv,).
        frames: Of the bodies that these joints move.
        angular: Whether the first of the joints turns.
    """

    task: JointCouplingTask
    row: Array
    frames: tuple[Located, ...]
    angular: tuple[bool, ...]

    def jacobian(self, model: mujoco.MjModel, data: mujoco.MjData) -> Array:
        """The row, shape (1, nv)."""
        return new_rows(self, model, data)

    def write_jacobian(self, model: mujoco.MjModel, data: mujoco.MjData, out: Array) -> None:
        """Overwrite an array (1, nv) by it."""
        out[0] = self.row

    def error(self, model: mujoco.MjModel, data: mujoco.MjData) -> Array:
        """What the sum lacks to its target, shape (1,)."""
        return np.array([self.task.needed() - self.row @ joint_positions(model, data.qpos)])


def _rates(task: PostureTask | DampingTask, model: mujoco.MjModel, *, free: bool) -> LocatedRates:
    """Of its joints; where it names none of all, of free ones too where they count."""
    check.instance("model", model, mujoco.MjModel)
    if task.joints is None:
        among = free | (model.jnt_type != _FREE)
    else:
        among = np.zeros(model.njnt, dtype=bool)
        among[[element_id(model, "joint", name) for name in task.joints]] = True
    velocities = np.flatnonzero(among[model.dof_jntid])
    return LocatedRates(task, velocities, tuple(turning(model)[velocities].tolist()))
