"""The serial arm pointing its camera: resolved rates, closed over a tracker in the camera."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from experiments.goals.control import weighted_pseudo_inverse
from experiments.goals.demonstration import Outcome, smooth_step
from experiments.hexapod.mapping import Mapping
from prioritized import ConstrainedSystem, Kinematics
from sim import HEXAPOD_MJCF, Array, Failure, failed_plant, jacobians, load_model

ARM_MJCF = HEXAPOD_MJCF.with_name("arm.xml")
POINTING = [0, 1]
"""Major rows in payload axes: turns of the camera across its line of sight."""
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
class Tick:
    """What is kept of one control period; see :func:`sweep` for the units."""

    error_rad: Array
    singular_values: Array
    rates: Array
    command_rad: Array
    joint_rad: Array
    closure_residual_m: float


class OwnArm:
    """The controller's own arm, at the joint angles that it commands."""

    def __init__(self, model: mujoco.MjModel, locked: Sequence[int]) -> None:
        """`locked`: joints known to be stuck."""
        self._model, self._data, self._locked = model, mujoco.MjData(model), list(locked)

    def at(self, joint_rad: Array) -> tuple[Kinematics, Array]:
        """Kinematics in payload axes (6, n'), and the payload's axes in the base's, (3, 3)."""
        self._data.qpos[:] = joint_rad
        jac = jacobians(self._model, self._data, site="payload", axes="payload")
        system = ConstrainedSystem(jac.J_T, jac.J_C, jac.active).with_failures(self._locked)
        base, payload = (self._data.site(name).xmat.reshape(3, 3) for name in ("base", "payload"))
        return system.kinematics(), base.T @ payload


def sweep(
    *,
    axis_rad: float,
    angle_rad: float,
    duration_s: float,
    locked: Sequence[int],
    rates: JointRates,
    major_weight: float | None,
    seed: int,
) -> Outcome:
    """Turn the line of sight about one axis across it, joints moving as little as they can.

    Args:
        axis_rad: Direction of the axis, from x_b towards y_b.
        angle_rad: How far.
        duration_s: Of the run; it ends with a rest.
        locked: Joints that are stuck from the start, and known to be.
        rates: The secondary goal, theta_ad of eq. (24); W1 is the identity.
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
    own, rng = OwnArm(model, locked), np.random.default_rng(seed)
    # Servos lag behind by their damping over their stiffness: they are sent ahead by as much.
    lead_s = -model.actuator_biasprm[:, 2] / model.actuator_gainprm[:, 0]
    time_s = np.arange(round(duration_s / PERIOD_S)) * PERIOD_S
    axis = np.array([np.cos(axis_rad), np.sin(axis_rad), 0.0])
    turned = angle_rad * smooth_step(np.append(time_s, duration_s) / (duration_s - REST_S))
    views = Rotation.from_rotvec(turned[:, None] * axis).apply(Z)
    command, speed, ticks = np.zeros(model.nu), np.zeros(model.nu), []
    for k, now in enumerate(time_s):
        pose = plant.pose().rotation
        off, across = np.cross(pose[:, 2], views[k]), np.cross(axis, views[k])
        # Drawn in the axes of the sweep: the same noise, however the camera is rolled.
        noise = np.stack([axis, across], axis=1) @ rng.standard_normal(2)
        tracked = (pose.T @ (off + TRACKER_NOISE_RAD * noise))[:2]
        # Halfway through the period: rates held from its start would drift off the curved path.
        kin, payload = own.at(command + 0.5 * PERIOD_S * speed)
        ahead = payload.T @ np.cross(views[k], views[k + 1] - views[k]) / PERIOD_S
        wanted = ahead[:2] + LOOP_GAIN_PER_S * tracked
        speed = kin.expand(_mapping(kin, major_weight)(wanted, rates(kin.J[:3], float(now))))
        command = command + PERIOD_S * speed
        plant.step(command + lead_s * speed, PERIOD_S)
        ticks.append(
            Tick(
                error_rad=np.array([off @ axis, off @ across]),
                singular_values=np.linalg.svd(kin.J[POINTING], compute_uv=False),
                rates=speed,
                command_rad=command,
                joint_rad=plant.strut_displacement_m(),
                closure_residual_m=plant.closure_residual_m(),
            )
        )
    return _outcome(time_s, ticks)


def _mapping(kin: Kinematics, major_weight: float | None) -> Mapping:
    W1 = np.ones(len(kin.actuators))
    if major_weight is None:
        return kin.velocity_mapping(POINTING, joint_weight=W1)
    return weighted_pseudo_inverse(kin.J, POINTING, [], major_weight, joint_weight=W1)


def _outcome(time_s: Array, ticks: Sequence[Tick]) -> Outcome:
    singular_values = np.array([tick.singular_values for tick in ticks])
    return Outcome(
        time_s=time_s,
        error_rad=np.array([tick.error_rad for tick in ticks]),
        measure=singular_values[:, 0] / singular_values[:, -1],
        closure_residual_max_m=max(tick.closure_residual_m for tick in ticks),
        arrays={
            "singular_values": singular_values,
            "joint_rates_rad_per_s": np.array([tick.rates for tick in ticks]),
            "joint_command_rad": np.array([tick.command_rad for tick in ticks]),
            "joint_rad": np.array([tick.joint_rad for tick in ticks]),
        },
    )
