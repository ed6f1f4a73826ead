"""What the force mapping answers on the hexapod, and other torques to compare it with."""

from dataclasses import dataclass

import mujoco
import numpy as np

from experiments.force.cases import LEAST_TORQUE, Aims, Condition, ForceGoal, as_wrench
from experiments.force.optimum import cost, least_cost, statics
from experiments.force.rig import press, with_fixture
from experiments.hexapod.columns import MAJOR, SECONDARY
from prioritized import ConstrainedSystem, Kinematics, Status
from sim import HEXAPOD_MJCF, Array, jacobians, load_model

OTHERS = 60
MAJOR_WEIGHTS = (0.3, 1.0, 3.0, 10.0, 30.0, 100.0)
"""Of the weighted pseudo-inverse, [1]/[N m]."""


@dataclass(frozen=True)
class Answer:
    """The mapping's answer to some aims, one a row.

    Attributes:
        asked: The aims, [moment; force], shape (D, 6).
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


def known_system(condition: Condition) -> ConstrainedSystem:
    """The failed hexapod as the mapping knows it: from a sound, rigid model without fixture."""
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

    Of task forces f (D, m) and torques of the surviving actuators (D, n - q).
    """
    f_C = kin.constraint_force(f, torques)[:, : len(system.J_C)]  # after these, the locks'
    return (f_C @ system.J_C)[:, system.active]


@dataclass(frozen=True)
class Tried:
    """Torques that pressed on the fixture.

    Attributes:
        torques: Shape (P, 6), [N].
        weighed: |W3 torques|, shape (P,).
        major_off: Simulated major force against what was asked for, relative, shape (P,).
    """

    torques: Array
    weighed: Array
    major_off: Array


@dataclass(frozen=True)
class Tradeoff:
    """Torques for one major force on the sound hexapod.

    Attributes:
        asked: The major force, shape (2,), [N m].
        others: Other torques of the same major force, at random.
        pseudo_inverse: Weighted pseudo-inverses, by :data:`MAJOR_WEIGHTS`.
    """

    asked: Array
    mapping: Tried
    others: Tried
    pseudo_inverse: Tried


def trade(aims: Aims, rng: np.random.Generator) -> Tradeoff:
    """Press with each of them on the fixture, for the first of the aims and the least torque."""
    model, system, goal = with_fixture(HEXAPOD_MJCF), known_system(Condition()), LEAST_TORQUE
    first = Aims(aims.major[:1], aims.secondary[:1])
    W3, asked = np.array(goal.torque_weight), first.major[0]

    def tried(torques: Array) -> Tried:
        at_rest = press(model, (), torques).fixture[:, -1]
        off = np.linalg.norm(at_rest[:, MAJOR] - asked, axis=1) / np.linalg.norm(asked)
        return Tried(torques, np.linalg.norm(torques * W3, axis=1), off)

    best, possible = answer(system, goal, first).torques, statics(system, first.major)
    directions = possible.to_torques @ possible.free
    away = rng.normal(size=(OTHERS, directions.shape[1])) @ same_basis(directions).T
    size = np.linalg.norm(best) * rng.uniform(0.05, 1.0, (OTHERS, 1))
    away *= size / np.linalg.norm(away, axis=1, keepdims=True)
    J = system.kinematics().J
    compromises = np.array([compromise(J, W3, asked, weight) for weight in MAJOR_WEIGHTS])
    return Tradeoff(asked, tried(best), tried(best + away), tried(compromises))


def same_basis(directions: Array) -> Array:
    """An orthonormal basis of the columns' span that is the same whatever basis they are.

    The one that LAPACK chooses for a null space depends on the processor.
    """
    projector = directions @ np.linalg.pinv(directions)
    Q, R = np.linalg.qr(projector[:, : directions.shape[1]])
    return Q * np.sign(np.diagonal(R))


def compromise(J: Array, W3: Array, f_major: Array, weight: float) -> Array:
    """Torques (6,) of the weighted pseudo-inverse: all errors at once, the major ones weighted.

    Minimizes |w (f_m - f_md)|^2 + |W3 torques|^2 over f, where torques = J^T f.
    """
    A = np.vstack([weight * np.eye(6)[MAJOR], W3[:, None] * J.T])
    target = np.concatenate([weight * f_major, np.zeros(6)])
    return J.T @ np.linalg.lstsq(A, target)[0]
