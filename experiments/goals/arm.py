"""The serial arm pointing its camera: resolved rates, closed over a tracker in the camera."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import control
import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from experiments.goals.control import weighted_pseudo_inverse
from experiments.goals.demonstration import Outcome, smooth_step
from ftc.controller import DirectDrive, Measurement, PrioritizedController
from ftc.goal import Goal
from ftc.local_mapping import Mapping
from ftc.mapping import PrioritizedMapping
from prioritized import ConstrainedSystem, Kinematics
from sim import HEXAPOD_MJCF, Array, Failure, failed_plant, jacobians, load_model

ARM_MJCF = HEXAPOD_MJCF.with_name("arm.xml")
POINTING = [0, 1]
"""Major rows in payload axes: turns of the camera across its line of sight."""
SECONDARY = [2, 3, 4, 5]
PERIOD_S = 5e-3
LOOP_GAIN_PER_S = 6.0
"""Of the tracker's error, a crossover of 1 Hz: a tenth of the slowest servo mode."""
TRACKER_NOISE_RAD = 1e-4
"""Standard deviation of one sample: a tenth of a pixel, of a thousand over 60 degrees."""
Z = np.array([0.0, 0.0, 1.0])
"""Line of sight at the start, in base axes."""
REST_S = 1.0
"""Of a sweep, at its end."""

JointRates = Callable[[Array, float], Array]
"""Desired joint rates (n',) for the axes (3, n') of the joints that work, and the time [s]."""


@dataclass(frozen=True)
class ArmPosture:
    """The arm as its controller knows it halfway through a control period."""

    command_rad: Array  # joint angles at the start of the period, (7,)
    J_T: Array  # twist of the camera per joint rate in its own axes, (6, 7)
    camera: Array  # its axes in the base's, (3, 3)


class ArmGeometry:
    """The controller's own arm, as :class:`ftc.geometry.Geometry`; its displacements are rates."""

    def __init__(self, model: mujoco.MjModel) -> None:
        """Stand at the nominal pose."""
        self._model, self._data = model, mujoco.MjData(model)
        still = np.zeros(model.nu)
        self.nominal = self._posture(still, still)
        jac = jacobians(model, self._data, site="payload", axes="payload")
        self.system = ConstrainedSystem.of(jac)

    def posture(self, pose: ArmPosture) -> ArmPosture:
        """The pose itself."""
        return pose

    def jacobian(self, posture: ArmPosture) -> Array:
        """The camera's Jacobian, shape (6, 7)."""
        return posture.J_T

    def placed(self, system: ConstrainedSystem, jacobian: Array) -> ConstrainedSystem:
        """The arm where its Jacobian is this."""
        return system.at(J_T=jacobian)

    def twist(self, posture: ArmPosture, displacements_m: Array) -> Array:
        """Twist of the camera (6,) at joint rates (7,)."""
        return posture.J_T @ displacements_m

    def moved(self, pose: ArmPosture, displacements_m: Array) -> ArmPosture:
        """The arm one period later, its joints having moved at these rates (7,)."""
        return self._posture(pose.command_rad + PERIOD_S * displacements_m, displacements_m)

    def _posture(self, command_rad: Array, rates: Array) -> ArmPosture:
        # Halfway through the period: rates held from its start would drift off the curved path.
        self._data.qpos[:] = command_rad + 0.5 * PERIOD_S * rates
        jac = jacobians(self._model, self._data, site="payload", axes="payload")
        base, payload = (self._data.site(name).xmat.reshape(3, 3) for name in ("base", "payload"))
        return ArmPosture(command_rad, jac.J_T, base.T @ payload)


class PseudoInverseArm(PrioritizedMapping[ArmPosture]):
    """The mapping of the arm with a weighted pseudo-inverse, no task before another."""

    def __init__(self, geometry: ArmGeometry, goal: Goal, major_weight: float) -> None:
        """`major_weight` weighs pointing."""
        self._major_weight = major_weight
        super().__init__(geometry, goal, POINTING, [])

    def rates_at(self, kinematics: Kinematics) -> Mapping:
        """The compromise between all tasks."""
        W1 = np.ones(len(kinematics.actuators))
        return weighted_pseudo_inverse(
            kinematics.J, POINTING, [], self._major_weight, joint_weight=W1
        )


def arm_controller(
    model: mujoco.MjModel, locked: Sequence[int], major_weight: float | None
) -> PrioritizedController[ArmPosture]:
    """The controller of the arm: the tracker's error to joint rates; arguments as :func:`sweep`."""
    geometry = ArmGeometry(model)
    goal = Goal(joint_weight=(1.0,) * model.nu, locked_m=dict.fromkeys(locked, 0.0))
    if major_weight is None:
        mapping = PrioritizedMapping(geometry, goal, POINTING, SECONDARY)
    else:
        mapping = PseudoInverseArm(geometry, goal, major_weight)
    proportional = control.ss([], [], [], LOOP_GAIN_PER_S, PERIOD_S)
    return PrioritizedController(
        [proportional] * len(POINTING), mapping, DirectDrive(), handover_s=0.0
    )


def sweep(
    *,
    axis_rad: float,
    angle_rad: float,
    duration_s: float,
    locked: Sequence[int],
    rates: JointRates | None,
    major_weight: float | None,
    seed: int,
) -> Outcome:
    """Turn the line of sight about one axis across it, joints moving as little as they can.

    Args:
        axis_rad: Direction of the axis, from x_b towards y_b.
        angle_rad: How far.
        duration_s: Of the run; it ends with a rest.
        locked: Joints that are stuck from the start, and known to be.
        rates: The secondary goal, theta_ad of eq. (24), if any; W1 is the identity.
        major_weight: Of pointing in a weighted pseudo-inverse; None: it comes first.
        seed: Of the tracker's noise.

    Returns:
        The run; its error is [about the axis of the sweep, across it], its measure the condition
        number of the pointing Jacobian.

    Raises:
        sim.SimulationDiverged: The physics left the finite numbers.
    """
    model = load_model(ARM_MJCF)
    plant = failed_plant(model, [Failure(joint, "locked") for joint in locked])
    controller, rng = arm_controller(model, locked, major_weight), np.random.default_rng(seed)
    working = [joint for joint in range(model.nu) if joint not in locked]
    # Servos lag behind by their damping over their stiffness: they are sent ahead by as much.
    lead_s = -model.actuator_biasprm[:, 2] / model.actuator_gainprm[:, 0]
    time_s = np.arange(round(duration_s / PERIOD_S)) * PERIOD_S
    axis = np.array([np.cos(axis_rad), np.sin(axis_rad), 0.0])
    turned = angle_rad * smooth_step(np.append(time_s, duration_s) / (duration_s - REST_S))
    views = Rotation.from_rotvec(turned[:, None] * axis).apply(Z)
    state, ticks = controller.start(), []
    for k, now in enumerate(time_s):
        pose = plant.pose().rotation
        off, across = np.cross(pose[:, 2], views[k]), np.cross(axis, views[k])
        # Drawn in the axes of the sweep: the same noise, however the camera is rolled.
        noise = np.stack([axis, across], axis=1) @ rng.standard_normal(2)
        tracked = (pose.T @ (off + TRACKER_NOISE_RAD * noise))[:2]
        arm = controller.estimate(state)
        ahead = arm.camera.T @ np.cross(views[k], views[k + 1] - views[k]) / PERIOD_S
        rates_d = np.zeros(model.nu)
        if rates is not None:
            rates_d[working] = rates(arm.J_T[:3, working], float(now))
        measurement = Measurement(
            -tracked, np.zeros(0)
        )  # of the error itself: its reference is zero
        state = controller.step(
            state, np.zeros(2), measurement, rates_d, feedforward=ahead[:2], pose=arm
        )
        speed = state.input_percent
        command = arm.command_rad + PERIOD_S * speed
        plant.step(command + lead_s * speed, PERIOD_S)
        J_m = arm.J_T[np.ix_(POINTING, working)]
        kept = {
            "error_rad": np.array([off @ axis, off @ across]),
            "closure_residual_m": plant.closure_residual_m(),
            "singular_values": np.linalg.svd(J_m, compute_uv=False),
            "joint_rates_rad_per_s": speed,
            "joint_command_rad": command,
            "joint_rad": plant.displacements(),
        }
        ticks.append(kept)
    arrays = {name: np.array([tick[name] for tick in ticks]) for name in ticks[0]}
    error_rad, closure_m = arrays.pop("error_rad"), arrays.pop("closure_residual_m")
    condition_number = arrays["singular_values"][:, 0] / arrays["singular_values"][:, -1]
    return Outcome(time_s, error_rad, condition_number, float(closure_m.max()), arrays)
