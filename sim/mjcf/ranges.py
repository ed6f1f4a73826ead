"""Ranges of joints, tendons and actuators as arrays."""

from dataclasses import dataclass

import mujoco
import numpy as np

import argument_checks as check
from sim.array import Array

_SLIDE, _HINGE, _BALL, _FREE = (
    int(kind)
    for kind in (
        mujoco.mjtJoint.mjJNT_SLIDE,
        mujoco.mjtJoint.mjJNT_HINGE,
        mujoco.mjtJoint.mjJNT_BALL,
        mujoco.mjtJoint.mjJNT_FREE,
    )
)


@dataclass(frozen=True)
class Ranges:
    """Lower and upper limits of a model, infinite where there is none; (., 2) each.

    Attributes:
        joint: Position of the slide or hinge of each velocity, (nv, 2), [m] or [rad].
        tendon: Length of each tendon, (ntendon, 2).
        control: Of each control, (nu, 2).
        force: Of each actuator's output, (nout, 2).
    """

    joint: Array
    tendon: Array
    control: Array
    force: Array

    def __post_init__(self) -> None:
        """Make the arrays read-only."""
        check.lock(self)


def ranges(model: mujoco.MjModel) -> Ranges:
    """The ranges of joints, tendons and actuators that a model states.

    Raises:
        TypeError: `model` is of another type.
    """
    check.instance("model", model, mujoco.MjModel)
    return Ranges(
        joint=_where(model.jnt_limited & one_axis(model), model.jnt_range)[model.dof_jntid],
        tendon=_where(model.tendon_limited, model.tendon_range),
        control=_where(model.actuator_ctrllimited, model.actuator_ctrlrange),
        force=_where(model.actuator_forcelimited, model.actuator_forcerange),
    )


def joint_positions(model: mujoco.MjModel, qpos: Array) -> Array:
    """Position of the slide or hinge of each velocity, shape (nv,); zero for other joints."""
    positions = np.where(one_axis(model), qpos[model.jnt_qposadr], 0.0)
    return positions[model.dof_jntid]


def one_axis(model: mujoco.MjModel) -> Array:
    """Which joints are slides or hinges, shape (njnt,)."""
    return np.isin(model.jnt_type, (_SLIDE, _HINGE))


def turning(model: mujoco.MjModel) -> Array:
    """Which velocities are angular, shape (nv,)."""
    kind, first = model.jnt_type[model.dof_jntid], model.jnt_dofadr[model.dof_jntid]
    of_free = (kind == _FREE) & (np.arange(model.nv) - first >= 3)
    return of_free | (kind == _BALL) | (kind == _HINGE)


def _where(limited: Array, bounds: Array) -> Array:
    return np.where(limited.astype(bool)[:, None], bounds, [-np.inf, np.inf])
