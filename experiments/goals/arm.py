"""The serial arm pointing its camera: resolved rates, closed over a tracker in the camera."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from operator import attrgetter

import control
import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from experiments.goals.demonstration import Outcome
from experiments.rig.arm import ARM_MJCF, POINTING, SECONDARY, camera_axes, smooth_step
from experiments.rig.compromise import CompromisingMapping
from ftc.control.mapping import PrioritizedMapping
from ftc.controller import DirectDrive, Measurement, PrioritizedController
from ftc.goal import Goal
from ftc.loop import run_loop
from ftc.oracle import NestedState
from prioritized import ConstrainedSystem
from sim import (
    Array,
    Bench,
    Failure,
    JacobianReader,
    Jacobians,
    Plant,
    Pose,
    Reading,
    load_model,
)

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
    jacobians: Jacobians  # twist of the camera per joint rate in its own axes
    camera: Array  # its axes in the base's, (3, 3)


class ArmGeometry:
    """The controller's own arm, as :class:`.Geometry`; its displacements are rates."""

    def __init__(self, model: mujoco.MjModel) -> None:
        """Stand at the nominal pose."""
        self._data = mujoco.MjData(model)
        self._reader = JacobianReader(model, site="payload", axes="payload")
        self.system = ConstrainedSystem.of(self._reader.at(self._data))
        still = np.zeros(model.nu)
        self.nominal = self._posture(still, still)

    def posture(self, pose: ArmPosture) -> ArmPosture:
        """The pose itself."""
        return pose

    def jacobians(self, posture: ArmPosture) -> Jacobians:
        """Of the camera."""
        return posture.jacobians

    def twist(self, posture: ArmPosture, displacements: Array) -> Array:
        """Twist of the camera (6,) at joint rates (7,)."""
        return posture.jacobians.J_T @ displacements

    def moved(self, pose: ArmPosture, displacements: Array) -> ArmPosture:
        """The arm one period later, its joints having moved at these rates (7,)."""
        return self._posture(pose.command_rad + PERIOD_S * displacements, displacements)

    def _posture(self, command_rad: Array, rates: Array) -> ArmPosture:
        # Halfway through the period: rates held from its start would drift off the curved path.
        self._data.qpos[:] = command_rad + 0.5 * PERIOD_S * rates
        there = self._reader.at(self._data)
        return ArmPosture(command_rad, there, camera_axes(self._data))


class PseudoInverseArm(CompromisingMapping[ArmPosture]):
    """The mapping of the arm with a weighted pseudo-inverse."""

    def __init__(self, geometry: ArmGeometry, goal: Goal, major_weight: float) -> None:
        """`major_weight` weighs pointing."""
        self.major_weight = major_weight
        super().__init__(geometry, goal, POINTING, [])


def arm_controller(
    model: mujoco.MjModel, locked: Sequence[int], major_weight: float | None
) -> PrioritizedController[ArmPosture]:
    """The controller of the arm: the tracker's error to joint rates; arguments as :func:`sweep`."""
    geometry = ArmGeometry(model)
    goal = Goal(joint_weight=(1.0,) * model.nu, locked_at=dict.fromkeys(locked, 0.0))
    if major_weight is None:
        mapping = PrioritizedMapping(geometry, goal, POINTING, SECONDARY)
    else:
        mapping = PseudoInverseArm(geometry, goal, major_weight)
    proportional = control.ss([], [], [], LOOP_GAIN_PER_S, PERIOD_S)
    return PrioritizedController(
        [proportional] * len(POINTING), mapping, DirectDrive(), handover_s=0.0
    )


@dataclass(frozen=True)
class FollowerState(NestedState):
    """Beside it, the number of ticks so far."""

    ticks: int


@dataclass(frozen=True)
class Follower:
    """Follows a target whose path is known, and desired joint rates as far as that leaves free."""

    controller: PrioritizedController[ArmPosture]
    turns_rad: Array  # of the line of sight to the target in each period, base axes, (N, 3)
    rates: JointRates | None
    working: Sequence[int]

    def start(self) -> FollowerState:
        """At rest at the nominal pose."""
        return FollowerState(self.controller.start(), ticks=0)

    def step(
        self, state: FollowerState, reference: Array, measurement: Measurement
    ) -> FollowerState:
        """One control tick."""
        arm, tick = self.controller.estimate(state.controller), state.ticks
        rates_d = np.zeros(self.controller.mapping.actuators)
        if self.rates is not None:
            rates_d[self.working] = self.rates(arm.jacobians.J_T[:3, self.working], tick * PERIOD_S)
        ahead = arm.camera.T @ self.turns_rad[tick] / PERIOD_S
        controller = self.controller.step(
            state.controller, reference, measurement, rates_d, feedforward=ahead[:2], pose=arm
        )
        return FollowerState(controller, tick + 1)


class Tracker:
    """The tracker in the camera, as :class:`.Sensors`; it sees the target once a tick."""

    def __init__(self, views: Array, axis: Array, seed: int) -> None:
        """See the target along unit vectors (N, 3), which turn about an axis (3,); base axes."""
        self._views, self._axis = iter(views), axis
        self._rng = np.random.default_rng(seed)

    def read(self, pose: Pose, displacements: Array) -> Reading:
        """How far the line of sight is turned from the target, (2,) in camera axes, with noise."""
        view = next(self._views)
        off, across = np.cross(pose.rotation[:, 2], view), np.cross(self._axis, view)
        # Drawn in the axes of the sweep: the same noise, however the camera is rolled.
        noise = np.stack([self._axis, across], axis=1) @ self._rng.standard_normal(2)
        to_target = pose.rotation.T @ (off + TRACKER_NOISE_RAD * noise)
        return Reading(-to_target[:2], displacements)


class Servos:
    """From joint rates (7,) to the commands of the position servos, once a period."""

    def __init__(self, model: mujoco.MjModel) -> None:
        """Stand at the nominal pose."""
        # Servos lag behind by their damping over their stiffness: they are sent ahead by as much.
        self._lead_s = -model.actuator_biasprm[:, 2] / model.actuator_gainprm[:, 0]
        self._command_rad = np.zeros(model.nu)

    def __call__(self, rates: Array) -> Array:
        """The joint angles at the end of the period, and further by the lag of the servos."""
        self._command_rad = self._command_rad + PERIOD_S * rates
        return self._command_rad + self._lead_s * rates


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
    working = [joint for joint in range(model.nu) if joint not in locked]
    time_s = np.arange(round(duration_s / PERIOD_S)) * PERIOD_S
    axis = np.array([np.cos(axis_rad), np.sin(axis_rad), 0.0])
    turned = angle_rad * smooth_step(np.append(time_s, duration_s) / (duration_s - REST_S))
    views = Rotation.from_rotvec(turned[:, None] * axis).apply(Z)
    now, then = views[:-1], views[1:]
    plant = Plant(model)
    bench = Bench(
        plant,
        Tracker(now, axis, seed),
        time_s=time_s,
        period_s=PERIOD_S,
        failures=[Failure(joint, "locked") for joint in locked],
        drives=Servos(model),
    )
    pilot = arm_controller(model, locked, major_weight)
    follower = Follower(pilot, np.cross(now, then - now), rates, working)
    # The tracker measures the error itself: its reference is zero.
    still = np.zeros((len(time_s), len(POINTING)))
    run = run_loop(bench, follower, still, keeps=attrgetter("pose"))
    off = np.cross(bench.rotation[:, :, 2], now)
    J_m = np.array([arm.jacobians.J_T for arm in run.kept])[:, POINTING][:, :, working]
    singular_values = np.linalg.svd(J_m, compute_uv=False)
    started_rad = np.array([arm.command_rad for arm in run.kept])
    return Outcome(
        time_s=time_s,
        error_rad=np.stack([np.vecdot(off, axis), np.vecdot(off, np.cross(axis, now))], axis=1),
        measure=singular_values[:, 0] / singular_values[:, -1],
        closure_residual_max_m=max(bench.closure_residual_m.max(), plant.closure_residual_m()),
        arrays={
            "singular_values": singular_values,
            "joint_rates_rad_per_s": run.inputs,
            "joint_command_rad": started_rad + PERIOD_S * run.inputs,
            # At the end of each period, as the commands.
            "joint_rad": np.vstack([bench.displacement[1:], plant.displacements()]),
        },
    )
