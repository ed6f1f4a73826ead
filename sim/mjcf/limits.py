"""Limits of motion besides loops: joints and tendons at their limits, and contacts."""

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
"""A joint nearer to its limit than this fraction of its range rests on it."""


class Coupled(NamedTuple):
    """Lengths of tendons and angles of ball joints that are limited, which several velocities move.

    Rows are, in this order, of the least lengths, the greatest lengths, and the largest angles.

    Attributes:
        model: Whose they are.
        tendons: Numbers, (t,).
        span: Least and greatest length of each, infinite where there is none, (2, t).
        balls: Numbers of joints.
        velocity: Largest rate of the quantity of each row, (r,).
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
        """Collect those of a model, but for some tendons.

        `velocity` is the largest rate of each tendon's length, infinite where there is none;
        `stated` says whether the ranges that the model states count.
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

    def room(self, data: mujoco.MjData) -> Array:
        """Distance from each limit at a state that is up to date, (r,)."""
        (low, high), length = self.span, data.ten_length[self.tendons]
        angles = [_ball(self.model, data, k)[0] for k in self.balls]
        largest = self.model.jnt_range[self.balls, 1]
        return np.concatenate([length - low, high - length, largest - angles])

    def rows(self, data: mujoco.MjData) -> Array:
        """Slopes of these distances, (r, nv)."""
        grows = [tendon_row(self.model, data, k) for k in self.tendons]
        turns = [_ball(self.model, data, k)[1] for k in self.balls]
        return np.reshape([*grows, *(-row for row in (*grows, *turns))], (-1, self.model.nv))


class Resting(NamedTuple):
    """A joint or tendon that rests on a limit, and the row (nv,) of its velocity."""

    kind: str
    name: str
    row: Array


def at_limits(model: mujoco.MjModel, data: mujoco.MjData) -> list[Resting]:
    """List joints and tendons that rest on a limit, or are beyond it.

    They rest where MuJoCo begins to push back, at the limit's margin; nothing does where flags
    switch limits off.
    """
    if model.opt.disableflags & _OFF:
        return []
    resting = _at_ends(data.qpos[model.jnt_qposadr], model.jnt_range, model.jnt_margin).any(axis=0)
    limited = model.jnt_limited.astype(bool) & one_axis(model)
    found = [
        Resting("joint", name_of(model.joint(k)), np.eye(model.nv)[model.jnt_dofadr[k]])
        for k in np.flatnonzero(limited & resting)
    ]
    for k in _limited_balls(model):
        angle, row = _ball(model, data, k)
        if angle and _at_ends(angle, model.jnt_range[k], model.jnt_margin[k])[1]:
            found.append(Resting("joint", name_of(model.joint(k)), row))
    resting = _at_ends(data.ten_length, model.tendon_range, model.tendon_margin).any(axis=0)
    for k in np.flatnonzero(model.tendon_limited.astype(bool) & resting):
        found.append(Resting("tendon", name_of(model.tendon(k)), tendon_row(model, data, k)))
    return found


def _at_ends(value: ArrayLike, span: Array, margin: Array) -> Array:
    """Whether values (...) rest on the least, and on the greatest of their limits, (2, ...)."""
    low, high = span.T
    slack = margin + _AT * (high - low)
    return np.array([np.less_equal(value, low + slack), np.greater_equal(value, high - slack)])


def _limited_balls(model: mujoco.MjModel) -> Indices:
    is_ball = model.jnt_type == int(mujoco.mjtJoint.mjJNT_BALL)
    return np.flatnonzero(model.jnt_limited.astype(bool) & is_ball)


def stuck_names(argument: str, stuck: bool | Iterable[str]) -> bool | tuple[str, ...]:
    """Check an argument that is true for all, false for none, or the names of some."""
    return stuck if isinstance(stuck, bool) else check.members(argument, stuck, str)


def stuck_rows(model: mujoco.MjModel, data: mujoco.MjData, stuck: bool | tuple[str, ...]) -> Array:
    """Velocities (p, nv) forbidden by the limits on which joints and tendons rest.

    `stuck` is true for all that rest on one, or has the names of some; `data` is up to date.

    Raises:
        ModelError: One of these names rests on no limit.
    """
    resting = at_limits(model, data)
    if not isinstance(stuck, bool):
        names = [limit.name for limit in resting]
        for name in (each for each in stuck if each not in names):
            raise ModelError(f'"{name}" rests on no limit; those that do: {listed(names)}')
        resting = [limit for limit in resting if limit.name in stuck]
    return np.vstack([np.zeros((0, model.nv)), *(limit.row for limit in resting)])


def _ball(model: mujoco.MjModel, data: mujoco.MjData, joint: SupportsIndex) -> tuple[float, Array]:
    """Angle of a ball joint, and its slope (nv,); zero where it is not turned."""
    row, vector = np.zeros(model.nv), np.empty(3)
    place, start = model.jnt_qposadr[joint], model.jnt_dofadr[joint]
    mujoco.mju_quat2Vel(vector, data.qpos[place : place + 4], 1.0)
    angle = float(np.linalg.norm(vector))
    row[start : start + 3] = vector / (angle or 1.0)
    return angle, row


def tendon_row(model: mujoco.MjModel, data: mujoco.MjData, tendon: SupportsIndex) -> Array:
    """Slope (nv,) of the length of a tendon."""
    row, start = np.zeros(model.nv), model.ten_J_rowadr[tendon]
    entries = slice(start, start + model.ten_J_rownnz[tendon])
    row[model.ten_J_colind[entries]] = data.ten_J[entries]
    return row


def touching(model: mujoco.MjModel, data: mujoco.MjData) -> frozenset[tuple[int, int]]:
    """Pairs of bodies that push each other; what touches a flex, which is no body, is left out."""
    if not data.ncon:
        return frozenset()
    contacts = data.contact
    geoms = contacts.geom[(contacts.exclude == 0) & (contacts.geom >= 0).all(axis=1)]
    return frozenset(map(tuple, np.sort(model.geom_bodyid[geoms], axis=1).tolist()))
