"""What limits motion besides loops: joints and tendons at their limits, and contacts."""

from collections.abc import Iterable
from typing import NamedTuple

import mujoco
import numpy as np

import argument_checks as check
from sim.array import Array
from sim.errors import ModelError
from sim.mjcf.model import name_of
from sim.mjcf.ranges import one_axis

_BALL = int(mujoco.mjtJoint.mjJNT_BALL)
_WITHOUT_LIMITS = int(mujoco.mjtDisableBit.mjDSBL_LIMIT) | int(
    mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
)
_AT = 1e-6
"""A joint nearer to its limit than this fraction of its range rests on it."""


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
        vector, start = np.empty(3), model.jnt_qposadr[k]
        mujoco.mju_quat2Vel(vector, data.qpos[start : start + 4], 1.0)
        angle = float(np.linalg.norm(vector))
        if angle >= high[k] - slack[k] and angle:
            row = np.zeros(model.nv)
            row[model.jnt_dofadr[k] : model.jnt_dofadr[k] + 3] = vector / angle
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
