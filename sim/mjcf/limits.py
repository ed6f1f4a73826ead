"""Limits of motion other than closed loops: joint and tendon limits, and contacts."""

from collections.abc import Collection, Iterable
from typing import NamedTuple, SupportsIndex

import mujoco
import numpy as np
from numpy.typing import ArrayLike

import argument_checks as check
from argument_checks import Indices
from sim.array import Array
from sim.errors import ModelError
from sim.mjcf.joints import one_axis, within
from sim.mjcf.model import joint_name, listed, name_of

_OFF = mujoco.mjtDisableBit.mjDSBL_LIMIT | mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
_AT = 1e-6
"""Fraction of its range within which a joint counts as resting on its limit."""


class Coupled(NamedTuple):
    """Limits of tendon lengths and ball-joint angles, which depend on several velocities.

    The r rows are, in this order, the least lengths, the greatest lengths and the largest angles.

    Attributes:
        model: The model that has these limits.
        tendons: Numbers of the tendons, (t,).
        span: Least and greatest length of each tendon, infinite where there is none, (2, t).
        balls: Numbers of the ball joints.
        velocity: Largest rate of the limited quantity of each row, (r,).
        names: Tendon or joint of each row.
    """

    model: mujoco.MjModel
    tendons: Indices
    span: Array
    balls: Indices
    velocity: Array
    names: tuple[str, ...]

    @classmethod
    def of(
        cls, model: mujoco.MjModel, but: Collection[int], velocity: Array, *, stated: bool
    ) -> "Coupled":
        """Collect the limits of a model, without the tendons `but`.

        `velocity` is the largest rate of each tendon's length, infinite where there is none;
        with `stated` the ranges in the model are included.
        """
        limited = model.tendon_limited.astype(bool) & stated
        tendons = np.flatnonzero(limited | np.isfinite(velocity))
        tendons = tendons[~np.isin(tendons, list(but))]
        span = within(limited[tendons], model.tendon_range[tendons]).T
        balls = _limited_balls(model) if stated else np.zeros(0, dtype=np.intp)
        names = [f"tendon {name_of(model.tendon(k))}" for k in tendons]
        rates = np.append(np.tile(velocity[tendons], 2), np.full(len(balls), np.inf))
        of_balls = [f"joint {joint_name(model, int(k))}" for k in balls]
        return cls(model, tendons, span, balls, rates, (*names, *names, *of_balls))

    def slack(self, data: mujoco.MjData) -> Array:
        """Return the distance from each limit, (r,), in a state that is up to date."""
        (low, high), length = self.span, data.ten_length[self.tendons]
        angles = [_ball(self.model, data, k)[0] for k in self.balls]
        largest = self.model.jnt_range[self.balls, 1]
        return np.concatenate([length - low, high - length, largest - angles])

    def rows(self, data: mujoco.MjData) -> Array:
        """Return the gradients (r, nv) of :meth:`slack`."""
        grows = [tendon_row(self.model, data, k) for k in self.tendons]
        turns = [_ball(self.model, data, k)[1] for k in self.balls]
        return np.reshape([*grows, *(-row for row in (*grows, *turns))], (-1, self.model.nv))


class Resting(NamedTuple):
    """Joint or tendon that rests on a limit, with the row (nv,) of its velocity."""

    kind: str
    name: str
    row: Array


def at_limits(model: mujoco.MjModel, data: mujoco.MjData) -> list[Resting]:
    """List joints and tendons that rest on a limit, or are beyond it.

    They rest where MuJoCo starts to push back, at the limit's margin. The list is empty if flags
    switch limits off.
    """
    if model.opt.disableflags & _OFF:
        return []
    resting = _at_ends(data.qpos[model.jnt_qposadr], model.jnt_range, model.jnt_margin).any(axis=0)
    limited = model.jnt_limited.astype(bool) & one_axis(model)
    touched = [
        Resting("joint", name_of(model.joint(k)), np.eye(model.nv)[model.jnt_dofadr[k]])
        for k in np.flatnonzero(limited & resting)
    ]
    for k in _limited_balls(model):
        angle, row = _ball(model, data, k)
        if angle and _at_ends(angle, model.jnt_range[k], model.jnt_margin[k])[1]:
            touched.append(Resting("joint", name_of(model.joint(k)), row))
    resting = _at_ends(data.ten_length, model.tendon_range, model.tendon_margin).any(axis=0)
    for k in np.flatnonzero(model.tendon_limited.astype(bool) & resting):
        touched.append(Resting("tendon", name_of(model.tendon(k)), tendon_row(model, data, k)))
    return touched


def _at_ends(value: ArrayLike, span: Array, margin: Array) -> Array:
    """Return whether values (...) rest on their lower and on their upper limit, (2, ...)."""
    low, high = span.T
    slack = margin + _AT * (high - low)
    return np.array([np.less_equal(value, low + slack), np.greater_equal(value, high - slack)])


def _limited_balls(model: mujoco.MjModel) -> Indices:
    is_ball = model.jnt_type == int(mujoco.mjtJoint.mjJNT_BALL)
    return np.flatnonzero(model.jnt_limited.astype(bool) & is_ball)


def stuck_names(argument: str, stuck: bool | Iterable[str]) -> bool | tuple[str, ...]:
    """Check an argument that is True (all), False (none), or some names."""
    return stuck if isinstance(stuck, bool) else check.members(argument, stuck, str)


def stuck_rows(model: mujoco.MjModel, data: mujoco.MjData, stuck: bool | tuple[str, ...]) -> Array:
    """Return the rows (p, nv) of velocities that are zero because an element rests on its limit.

    `stuck` is True for all joints and tendons on a limit, or names some, which must rest on one.
    """
    resting = at_limits(model, data)
    if not isinstance(stuck, bool):
        names = [limit.name for limit in resting]
        for name in (chosen for chosen in stuck if chosen not in names):
            raise ModelError(f'"{name}" rests on no limit; those that do: {listed(names)}')
        resting = [limit for limit in resting if limit.name in stuck]
    return np.vstack([np.zeros((0, model.nv)), *(limit.row for limit in resting)])


def _ball(model: mujoco.MjModel, data: mujoco.MjData, joint: SupportsIndex) -> tuple[float, Array]:
    """Return the angle [rad] of a ball joint and its gradient (nv,); zeros if it is not turned."""
    row, vector = np.zeros(model.nv), np.empty(3)
    place, start = model.jnt_qposadr[joint], model.jnt_dofadr[joint]
    mujoco.mju_quat2Vel(vector, data.qpos[place : place + 4], 1.0)
    angle = float(np.linalg.norm(vector))
    row[start : start + 3] = vector / (angle or 1.0)
    return angle, row


def tendon_row(model: mujoco.MjModel, data: mujoco.MjData, tendon: SupportsIndex) -> Array:
    """Return the gradient (nv,) of the length of a tendon."""
    row, start = np.zeros(model.nv), model.ten_J_rowadr[tendon]
    entries = slice(start, start + model.ten_J_rownnz[tendon])
    row[model.ten_J_colind[entries]] = data.ten_J[entries]
    return row


def touching(model: mujoco.MjModel, data: mujoco.MjData) -> frozenset[tuple[int, int]]:
    """Return the pairs of bodies in contact; contacts with a flex are left out."""
    if not data.ncon:
        return frozenset()
    contacts = data.contact
    geoms = contacts.geom[(contacts.exclude == 0) & (contacts.geom >= 0).all(axis=1)]
    return frozenset(map(tuple, np.sort(model.geom_bodyid[geoms], axis=1).tolist()))
