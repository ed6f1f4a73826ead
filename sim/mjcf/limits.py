"""What limits motion besides loops: joints and tendons at their limits, and contacts."""

from collections.abc import Collection, Iterable
from typing import NamedTuple

import mujoco
import numpy as np

import argument_checks as check
from argument_checks import Indices
from sim.array import Array
from sim.errors import ModelError
from sim.mjcf.model import joint_name, name_of
from sim.mjcf.ranges import one_axis

_BALL = int(mujoco.mjtJoint.mjJNT_BALL)
_WITHOUT_LIMITS = int(mujoco.mjtDisableBit.mjDSBL_LIMIT) | int(
    mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
)
_AT = 1e-6
"""A joint nearer to its limit than this fraction of its range rests on it."""


class Coupled(NamedTuple):
    """Lengths of tendons and angles of ball joints that are limited, which several velocities move.

    Each has a row: a tendon one for its least and one for its greatest length, a ball one.

    Attributes:
        model: The model.
        tendons: Their numbers.
        span: Least and greatest length of each, infinite where there is none, (2, t).
        balls: Numbers of joints.
        velocity: Largest rate of what each row is of, (r,).
        names: What each row is of.
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
        """Those of a model.

        Args:
            model: The model.
            but: Tendons that are left out.
            velocity: Largest rate of each tendon's length, infinite where there is none.
            stated: Whether the ranges that the model states count.
        """
        limited = model.tendon_limited.astype(bool) & stated
        tendons = np.flatnonzero(limited | np.isfinite(velocity))
        tendons = tendons[~np.isin(tendons, list(but))]
        span = np.where(limited[tendons, None], model.tendon_range[tendons], [-np.inf, np.inf]).T
        balls = np.flatnonzero(model.jnt_limited.astype(bool) & (model.jnt_type == _BALL) & stated)
        names = [f"tendon {name_of(model.tendon(k))}" for k in tendons]
        rates = np.append(np.tile(velocity[tendons], 2), np.full(len(balls), np.inf))
        of_balls = [f"joint {joint_name(model, int(k))}" for k in balls]
        return cls(model, tendons, span, balls, rates, (*names, *names, *of_balls))

    def room(self, data: mujoco.MjData) -> Array:
        """What is left of each range at a state that is up to date, (r,)."""
        (low, high), length = self.span, data.ten_length[self.tendons]
        angles = [ball_turn(self.model, data, k)[0] for k in self.balls]
        return np.concatenate([length - low, high - length, self._largest - angles])

    def rows(self, data: mujoco.MjData) -> Array:
        """Slopes of what is left, (r, nv)."""
        of_tendons = [tendon_row(self.model, data, int(k)) for k in self.tendons]
        rows = np.zeros((len(self.names), self.model.nv))
        for k, row in enumerate(of_tendons):
            rows[k], rows[len(of_tendons) + k] = row, -row
        for row, k in zip(rows[2 * len(of_tendons) :], self.balls, strict=True):
            start = self.model.jnt_dofadr[k]
            row[start : start + 3] = -ball_turn(self.model, data, k)[1]
        return rows

    @property
    def _largest(self) -> Array:
        return self.model.jnt_range[self.balls, 1]


class Resting(NamedTuple):
    """A joint or tendon that rests on a limit, and the row (nv,) of its velocity."""

    kind: str
    name: str
    row: Array


def at_limits(model: mujoco.MjModel, data: mujoco.MjData) -> list[Resting]:
    """Joints and tendons that rest on a limit, or are beyond it; none where flags switch it off.

    They rest where MuJoCo begins to push back, at the limit's margin.
    """
    if model.opt.disableflags & _WITHOUT_LIMITS:
        return []
    limited = model.jnt_limited.astype(bool)
    q, (low, high) = data.qpos[model.jnt_qposadr], model.jnt_range.T
    slack = model.jnt_margin + _AT * (high - low)
    resting = limited & one_axis(model) & ((q <= low + slack) | (q >= high - slack))
    found = [
        Resting("joint", name_of(model.joint(k)), np.eye(model.nv)[model.jnt_dofadr[k]])
        for k in np.flatnonzero(resting)
    ]
    for k in np.flatnonzero(limited & (model.jnt_type == _BALL)):
        angle, axis = ball_turn(model, data, int(k))
        if angle >= high[k] - slack[k] and angle:
            row = np.zeros(model.nv)
            row[model.jnt_dofadr[k] : model.jnt_dofadr[k] + 3] = axis
            found.append(Resting("joint", name_of(model.joint(k)), row))
    low, high = model.tendon_range.T
    slack, length = model.tendon_margin + _AT * (high - low), data.ten_length
    resting = (length <= low + slack) | (length >= high - slack)
    for k in np.flatnonzero(model.tendon_limited.astype(bool) & resting):
        row = tendon_row(model, data, int(k))
        found.append(Resting("tendon", name_of(model.tendon(k)), row))
    return found


def stuck_names(argument: str, stuck: bool | Iterable[str]) -> bool | tuple[str, ...]:
    """All, none, or the names of some.

    Raises:
        TypeError: Something of another kind.
    """
    return stuck if isinstance(stuck, bool) else check.members(argument, stuck, str)


def stuck_rows(model: mujoco.MjModel, data: mujoco.MjData, stuck: bool | tuple[str, ...]) -> Array:
    """Velocities (p, nv) forbidden by the limits on which joints and tendons rest.

    Args:
        model: The model.
        data: Its state, up to date.
        stuck: True for all that rest on one, or the names of some.

    Raises:
        ModelError: One of these names rests on no limit.
    """
    resting = at_limits(model, data)
    if not isinstance(stuck, bool):
        names = [limit.name for limit in resting]
        for name in stuck:
            if name not in names:
                there = ", ".join(names) or "none"
                raise ModelError(f'"{name}" rests on no limit; those that do: {there}')
        resting = [limit for limit in resting if limit.name in stuck]
    return np.vstack([np.zeros((0, model.nv)), *(limit.row for limit in resting)])


def ball_turn(model: mujoco.MjModel, data: mujoco.MjData, joint: int) -> tuple[float, Array]:
    """Angle and axis of a ball joint; no axis where it is not turned."""
    vector, start = np.empty(3), model.jnt_qposadr[joint]
    mujoco.mju_quat2Vel(vector, data.qpos[start : start + 4], 1.0)
    angle = float(np.linalg.norm(vector))
    return angle, vector / angle if angle else vector


def tendon_row(model: mujoco.MjModel, data: mujoco.MjData, tendon: int) -> Array:
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
    pairs = np.sort(model.geom_bodyid[geoms], axis=1)
    return frozenset((int(a), int(b)) for a, b in pairs)
