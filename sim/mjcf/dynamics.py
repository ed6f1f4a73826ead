"""Inertia and springs of a model, velocity by velocity."""

import mujoco
import numpy as np

import argument_checks as check
from argument_checks.ties import exceeds
from sim.array import Array
from sim.errors import ModelError
from sim.mjcf.model import check_state


def mass_matrix(model: mujoco.MjModel, data: mujoco.MjData) -> Array:
    """Joint-space inertia at the present `data.qpos`, armature included, shape (nv, nv).

    Derived quantities in `data` are brought up to date. [kg], [kg m] and [kg m^2].

    Raises:
        ValueError: `data` is of another model, or its `qpos` is not finite.
        TypeError: One of them is of another type.
    """
    check_state(model, data)
    mujoco.mj_fwdPosition(model, data)
    return mass_of(model, data)


def mass_of(model: mujoco.MjModel, data: mujoco.MjData) -> Array:
    """The same of a state that is up to date."""
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    return mass


def joint_stiffness(model: mujoco.MjModel) -> Array:
    """Spring stiffness of each velocity, shape (nv,), [N]/[m] and [N m]/[rad].

    A ball or free joint has one spring, repeated over its velocities. Springs of tendons are not
    joint springs and left out.

    Raises:
        ModelError: A spring that is not linear: a polynomial, or one that yields.
        TypeError: `model` is of another type.
    """
    check.instance("model", model, mujoco.MjModel)
    for k in np.flatnonzero(~has_linear_spring(model)):
        name = model.joint(k).name or f"number {k}"
        raise ModelError(f'the spring of joint "{name}" is not linear')
    return model.jnt_stiffness[model.dof_jntid]


def has_linear_spring(model: mujoco.MjModel) -> Array:
    """Which joints have springs that are linear, if of stiffness zero, shape (njnt,)."""
    return ~model.jnt_stiffnesspoly.any(axis=1) & (model.jnt_plasticadr < 0)


def is_slack(model: mujoco.MjModel, data: mujoco.MjData, tendon: int) -> bool:
    """Whether a tendon lies between the lengths at which its spring begins to pull or push.

    At one of these it does not: round-off of the length does not switch its spring off.
    """
    length, (low, high) = data.ten_length[tendon], model.tendon_lengthspring[tendon]
    return bool(exceeds(length, low) and exceeds(high, length))
