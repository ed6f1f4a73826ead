"""The force mapping's torques: on the hexapod, beside other torques, and on a platform.

The platform stands on four legs where three are enough, and has an internal force to use.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from scipy.linalg import orth

from experiments.force.aims import (
    LEAST_TORQUE,
    Aims,
    ForceGoal,
    as_wrench,
    cost,
    least_cost,
    statics,
)
from experiments.force.rig import Condition, Readings, press, with_fixture
from experiments.rig.hexapod.columns import MAJOR, SECONDARY
from prioritized import (
    ConstrainedSystem,
    ForceMapping,
    Kinematics,
    Status,
    canonical_basis,
    force_mapping,
)
from sim import HEXAPOD_MJCF, Array, jacobians, load_model

PLATFORM_MJCF = HEXAPOD_MJCF.with_name("platform.xml")
PLATFORM_TASK = (2, 3, 4)
PLATFORM_MAJOR = (0, 1, 2)
"""All of the task is prescribed: torques that are J^T f, eq. (22), leave nothing to choose."""
PLATFORM_N_M, PLATFORM_N = 1.0, 15.0
"""Largest moment and size of the force: up to 9.2 N a leg."""
HOT = 3.0
"""Weight of a hot motor's torque, where that of the others is one."""
SQUEEZE_N = 30.0
"""Bias of each leg, to keep its play on one side whatever force is exerted."""

OTHERS = 60
MAJOR_WEIGHTS = (0.3, 1.0, 3.0, 10.0, 30.0, 100.0)
"""Of the weighted pseudo-inverse, [1]/[N m]."""


@dataclass(frozen=True)
class Answer:
    """The mapping's answer to some aims, one a row; wrenches are [moment; force]."""

    goal: ForceGoal
    asked: Array  # the aims, (D, 6)
    status: Status
    torques: Array  # of the coils, (D, 6), [N]; zero at failed struts
    wrench: Array  # what they exert, with the secondary force chosen, (D, 6)
    strut: Array  # what each closure then takes on, eq. (11); a lock's reaction, (D, 6), [N]
    seen: Array  # orthogonal projector on the wrenches that the actuators span, (6, 6)
    cost: Array  # of Problem 6, (D,)
    least_cost: Array  # of all equilibria, found another way, (D,)


def known_system(condition: Condition) -> ConstrainedSystem:
    """The failed hexapod as the mapping knows it: from a sound, rigid model without fixture."""
    return _machine(HEXAPOD_MJCF, range(6)).with_failures(condition.locked, condition.free)


def platform() -> ConstrainedSystem:
    """The platform as the mapping knows it."""
    return _machine(PLATFORM_MJCF, PLATFORM_TASK)


def _machine(path: Path, task: Sequence[int]) -> ConstrainedSystem:
    model = load_model(path)
    jac = jacobians(model, mujoco.MjData(model), site="payload", axes="base")
    return ConstrainedSystem(jac.J_T[list(task)], jac.J_C, jac.active)


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
    """Torques that pressed on the fixture."""

    torques: Array  # (P, 6), [N]
    weighed: Array  # |W3 torques|, (P,)
    major_off: Array  # simulated major force from what was asked for, relative, (P,)


@dataclass(frozen=True)
class Tradeoff:
    """Torques for one major force on the sound hexapod."""

    asked: Array  # the major force, (2,), [N m]
    mapping: Tried
    others: Tried  # of the same major force, at random
    pseudo_inverse: Tried  # weighted, by MAJOR_WEIGHTS


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
    directions = canonical_basis(orth(possible.to_torques @ possible.free))
    away = rng.normal(size=(OTHERS, directions.shape[1])) @ directions.T
    size = np.linalg.norm(best) * rng.uniform(0.05, 1.0, (OTHERS, 1))
    away *= size / np.linalg.norm(away, axis=1, keepdims=True)
    J = system.kinematics().J
    compromises = np.array([compromise(J, W3, asked, weight) for weight in MAJOR_WEIGHTS])
    return Tradeoff(asked, tried(best), tried(best + away), tried(compromises))


def compromise(J: Array, W3: Array, f_major: Array, weight: float) -> Array:
    """Torques (6,) of the weighted pseudo-inverse: all errors at once, the major ones weighted.

    Minimizes |w (f_m - f_md)|^2 + |W3 torques|^2 over f, where torques = J^T f.
    """
    A = np.vstack([weight * np.eye(6)[MAJOR], W3[:, None] * J.T])
    target = np.concatenate([weight * f_major, np.zeros(6)])
    return J.T @ np.linalg.lstsq(A, target)[0]


@dataclass(frozen=True)
class Exerted:
    """One way to press on the fixture, one force a row."""

    torques: Array  # (D, 4), [N]
    legs: Array  # what the pins of the legs take on, by eq. (11), (D, 4), [N]
    pressed: Readings


@dataclass(frozen=True)
class InternalForce:
    """One use of the internal force."""

    name: str
    motor: int | None  # the hot one, 0..3; None: the legs are squeezed
    torque_weight: Array  # W3, diagonal, (4,), [1]/[N]
    desired: Array  # torques that the legs are to stay near, (4,), [N]
    direction: Array  # unit vector C of the torques that do no work on any motion, (4,)
    wrench: Array  # exerted, [moment; force], (D, 6)
    without: Exerted  # with the torques J^T f
    used: Exerted  # with J^T f + C^T eta


def use_internal_force(rng: np.random.Generator, count: int) -> tuple[InternalForce, ...]:
    """Relieve each motor in turn, then squeeze, pressing on the fixture with so many forces."""
    model, system = with_fixture(PLATFORM_MJCF), platform()
    kin = system.kinematics()
    angle = rng.uniform(0, 2 * np.pi, count)
    moment = rng.uniform(-PLATFORM_N_M, PLATFORM_N_M, count)
    f = np.column_stack([moment, PLATFORM_N * np.cos(angle), PLATFORM_N * np.sin(angle)])
    wrench = np.zeros((count, 6))
    wrench[:, PLATFORM_TASK] = f

    def exert(mapping: ForceMapping, desired: Array) -> Exerted:
        torques = mapping(f, torque=desired)
        legs = closure_forces(system, kin, f, torques)
        return Exerted(torques, legs, press(model, (), torques, PLATFORM_TASK))

    def use(name: str, motor: int | None, W3: Array, desired: Array) -> InternalForce:
        # The paper assumes internal force away: its mapping is that of J alone.
        without = force_mapping(kin.J, PLATFORM_MAJOR, torque_weight=W3)
        used = kin.force_mapping(PLATFORM_MAJOR, torque_weight=W3)
        both = exert(without, desired), exert(used, desired)
        return InternalForce(name, motor, W3, desired, kin.active_constraint[0], wrench, *both)

    weights = np.ones((4, 4)) + (HOT - 1) * np.eye(4)
    hot = [use(f"motor {k + 1} hot", k, weights[k], np.zeros(4)) for k in range(4)]
    squeeze = SQUEEZE_N * np.sign(kin.active_constraint[0])
    return (*hot, use("squeezed", None, np.ones(4), squeeze))
