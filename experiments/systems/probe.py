"""What a failed mechanism does in simulation, measured from outside, and how far predictions miss.

No Jacobian goes into a measurement; only how long to wait is taken from the linear model.
"""

from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np

from prioritized import ConstrainedSystem, ForceMapping, Kinematics
from sim import Array, Failure, Plant, failed_plant, linearize

STEP = 1e-4
"""Size of commanded displacements, [m] or [rad]: far above the closures' nanometres, and small
against the curvature of a hand of 0.1 m."""
PERIOD_S = 0.01
VISIBLE = 1e-3
"""What counts as motion, per commanded step or as a fraction of the way after a push: what servos
and closures hold stands still to 1e-5, and the smallest motion there is comes to 0.015 (a rotor's
radian moves a hand's object that many metres)."""

CORNERS = 8
_PUSH_S = 0.05
_TRIAL = 1e-6
_AT_REST = 1e-6
_COASTING_PER_S = 0.01  # slower than any servo; what decays no faster coasts


@dataclass(frozen=True)
class Probed:
    """A mechanism and its task, as in `Mechanism`; each measurement makes a plant of its own."""

    model: mujoco.MjModel
    failures: tuple[Failure, ...]
    task: tuple[int, ...]
    major: tuple[int, ...]

    def plant(self) -> Plant:
        """At its nominal pose, failed."""
        return failed_plant(self.model, self.failures)

    @property
    def major_rows(self) -> list[int]:
        """Rows of the twist that the major task is."""
        return [self.task[row] for row in self.major]

    @cached_property
    def settling_s(self) -> float:
        """How long the slowest motion that the servos hold needs to rest, whole periods."""
        plant = self.plant()
        at_rest = linearize(plant.model, plant.data)
        decay = -np.linalg.eigvals(at_rest.A).real
        slowest = decay[decay > _COASTING_PER_S].min(initial=np.inf)
        return PERIOD_S * np.ceil(-np.log(_AT_REST) / slowest / PERIOD_S)


def respond(rig: Probed, survivors: Array) -> tuple[Array, Array]:
    """Displacements at rest after one step of each surviving actuator, divided by the step.

    Of the survivors, shape (n', n'), and of the task, shape (m, n'): a column a commanded step.
    """
    active, twist = [], []
    for k in survivors:
        plant = rig.plant()
        plant.step(STEP * np.eye(rig.model.nu)[k], rig.settling_s)
        active.append(plant.displacements()[survivors] / STEP)
        twist.append(plant.displacement() / STEP)
    return np.array(active).T, np.array(twist).T[list(rig.task)]


def coast(rig: Probed) -> Array:
    """What keeps moving after a push along each task row, shape (m, m).

    What the actuators hold has come back to rest by then; self-motion coasts. Columns are
    displacements after the wait, during a tenth of it, as fractions of the largest there was.
    """
    coasting = []
    for row in rig.task:
        # How far a first, tiny push leads decides how hard to push.
        _, peak = _pushed(rig, _TRIAL * np.eye(6)[row])
        moved, peak = _pushed(rig, _TRIAL * STEP / peak * np.eye(6)[row])
        coasting.append(moved / peak)
    return np.array(coasting).T[list(rig.task)]


def _pushed(rig: Probed, wrench: Array) -> tuple[Array, float]:
    """Displacement in a tenth of the wait, after it and a short push, and the largest there was."""
    plant, still = rig.plant(), np.zeros(rig.model.nu)
    plant.push(wrench)
    plant.step(still, _PUSH_S)
    plant.push(np.zeros(6))
    at_once = plant.displacement()
    plant.step(still, rig.settling_s)
    before = plant.displacement()
    plant.step(still, max(PERIOD_S, round(0.1 * rig.settling_s, 2)))
    after = plant.displacement()
    return after - before, float(max(np.abs(at_once).max(), np.abs(after).max()))


@dataclass(frozen=True)
class Polygon:
    """The major task driven around a polygon: desired and reached (T, m1), all joints (T, nq).

    `error` is the largest distance at a corner from what the mapping promises, in steps.
    """

    desired: Array
    reached: Array
    qpos: Array
    error: float


def drive_polygon(rig: Probed, kin: Kinematics, rng: np.random.Generator) -> Polygon:
    """Drive the major task around an octagon of radius STEP, then both ways along the others."""
    m1 = len(rig.major)
    angle = 2 * np.pi * (np.arange(CORNERS) / CORNERS + rng.random())
    octagon = np.stack([np.cos(angle), np.sin(angle)], axis=1) @ np.eye(2, m1)
    corners = STEP * np.vstack([octagon, np.eye(m1)[2:], -np.eye(m1)[2:]])
    mapping = kin.velocity_mapping(rig.major, joint_weight=np.ones(len(kin.actuators)))
    plant, periods = rig.plant(), round(rig.settling_s / PERIOD_S)
    twist, qpos = [], []
    for command in kin.expand(mapping(corners)):
        for _ in range(periods):
            plant.step(command, PERIOD_S)
            twist.append(plant.displacement())
            qpos.append(plant.data.qpos.copy())
    reached = np.array(twist)[:, rig.major_rows]
    promised = corners - mapping.residual(corners)
    error = np.abs(reached[periods - 1 :: periods] - promised).max() / STEP
    return Polygon(np.repeat(corners, periods, axis=0), reached, np.array(qpos), float(error))


def hold_force(
    rig: Probed, system: ConstrainedSystem, kin: Kinematics, rng: np.random.Generator
) -> dict[str, float]:
    """How far a force, exerted through the force mapping, is from what was predicted of it.

    A random major force, and a random internal force where there is one.

    Returns:
        torque_error: Servo torques against the mapping's, relative.
        closure_error: What the closures and locks do to the joints, against the constraint forces
            that the kinematics derives from force and torques, relative to the largest of these and
            of what force and torques do to the joints: closures may have nothing to bear.
        yielded_steps: Payload displacement. One servo, alone with its torque, would move one step.
    """
    mapping = kin.force_mapping(rig.major, torque_weight=np.ones(len(kin.actuators)))
    f_major = rng.normal(size=len(rig.major))
    squeeze = rng.normal(size=len(kin.active_constraint)) @ kin.active_constraint
    torques = mapping(f_major, torque=squeeze)
    force = _task_force(rig, mapping, f_major, squeeze)
    gain = rig.model.actuator_gainprm[:, 0]
    # As hard as moves a servo by one step if nothing helps.
    scale = STEP / np.abs(kin.expand(torques) / gain).max()
    torques, force = scale * torques, scale * force
    wrench = np.zeros(6)
    wrench[list(rig.task)] = force
    plant, expected = rig.plant(), kin.expand(torques)
    plant.push(-wrench)
    plant.step(expected / gain, rig.settling_s)  # a servo that stands still exerts gain * command
    stuck = np.eye(system.J_C.shape[1])[system.stuck]  # section 2.3.2: a row for each stuck joint
    closures = np.vstack([system.J_C, stuck]).T @ -kin.constraint_force(force, torques)  # eq. (5)
    bears = (closures, system.J_T.T @ force, torques)
    return {
        "torque_error": _relative(plant.coil_force_n() - expected, torques),
        "closure_error": _relative(plant.constraint_force() - closures, *bears),
        "yielded_steps": float(np.abs(plant.displacement()).max() / STEP),
    }


def _task_force(rig: Probed, mapping: ForceMapping, f_major: Array, squeeze: Array) -> Array:
    """The major force that the mapping attains, and the secondary force that goes with it."""
    force, major = np.zeros(len(rig.task)), list(rig.major)
    force[major] = f_major - mapping.residual(f_major)
    secondary = np.setdiff1d(np.arange(len(force)), major)
    force[secondary] = mapping.secondary_force(f_major, torque=squeeze)
    return force


def _relative(difference: Array, *wholes: Array) -> float:
    """Norm of a difference as a part of the largest of the wholes; zero when all are."""
    size = max(np.linalg.norm(whole) for whole in wholes)
    return float(np.linalg.norm(difference) / size) if size else 0.0


def motion_error(kin: Kinematics, active: Array, moved: Array) -> float:
    """Payload motion against J times the active motion, and that against what the loops allow.

    Relative, each row of the task against its own motion: rotation and translation do not mix.
    """
    forbidden = kin.active_constraint @ active
    off = np.linalg.norm(moved - kin.J @ active, axis=1)
    rows = off / np.maximum(np.linalg.norm(moved, axis=1), VISIBLE)
    return float(max(rows.max(), np.linalg.norm(forbidden) / np.linalg.norm(active)))


def dimension(moved: Array) -> int:
    """Number of directions with a motion that counts."""
    return int((np.linalg.svd(moved, compute_uv=False) > VISIBLE).sum())


def largest_angle(moved: Array, basis: Array) -> float:
    """Sine of the largest angle between what moved and a subspace; zero when nothing moved."""
    size = np.linalg.norm(moved, 2)
    if size < VISIBLE:
        return 0.0
    return float(np.linalg.norm(moved - basis @ (basis.T @ moved), 2) / size)
