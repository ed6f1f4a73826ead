"""Where the hexapod stands with strut 1 locked, and where it is asked to point.

By (alpha, beta), with the loops closed, strut 1 where it is, and the other struts moving least.
"""

from dataclasses import dataclass

import mujoco
import numpy as np

from experiments.hexapod.goal import Goal
from experiments.hexapod.mapping import StrutMapping
from sim import NOMINAL, Array, Plant, Pose, hexapod

STUCK = 0
GOAL = Goal(joint_weight=(1.0,) * 6, locked_m={STUCK: 0.0})
RADIUS_RAD = 1e-4


@dataclass(frozen=True)
class Case:
    """Where the machine stands, and what is asked of it.

    Attributes:
        qpos: All joints, loops closed, shape (nq,).
        pose: The payload's.
        pointing_rad: (alpha, beta), shape (2,).
    """

    qpos: Array
    pose: Pose
    pointing_rad: Array


def random_cases(model: mujoco.MjModel, count: int, rng: np.random.Generator) -> list[Case]:
    """Poses that the machine itself has gone to, and as many displacements to ask for there."""
    mapping = strut_mapping(model)
    cases = []
    for there_rad, asked_rad in rng.uniform(-RADIUS_RAD, RADIUS_RAD, size=(count, 2, 2)):
        plant = Plant(model)
        plant.settle(0.1, mapping.displacements(there_rad, NOMINAL))
        cases.append(Case(plant.data.qpos.copy(), plant.pose(), asked_rad))
    return cases


def strut_mapping(model: mujoco.MjModel) -> StrutMapping:
    """The experiments' own, which re-evaluates its Jacobian at every call."""
    return StrutMapping(hexapod(model), GOAL, "analytic")


def strut_velocities(model: mujoco.MjModel) -> Array:
    """Velocity index of each strut, shape (6,)."""
    return model.jnt_dofadr[model.actuator_trnid[:, 0]]
