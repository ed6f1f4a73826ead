"""What a simulated mechanism does, measured from outside.

No Jacobian goes into a number; only how long to wait is taken from the linear model.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from sim import Array, Failure, failed_plant, linearize

STEP = 1e-4
"""Size of commanded displacements, [m] or [rad]: far above the closures' nanometres, and small
against the curvature of a hand of 0.1 m."""

PERIOD_S = 0.01
_PUSH_S = 0.05
_TRIAL = 1e-6
_AT_REST = 1e-6
_NEVER = 0.01  # [1]/[s]: slower than any servo; what decays no faster coasts


@dataclass(frozen=True)
class Response:
    """Answers to one commanded step of each surviving actuator, divided by the step.

    Attributes:
        active: Displacement of the surviving actuators, column by column, shape (n', n').
        task: Displacement of the payload, shape (6, n').
    """

    active: Array
    task: Array


def settling_s(model: mujoco.MjModel, failures: Sequence[Failure]) -> float:
    """How long the slowest motion that the servos hold needs to come to rest, whole periods."""
    plant = failed_plant(model, failures)
    at_rest = linearize(plant.model, plant.data)
    decay = -np.linalg.eigvals(at_rest.A).real
    slowest = decay[decay > _NEVER].min(initial=np.inf)
    return PERIOD_S * np.ceil(-np.log(_AT_REST) / slowest / PERIOD_S)


def respond(model: mujoco.MjModel, failures: Sequence[Failure], survivors: Array) -> Response:
    """Command each survivor alone and see where everything comes to rest."""
    wait_s = settling_s(model, failures)
    active, task = [], []
    for k in survivors:
        plant = failed_plant(model, failures)
        plant.step(STEP * np.eye(model.nu)[k], wait_s)
        active.append(plant.strut_displacement_m()[survivors] / STEP)
        task.append(plant.displacement() / STEP)
    return Response(active=np.array(active).T, task=np.array(task).T)


def drift(model: mujoco.MjModel, failures: Sequence[Failure], rows: Sequence[int]) -> Array:
    """Push the payload along each task row, wait, and see what keeps moving, shape (6, rows).

    What the actuators hold has come back to rest by then; self-motion coasts. Columns are
    displacements after the wait, during a tenth of it, as fractions of the largest there was.
    """
    wait_s = settling_s(model, failures)
    coasting = []
    for row in rows:
        # A first, tiny push tells how hard to push.
        _, peak = _pushed(model, failures, _TRIAL * np.eye(6)[row], wait_s)
        moved, peak = _pushed(model, failures, _TRIAL * STEP / peak * np.eye(6)[row], wait_s)
        coasting.append(moved / peak)
    return np.array(coasting).T


def _pushed(
    model: mujoco.MjModel, failures: Sequence[Failure], wrench: Array, wait_s: float
) -> tuple[Array, float]:
    """Displacement in a tenth of the wait, after it and a short push, and the largest there was."""
    plant, still = failed_plant(model, failures), np.zeros(model.nu)
    plant.push(wrench)
    plant.step(still, _PUSH_S)
    plant.push(np.zeros(6))
    at_once = plant.displacement()
    plant.step(still, wait_s)
    before = plant.displacement()
    plant.step(still, max(PERIOD_S, round(0.1 * wait_s, 2)))
    after = plant.displacement()
    return after - before, float(max(np.abs(at_once).max(), np.abs(after).max()))


def follow(
    model: mujoco.MjModel, failures: Sequence[Failure], commands: Array
) -> tuple[Array, Array]:
    """What happens while each of the commands (K, nu) is held for S periods.

    Displacement of the payload (K, S, 6), and positions of all joints (K S, nq).
    """
    plant = failed_plant(model, failures)
    periods = round(settling_s(model, failures) / PERIOD_S)
    moved, qpos = [], []
    for command in commands:
        for _ in range(periods):
            plant.step(command, PERIOD_S)
            moved.append(plant.displacement())
            qpos.append(plant.data.qpos.copy())
    return np.array(moved).reshape(len(commands), periods, 6), np.array(qpos)


@dataclass(frozen=True)
class Holding:
    """Where a pushed mechanism comes to rest.

    Attributes:
        displacement: Of the payload, shape (6,).
        torques: Of all actuators, shape (nu,).
        constraint_force: Of closures and locks on each velocity, shape (nv,).
    """

    displacement: Array
    torques: Array
    constraint_force: Array


def hold(
    model: mujoco.MjModel, failures: Sequence[Failure], wrench: Array, torques: Array
) -> Holding:
    """Exert `wrench` on the world, by a push back at the payload, with servos told the torques.

    A servo that stands at zero and is commanded torque / gain exerts that torque.
    """
    plant = failed_plant(model, failures)
    plant.push(-wrench)
    plant.step(torques / model.actuator_gainprm[:, 0], settling_s(model, failures))
    return Holding(plant.displacement(), plant.coil_force_n(), plant.constraint_force())
