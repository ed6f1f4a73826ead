"""A platform on four legs where three are enough: two uses of its internal force."""

from dataclasses import dataclass

import mujoco
import numpy as np

from experiments.force.answers import closure_forces
from experiments.force.rig import Readings, press, with_fixture
from prioritized import ConstrainedSystem, ForceMapping, force_mapping
from sim import HEXAPOD_MJCF, Array, jacobians, load_model

PLATFORM_MJCF = HEXAPOD_MJCF.with_name("platform.xml")
TASK = (2, 3, 4)
MAJOR = (0, 1, 2)
"""All of the task is prescribed: torques that are J^T f, eq. (22), leave nothing to choose."""

MOMENT_N_M, FORCE_N = 1.0, 15.0
"""Largest moment and size of the force: up to 9.2 N a leg."""
HOT = 3.0
"""Weight of a hot motor's torque, where that of the others is one."""
SQUEEZE_N = 30.0
"""Bias of each leg, to keep its play on one side whatever force is exerted."""


@dataclass(frozen=True)
class Exerted:
    """One way to press on the fixture, one force a row.

    Attributes:
        torques: Shape (D, 4), [N].
        legs: What the pins of the legs take on, by eq. (11), shape (D, 4), [N].
        pressed: The simulation's readings.
    """

    torques: Array
    legs: Array
    pressed: Readings


@dataclass(frozen=True)
class InternalForce:
    """One use of the internal force.

    Attributes:
        motor: The hot motor, 0..3; None: the legs are squeezed.
        torque_weight: W3, diagonal, shape (4,), [1]/[N].
        desired: Torques that the legs are to stay near, shape (4,), [N].
        direction: Unit vector C of the torques that do no work on any motion, shape (4,).
        wrench: What is exerted, [moment; force], shape (D, 6).
        without: With the torques J^T f.
        used: With J^T f + C^T eta.
    """

    name: str
    motor: int | None
    torque_weight: Array
    desired: Array
    direction: Array
    wrench: Array
    without: Exerted
    used: Exerted


def use_internal_force(rng: np.random.Generator, count: int) -> tuple[InternalForce, ...]:
    """Relieve each motor in turn, then squeeze, pressing on the fixture with so many forces."""
    model, system = with_fixture(PLATFORM_MJCF), platform()
    kin = system.kinematics()
    angle, moment = rng.uniform(0, 2 * np.pi, count), rng.uniform(-MOMENT_N_M, MOMENT_N_M, count)
    f = np.column_stack([moment, FORCE_N * np.cos(angle), FORCE_N * np.sin(angle)])
    wrench = np.zeros((count, 6))
    wrench[:, TASK] = f

    def exert(mapping: ForceMapping, desired: Array) -> Exerted:
        torques = mapping(f, torque=desired)
        legs = closure_forces(system, kin, f, torques)
        return Exerted(torques, legs, press(model, (), torques, TASK))

    def use(name: str, motor: int | None, W3: Array, desired: Array) -> InternalForce:
        # The paper assumes internal force away: its mapping is that of J alone.
        without = force_mapping(kin.J, MAJOR, torque_weight=W3)
        used = kin.force_mapping(MAJOR, torque_weight=W3)
        both = exert(without, desired), exert(used, desired)
        return InternalForce(name, motor, W3, desired, kin.active_constraint[0], wrench, *both)

    weights = np.ones((4, 4)) + (HOT - 1) * np.eye(4)
    hot = [use(f"motor {k + 1} hot", k, weights[k], np.zeros(4)) for k in range(4)]
    squeeze = SQUEEZE_N * np.sign(kin.active_constraint[0])
    return (*hot, use("squeezed", None, np.ones(4), squeeze))


def platform() -> ConstrainedSystem:
    """The platform as the mapping knows it."""
    model = load_model(PLATFORM_MJCF)
    jac = jacobians(model, mujoco.MjData(model), site="payload", axes="base")
    return ConstrainedSystem(jac.J_T[list(TASK)], jac.J_C, jac.active)
