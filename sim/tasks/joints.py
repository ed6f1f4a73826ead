"""Joints: a posture, damping, and couplings of joints."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

import mujoco
import numpy as np
from numpy.typing import NDArray

import argument_checks as check
from sim.array import Array
from sim.errors import ModelError
from sim.kinematics.task import TaskFunction
from sim.mjcf.frame import Located
from sim.mjcf.joints import joint_positions, one_axis, turning
from sim.mjcf.model import element_id

_FREE = int(mujoco.mjtJoint.mjJNT_FREE)


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
        raise ValueError(f"target must be None, which is to rest, got {check.shown(target)}")


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
