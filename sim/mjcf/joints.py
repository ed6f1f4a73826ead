"""Joints and tendons of a model as arrays: kinds, ranges, springs, inertia."""

from dataclasses import dataclass

import mujoco
import numpy as np

import argument_checks as check
from argument_checks.ties import exceeds
from sim.array import Array
from sim.errors import ModelError
from sim.mjcf.model import check_state, name_of

_JOINT = mujoco.mjtJoint
_SLIDE, _HINGE = int(_JOINT.mjJNT_SLIDE), int(_JOINT.mjJNT_HINGE)
_BALL, _FREE = int(_JOINT.mjJNT_BALL), int(_JOINT.mjJNT_FREE)


@dataclass(frozen=True)
class Ranges:
    """Lower and upper limits of a model, infinite where there are none; shape (., 2) each.

    Attributes:
        joint: Position of the slide or hinge of each velocity, (nv, 2), [m] or [rad].
        tendon: Length of each tendon, (ntendon, 2).
        control: Control of each actuator, (nu, 2).
        force: Force of each actuator output, (nout, 2).
    """

    joint: Array
    tendon: Array
    control: Array
    force: Array

    def __post_init__(self) -> None:
        check.lock(self)


def ranges(model: mujoco.MjModel) -> Ranges:
    """Return the ranges of joints, tendons, controls and forces that a model states."""
    check.instance("model", model, mujoco.MjModel)
    return Ranges(
        joint=within(model.jnt_limited & one_axis(model), model.jnt_range)[model.dof_jntid],
        tendon=within(model.tendon_limited, model.tendon_range),
        control=within(model.actuator_ctrllimited, model.actuator_ctrlrange),
        force=within(model.actuator_forcelimited, model.actuator_forcerange),
    )


def within(limited: Array, bounds: Array) -> Array:
    """Return the bounds (k, 2) with infinities where the mask `limited` (k,) is false."""
    return np.where(limited.astype(bool)[:, None], bounds, [-np.inf, np.inf])


def joint_positions(model: mujoco.MjModel, qpos: Array) -> Array:
    """Return the joint position of each velocity, (nv,); zero for ball and free joints."""
    return np.where(one_axis(model), qpos[model.jnt_qposadr], 0.0)[model.dof_jntid]


def one_axis(model: mujoco.MjModel) -> Array:
    """Return a mask (njnt,) of the joints that are slides or hinges."""
    return np.isin(model.jnt_type, (_SLIDE, _HINGE))


def turning(model: mujoco.MjModel) -> Array:
    """Return a mask (nv,) of the angular velocities."""
    kind, first = model.jnt_type[model.dof_jntid], model.jnt_dofadr[model.dof_jntid]
    of_free = (kind == _FREE) & (np.arange(model.nv) - first >= 3)
    return of_free | np.isin(kind, (_BALL, _HINGE))


def mass_matrix(model: mujoco.MjModel, data: mujoco.MjData) -> Array:
    """Compute the joint-space inertia at `data.qpos`, armature included, shape (nv, nv).

    It is in [kg], [kg m] and [kg m^2]. Derived quantities in `data` are brought up to date.
    """
    check_state(model, data)
    mujoco.mj_fwdPosition(model, data)
    return mass_of(model, data)


def mass_of(model: mujoco.MjModel, data: mujoco.MjData) -> Array:
    """Return the joint-space inertia (nv, nv) of a state that is up to date."""
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    return mass


def joint_stiffness(model: mujoco.MjModel) -> Array:
    """Return the joint spring stiffness of each velocity, (nv,), [N]/[m] and [N m]/[rad].

    A ball or free joint has one spring, repeated over its velocities. Tendons are left out.

    Raises:
        ModelError: A spring is not linear (polynomial or plastic).
    """
    check.instance("model", model, mujoco.MjModel)
    for k in np.flatnonzero(~has_linear_spring(model)):
        raise ModelError(f'the spring of joint "{name_of(model.joint(k))}" is not linear')
    return model.jnt_stiffness[model.dof_jntid]


def has_linear_spring(model: mujoco.MjModel) -> Array:
    """Return a mask (njnt,) of the joints whose springs are linear, including zero stiffness."""
    return ~model.jnt_stiffnesspoly.any(axis=1) & (model.jnt_plasticadr < 0)


def is_slack(model: mujoco.MjModel, data: mujoco.MjData, tendon: int) -> bool:
    """Return whether a tendon's length lies strictly inside its spring's dead band.

    The comparison tolerates round-off, which does not switch a spring off.
    """
    length, (low, high) = data.ten_length[tendon], model.tendon_lengthspring[tendon]
    return bool(exceeds(length, low) and exceeds(high, length))
