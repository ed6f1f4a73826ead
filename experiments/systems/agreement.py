"""How far a simulated mechanism is from what was predicted of it."""

from dataclasses import dataclass

import mujoco
import numpy as np

from experiments.systems.mechanisms import Mechanism
from experiments.systems.probe import STEP, Response, follow, hold
from prioritized import ConstrainedSystem, ForceMapping, Kinematics
from sim import Array, Failure

SEEN = 1e-3
"""What counts as motion, per commanded step or as a fraction of the way after a push: what servos
and closures hold stands still to 1e-5, and the smallest motion there is comes to 0.015 (a rotor's
radian moves a hand's object that many metres)."""

_CORNERS = 8


def motion_error(kin: Kinematics, answer: Response, moved: Array) -> float:
    """Payload motion against J times the active motion, and that against what the loops allow.

    Relative; each row of the task against its own motion, so that no turn is weighed against a way.
    """
    forbidden = kin.active_constraint @ answer.active
    off = np.linalg.norm(moved - kin.J @ answer.active, axis=1)
    rows = off / np.maximum(np.linalg.norm(moved, axis=1), SEEN)
    return float(max(rows.max(), np.linalg.norm(forbidden) / np.linalg.norm(answer.active)))


@dataclass(frozen=True)
class Polygon:
    """The major task driven around a polygon, in simulation.

    Attributes:
        desired: Shape (T, m1).
        reached: Shape (T, m1).
        qpos: Positions of all joints, shape (T, nq).
        error: Largest distance at a corner from what the mapping promises, in steps.
    """

    desired: Array
    reached: Array
    qpos: Array
    error: float


def drive_polygon(
    model: mujoco.MjModel,
    failures: list[Failure],
    mechanism: Mechanism,
    kin: Kinematics,
    rng: np.random.Generator,
) -> Polygon:
    """Drive the major task around an octagon of radius STEP, then both ways along the others."""
    m1 = len(mechanism.major)
    angle = 2 * np.pi * (np.arange(_CORNERS) / _CORNERS + rng.random())
    octagon = np.stack([np.cos(angle), np.sin(angle)], axis=1) @ np.eye(2, m1)
    corners = STEP * np.vstack([octagon, np.eye(m1)[2:], -np.eye(m1)[2:]])
    mapping = kin.velocity_mapping(mechanism.major, joint_weight=np.ones(len(kin.actuators)))
    moved, qpos = follow(model, failures, kin.expand(mapping(corners)))
    rows = [mechanism.task[row] for row in mechanism.major]
    promised = corners - mapping.residual(corners)
    error = np.abs(moved[:, -1, rows] - promised).max() / STEP
    return Polygon(
        desired=np.repeat(corners, moved.shape[1], axis=0),
        reached=moved[..., rows].reshape(-1, m1),
        qpos=qpos,
        error=float(error),
    )


@dataclass(frozen=True)
class Held:
    """A force exerted through the force mapping, in simulation.

    Attributes:
        torque_error: Servo torques against the mapping's, relative.
        closure_error: What the closures and locks do to the joints, against the constraint forces
            that the kinematics derives from force and torques, relative to the largest of these and
            of what force and torques do to the joints: closures may have nothing to bear.
        yielded: Payload displacement, in steps. One servo, alone with its torque, would move one.
    """

    torque_error: float
    closure_error: float
    yielded: float


def hold_force(
    model: mujoco.MjModel,
    failures: list[Failure],
    mechanism: Mechanism,
    system: ConstrainedSystem,
    kin: Kinematics,
    rng: np.random.Generator,
) -> Held:
    """Exert a major force with the force mapping, and squeeze where there is internal force."""
    mapping = kin.force_mapping(mechanism.major, torque_weight=np.ones(len(kin.actuators)))
    f_major = rng.normal(size=len(mechanism.major))
    squeeze = rng.normal(size=len(kin.active_constraint)) @ kin.active_constraint
    torques = mapping(f_major, torque=squeeze)
    force = _task_force(mapping, mechanism, f_major, squeeze)
    # As hard as moves a servo by one step if nothing helps.
    scale = STEP / np.abs(kin.expand(torques) / model.actuator_gainprm[:, 0]).max()
    torques, force = scale * torques, scale * force
    wrench = np.zeros(6)
    wrench[list(mechanism.task)] = force
    held = hold(model, failures, wrench, kin.expand(torques))
    closures = _closure_rows(system).T @ -kin.constraint_force(force, torques)  # eq. (5)
    return Held(
        torque_error=_relative(held.torques - kin.expand(torques), torques),
        closure_error=_relative(
            held.constraint_force - closures, closures, system.J_T.T @ force, torques
        ),
        yielded=float(np.abs(held.displacement).max() / STEP),
    )


def _closure_rows(system: ConstrainedSystem) -> Array:
    """J_C and a unit row E for each stuck joint, section 2.3.2."""
    return np.vstack([system.J_C, np.eye(system.J_C.shape[1])[system.stuck]])


def _relative(difference: Array, *wholes: Array) -> float:
    """Norm of a difference as a part of the largest of the wholes; zero when all are."""
    size = max(np.linalg.norm(whole) for whole in wholes)
    return float(np.linalg.norm(difference) / size) if size else 0.0


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
