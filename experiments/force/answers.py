"""What the force mapping says of the hexapod."""

from dataclasses import dataclass

import mujoco
import numpy as np

from experiments.force.cases import Aims, Condition, ForceGoal, as_wrench
from experiments.force.optimum import cost, least_cost, statics
from experiments.hexapod.goal import MAJOR, SECONDARY
from prioritized import ConstrainedSystem, Kinematics, Status
from sim import Array, jacobians, load_model


@dataclass(frozen=True)
class Answer:
    """The mapping's answer to some aims, one a row.

    Attributes:
        goal: What was to be least.
        asked: The aims, [moment; force], shape (D, 6).
        status: What the mapping promises.
        torques: Of the coils, shape (D, 6), [N]; zero at failed struts.
        wrench: What they exert, [moment; force] with the secondary force chosen, shape (D, 6).
        strut: What the closure of each strut then takes on, eq. (11), shape (D, 6), [N]; of a
            locked strut, its reaction.
        seen: Orthogonal projector on the wrenches that the actuators span, shape (6, 6).
        cost: Of Problem 6, shape (D,); `least_cost`: of all equilibria, found another way.
    """

    goal: ForceGoal
    asked: Array
    status: Status
    torques: Array
    wrench: Array
    strut: Array
    seen: Array
    cost: Array
    least_cost: Array


def told(condition: Condition) -> ConstrainedSystem:
    """The failed hexapod as the mapping knows it: a sound model of its own, rigid, no fixture."""
    model = load_model()
    jac = jacobians(model, mujoco.MjData(model), site="payload", axes="base")
    sound = ConstrainedSystem(jac.J_T, jac.J_C, jac.active)
    return sound.with_failures(condition.locked, condition.free)


def answer(system: ConstrainedSystem, goal: ForceGoal, aims: Aims) -> Answer:
    """Torques, and the forces that go with them."""
    kin = system.kinematics()
    mapping = kin.force_mapping(MAJOR, SECONDARY, goal.torque_weight, goal.secondary_weight)
    survivors = mapping(aims.major, secondary_force=aims.secondary)
    f_s = mapping.secondary_force(aims.major, secondary_force=aims.secondary)
    wrench = as_wrench(aims.major - mapping.residual(aims.major), f_s)
    torques = kin.expand(survivors)
    return Answer(
        goal=goal,
        asked=aims.wrench,
        status=mapping.status,
        torques=torques,
        wrench=wrench,
        strut=closure_forces(system, kin, wrench, survivors),
        seen=np.eye(6) - mapping.reaction,
        cost=cost(goal, torques, f_s, aims.secondary),
        least_cost=least_cost(goal, statics(system, aims.major), aims.secondary),
    )


def closure_forces(system: ConstrainedSystem, kin: Kinematics, f: Array, torques: Array) -> Array:
    """What the closures take on along each actuated joint, by eqs. (5) and (11), shape (D, n).

    Args:
        system: The failed mechanism.
        kin: Its kinematics.
        f: Task forces, shape (D, m).
        torques: Of the surviving actuators, shape (D, n - q).
    """
    f_C = kin.constraint_force(f, torques)[:, : len(system.J_C)]  # after these, the locks'
    return (f_C @ system.J_C)[:, system.active]
