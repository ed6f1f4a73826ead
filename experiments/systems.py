"""The paper's other systems: whether the simulation does what the classification says."""

from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np

from experiments.mechanisms import MECHANISMS, Condition, Mechanism
from experiments.parallel import in_parallel
from experiments.probe import PERIOD_S, STEP, Response, drift, follow, hold, respond
from prioritized import ConstrainedSystem, ForceMapping, Kinematics, Manipulability
from sim import Array, Failure, jacobians, load_model, mass_matrix

SEEN = 1e-3
"""Fraction of its full size that a simulated motion must have to count: what the servos hold has
come to rest to 1e-6, and what moves is of order one."""

_CORNERS = 8


@dataclass(frozen=True)
class Examination:
    """One mechanism in one condition, classified and simulated.

    Attributes:
        mechanism: What was examined.
        condition: What was broken.
        report: The classification.
        reach: Simulated dimension of the major motions; `reach_predicted`: classified.
        drift: Simulated dimension of the self-motion; `drift_major`: of its major part.
        bound: Simulated number of forbidden active rates.
        motion_error: Simulated against predicted payload motion, every actuator in turn, relative.
        drift_error: Sine of the angle between simulated and predicted self-motion; zero when none.
        major_error: Major displacement along a polygon, against what the mapping promises.
        force_error: Servo torques against the force mapping's, relative.
        yielded: Payload displacement under that force, in steps: what one servo, left alone with
            its torque, would yield.
        time_s: (T,) of the polygon; `desired`: (T, m1) major displacement; `reached`: (T, m1).
    """

    mechanism: Mechanism
    condition: Condition
    report: Manipulability
    reach: int
    reach_predicted: int
    drift: int
    drift_major: int
    bound: int
    motion_error: float
    drift_error: float
    major_error: float
    force_error: float
    yielded: float
    time_s: Array
    desired: Array
    reached: Array

    @property
    def agrees(self) -> bool:
        """Whether every count of the simulation is the classification's."""
        bases = self.report.bases
        return (
            self.reach == self.reach_predicted
            and self.drift == bases["unstable"].shape[1]
            and self.drift_major == bases["unstable_major"].shape[1]
            and self.bound == len(bases["constrained_active"])
        )


def run_systems(
    *, seed: int, quick: bool, on_progress: Callable[[int, int], None] = lambda done, total: None
) -> list[Examination]:
    """Examine every mechanism in every condition, side by side on the machine's cores.

    Args:
        seed: Of the directions in which the mechanisms are driven and push.
        quick: Only the first three conditions of each.
        on_progress: Called with finished and total number of examinations.
    """
    calls = [
        {"mechanism": mechanism, "condition": condition, "seed": seed}
        for mechanism in MECHANISMS
        for condition in mechanism.conditions[: 3 if quick else None]
    ]
    return in_parallel(examine, calls, on_progress)


def examine(mechanism: Mechanism, condition: Condition, seed: int) -> Examination:
    """Classify one condition, then simulate it and compare."""
    model = load_model(mechanism.path)
    failures = [Failure(k, "locked") for k in condition.locked]
    failures += [Failure(k, "free") for k in condition.free]
    kin = kinematics(model, mechanism, condition)
    report = kin.manipulability(mechanism.major)
    major, task = list(mechanism.major), list(mechanism.task)

    answer = respond(model, failures, kin.actuators)
    moved = answer.task[task]
    coasting = drift(model, failures, mechanism.task)[task]
    rng = np.random.default_rng(seed)
    desired, reached, major_error = _polygon(model, failures, mechanism, kin, rng)
    force_error, yielded = _held(model, failures, mechanism, kin, rng)
    return Examination(
        mechanism=mechanism,
        condition=condition,
        report=report,
        reach=_dimension(moved[major]),
        reach_predicted=len(major) - report.bases["unmanipulable"].shape[1],
        drift=_dimension(coasting),
        drift_major=_dimension(coasting[major]),
        bound=len(kin.actuators) - _dimension(answer.active),
        motion_error=_motion_error(kin, answer, moved),
        drift_error=_angle(coasting, report.bases["unstable"]),
        major_error=major_error,
        force_error=force_error,
        yielded=yielded,
        time_s=np.arange(1, len(desired) + 1) * PERIOD_S,
        desired=desired,
        reached=reached,
    )


def kinematics(model: mujoco.MjModel, mechanism: Mechanism, condition: Condition) -> Kinematics:
    """The failed mechanism at its nominal pose, with the task rows it is about.

    Frictionless from rest: under self-motion the passive joints keep their momentum at zero, which
    is what the mass matrix as their metric says.
    """
    data = mujoco.MjData(model)
    jac = jacobians(model, data, site="payload", axes="base")
    system = ConstrainedSystem(jac.J_T[list(mechanism.task)], jac.J_C, jac.active)
    failed = system.with_failures(condition.locked, condition.free)
    return failed.kinematics(passive_metric=mass_matrix(model, data))


def _motion_error(kin: Kinematics, answer: Response, moved: Array) -> float:
    """Payload motion against J times the active motion, and that against what the loops allow."""
    forbidden = kin.active_constraint @ answer.active
    off = np.linalg.norm(moved - kin.J @ answer.active) / np.linalg.norm(moved)
    return float(max(off, np.linalg.norm(forbidden) / np.linalg.norm(answer.active)))


def _polygon(
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


def _held(
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


def _dimension(moved: Array) -> int:
    """Number of directions with a motion that counts."""
    return int((np.linalg.svd(moved, compute_uv=False) > SEEN).sum())


def _angle(moved: Array, basis: Array) -> float:
    """Sine of the largest angle between what moved and a subspace; zero when nothing moved."""
    size = np.linalg.norm(moved, 2)
    if size < SEEN:
        return 0.0
    return float(np.linalg.norm(moved - basis @ (basis.T @ moved), 2) / size)
