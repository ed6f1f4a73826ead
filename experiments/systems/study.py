"""The paper's other systems: whether the simulation does what the classification says."""

from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np

from experiments.output.parallel import in_parallel
from experiments.systems.agreement import (
    Held,
    Polygon,
    dimension,
    drive_polygon,
    hold_force,
    largest_angle,
    motion_error,
)
from experiments.systems.mechanisms import MECHANISMS, Condition, Mechanism
from experiments.systems.probe import PERIOD_S, drift, respond
from prioritized import ConstrainedSystem, Kinematics, Manipulability
from sim import Array, Failure, jacobians, load_model, mass_matrix


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
        held: A force exerted through the force mapping.
        polygon: The major task driven around one; `time_s`: (T,).
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
    held: Held
    time_s: Array
    polygon: Polygon

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
    system, kin = classified(model, mechanism, condition)
    report = kin.manipulability(mechanism.major)
    major, task = list(mechanism.major), list(mechanism.task)

    answer = respond(model, failures, kin.actuators)
    moved = answer.task[task]
    coasting = drift(model, failures, mechanism.task)[task]
    rng = np.random.default_rng(seed)
    polygon = drive_polygon(model, failures, mechanism, kin, rng)
    held = hold_force(model, failures, mechanism, system, kin, rng)
    return Examination(
        mechanism=mechanism,
        condition=condition,
        report=report,
        reach=dimension(moved[major]),
        reach_predicted=len(major) - report.bases["unmanipulable"].shape[1],
        drift=dimension(coasting),
        drift_major=dimension(coasting[major]),
        bound=len(kin.actuators) - dimension(answer.active),
        motion_error=motion_error(kin, answer, moved),
        drift_error=largest_angle(coasting, report.bases["unstable"]),
        held=held,
        time_s=np.arange(1, len(polygon.desired) + 1) * PERIOD_S,
        polygon=polygon,
    )


def classified(
    model: mujoco.MjModel, mechanism: Mechanism, condition: Condition
) -> tuple[ConstrainedSystem, Kinematics]:
    """The failed mechanism at its nominal pose, with the task rows it is about.

    Frictionless from rest: under self-motion the passive joints keep their momentum at zero, which
    is what the mass matrix as their metric says.
    """
    data = mujoco.MjData(model)
    jac = jacobians(model, data, site="payload", axes="base")
    system = ConstrainedSystem(jac.J_T[list(mechanism.task)], jac.J_C, jac.active)
    failed = system.with_failures(condition.locked, condition.free)
    return failed, failed.kinematics(passive_metric=mass_matrix(model, data))
