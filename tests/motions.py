"""Motions on the manifold of positions, and derivatives along them."""

from collections.abc import Callable

import mujoco
import numpy as np

from prioritized import ConstrainedSystem
from prioritized._kinematics import Kinematics
from sim import Jacobians


def kinematics(jac: Jacobians) -> Kinematics:
    """Return the kinematics of the healthy system."""
    return ConstrainedSystem(jac.J_T, jac.J_C, jac.active).kinematics()


def shifted(model: mujoco.MjModel, data: mujoco.MjData, step: np.ndarray) -> mujoco.MjData:
    """Return a new state after a step on the manifold, frames up to date."""
    there = mujoco.MjData(model)
    there.qpos[:], there.eq_active[:] = data.qpos, data.eq_active
    mujoco.mj_integratePos(model, there.qpos, step, 1.0)
    mujoco.mj_fwdPosition(model, there)
    return there


def change(model: mujoco.MjModel, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Return the step that leads from one position to the other."""
    step = np.empty(model.nv)
    mujoco.mj_differentiatePos(model, step, 1.0, start, end)
    return step


def check_slope(
    slope: np.ndarray | float,
    of: Callable[[float], np.ndarray],
    h: float,
    most: float,
    round_off: float = 1e-9,
) -> None:
    """Check that central differences of steps h and h/2 converge to a slope with order h^2."""
    errors = [np.linalg.norm((np.asarray(of(s)) - of(-s)) / (2 * s) - slope) for s in (h, h / 2)]
    assert errors[1] < most
    assert errors[1] < 0.3 * errors[0] + round_off
