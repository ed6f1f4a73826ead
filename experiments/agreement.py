"""How far a simulated mechanism is from what was predicted of it."""

import mujoco
import numpy as np

from experiments.mechanisms import Mechanism
from experiments.probe import STEP, Response, follow, hold
from prioritized import ForceMapping, Kinematics
from sim import Array, Failure

SEEN = 1e-3
"""Fraction of its full size that a simulated motion must have to count: what the servos hold has
come to rest to 1e-6, and what moves is of order one."""

_CORNERS = 8


def motion_error(kin: Kinematics, answer: Response, moved: Array) -> float:
    """Payload motion against J times the active motion, and that against what the loops allow."""
    forbidden = kin.active_constraint @ answer.active
    off = np.linalg.norm(moved - kin.J @ answer.active) / np.linalg.norm(moved)
    return float(max(off, np.linalg.norm(forbidden) / np.linalg.norm(answer.active)))


def drive_polygon(
    model: mujoco.MjModel,
    failures: list[Failure],
    mechanism: Mechanism,
    kin: Kinematics,
    rng: np.random.Generator,
) -> tuple[Array, Array, float]:
    """Drive the major task around a polygon of radius STEP in its first two directions."""
    m1 = len(mechanism.major)
    angle = 2 * np.pi * (np.arange(_CORNERS) / _CORNERS + rng.random())
    corners = STEP * np.stack([np.cos(angle), np.sin(angle)], axis=1) @ np.eye(2, m1)
    mapping = kin.velocity_mapping(mechanism.major, joint_weight=np.ones(len(kin.actuators)))
    moved = follow(model, failures, kin.expand(mapping(corners)))
    rows = [mechanism.task[row] for row in mechanism.major]
    promised = corners - mapping.residual(corners)
    error = np.abs(moved[:, -1, rows] - promised).max() / STEP
    held = moved.shape[1]
    return np.repeat(corners, held, axis=0), moved[..., rows].reshape(-1, m1), float(error)


def hold_force(
    model: mujoco.MjModel,
    failures: list[Failure],
    mechanism: Mechanism,
    kin: Kinematics,
    rng: np.random.Generator,
) -> tuple[float, float]:
    """Exert a major force with the force mapping, an internal force on top where there is one."""
    mapping = kin.force_mapping(mechanism.major, torque_weight=np.ones(len(kin.actuators)))
    f_major = rng.normal(size=len(mechanism.major))
    squeeze = rng.normal(size=len(kin.active_constraint)) @ kin.active_constraint
    torques = kin.expand(mapping(f_major, torque=squeeze))
    wrench = np.zeros(6)
    wrench[list(mechanism.task)] = _task_force(mapping, mechanism, f_major, squeeze)

    # As hard as moves a servo by one step if nothing helps.
    scale = STEP / np.abs(torques / model.actuator_gainprm[:, 0]).max()
    held = hold(model, failures, scale * wrench, scale * torques)
    off = np.linalg.norm(held.torques - scale * torques) / np.linalg.norm(scale * torques)
    return float(off), float(np.abs(held.displacement).max() / STEP)


def _task_force(
    mapping: ForceMapping, mechanism: Mechanism, f_major: Array, squeeze: Array
) -> Array:
    force = np.zeros(len(mechanism.task))
    major = list(mechanism.major)
    force[major] = f_major - mapping.residual(f_major)
    secondary = np.setdiff1d(np.arange(len(force)), major)
    force[secondary] = mapping.secondary_force(f_major, torque=squeeze)
    return force


def dimension(moved: Array) -> int:
    """Number of directions with a motion that counts."""
    return int((np.linalg.svd(moved, compute_uv=False) > SEEN).sum())


def largest_angle(moved: Array, basis: Array) -> float:
    """Sine of the largest angle between what moved and a subspace; zero when nothing moved."""
    size = np.linalg.norm(moved, 2)
    if size < SEEN:
        return 0.0
    return float(np.linalg.norm(moved - basis @ (basis.T @ moved), 2) / size)
