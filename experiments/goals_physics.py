"""Simulations for the study `goals`: four secondary goals, and controllers that pursue them."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from operator import attrgetter

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from fjh.rig.arm import ARM_MJCF, POINTING, camera_axes, smooth_step
from fjh.rig.compromise import compromising, weighted_pseudo_inverse
from fjh.rig.hexapod.closed_form import hexapod
from fjh.rig.hexapod.coil import Coils
from fjh.rig.hexapod.columns import MAJOR, SECONDARY, hexapod_arrays
from fjh.rig.hexapod.controller import Loop, StrutMapping
from fjh.rig.hexapod.detector import pointing_angles
from fjh.rig.hexapod.forward import forward_kinematics
from fjh.rig.hexapod.rig import hexapod_rig
from fjh.rig.hexapod.testbed import Testbed, TestbedConfig
from fjh.rig.run import Run
from ftc import Goal, Measurement, NestedState, PrioritizedController, run_loop
from prioritized import ConstrainedSystem
from sim import HEXAPOD_MJCF, Array, Bench, Failure, JacobianReader, Plant, Pose, load_model
from sim.plant import Reading

BENCH = TestbedConfig()
EQUAL = Goal(joint_weight=(1.0,) * 6)
SLEW_S = 3.0  # duration of the slew from the axis to the target
STRIDE = 10  # ticks between poses at which the clearance is computed
RELAX_S = 0.2  # time constant of a retreat: slower than pointing, faster than the slew

# Reliability. Struts 1 and 4 do most of the work, 84 % of their current. Their winding is light,
# 10 g of copper for 80 W, so that it heats within 16 s; strut 1 has lost a third of its heat path.
HOT_TARGET_URAD = (2771.0, 1600.0)
COILS = Coils(
    resistance_ohm=5.0,
    heat_capacity_j_per_k=4.0,
    thermal_resistance_k_per_w=np.array([2.2, 1.5, 1.5, 1.5, 1.5, 1.5]),
    ambient_c=20.0,
)
LIMIT_C, WARM_C, HEAVIEST = 90.0, 60.0, 10.0  # weights rise from 1 at WARM_C to HEAVIEST
REWEIGH_TICKS = 10  # with 20 the steps of the weights change the pointing visibly

# Stroke. The displacements of least norm are 664 um at struts 1 and 4, beyond their stops.
FAR_TARGET_URAD = (3464.0, 2000.0)
ACTIVE = 0.82  # fraction of the stroke beyond which a strut retreats
LONGER = 1.5  # stroke of the machine of the reference run, in strokes of the hexapod

# Obstacle. The mirror cell moves 0.3 mm towards it. Strut 1 is locked at its centre: with six
# struts all secondary velocities are possible, and a pseudo-inverse makes no compromise.
OBSTRUCTED_TARGET_URAD = (2000.0, 0.0)
GAP_M, RADIUS_M, SAFE_M = 0.25e-3, 0.02, 0.1e-3  # the payload retreats below the safe clearance
LOCKED_STRUT = 0
OBSTRUCTED = Goal(secondary_weight=(1.0,) * 4, locked_at={LOCKED_STRUT: 0.0})
FARTHEST_M = 1.0  # beyond any distance here

# Singularity. The healthy arm does not come near one of pointing; with its shoulder locked it does
# where the line of sight is along the forearm. In a sweep about this axis, from x_b towards y_b,
# the line of sight passes near the forearm when the wrist's pitch axis is parallel to the elbow's.
SHOULDER, AXIS_DEG, ANGLE_RAD = (0, 1, 2), 133.5, 2.2
GAIN_PER_S = 0.5  # of the manipulability's slope: slower than servos, faster than the sweep
FADE_S = 2.0  # fade-in of the secondary goal: a step of the desired rates would excite the servos
PERIOD_S, REST_S = 5e-3, 1.0  # period of the arm's controller; rest at the end of the sweep
LOOP_GAIN_PER_S = 6.0  # a crossover of 1 Hz: a tenth of the slowest servo mode
TRACKER_NOISE_RAD = 1e-4  # of one sample: a tenth of a pixel, of a thousand over 60 degrees


@dataclass(frozen=True)
class Strategy:
    """Treatment of the secondary goal in one run.

    Attributes:
        name: Name in `goals.json`.
        pursues: Whether the goal is pursued.
        major_weight: Weight of pointing in a weighted pseudo-inverse; None: strict priority.
        limited: Whether there is something to avoid: stop, obstacle, locked shoulder.
        seed: Seed of the sensor noise.
    """

    name: str
    pursues: bool
    major_weight: float | None
    limited: bool
    seed: int


@dataclass(frozen=True)
class GoalRun:
    """Results of one run of N ticks.

    Attributes:
        time_s: Time, (N,).
        error_rad: Desired minus true pointing, (N, 2).
        measure: Measure of the secondary goal, (N,).
        closure_residual_max_m: Largest gap of a closed loop.
        arrays: Further logged arrays, by name.
    """

    time_s: Array
    error_rad: Array
    measure: Array
    closure_residual_max_m: float
    arrays: dict[str, Array]


Loops = tuple[Loop, Loop]
Rates = Callable[[Array, Pose], Array]
"""Type of functions from commanded strut displacements (6,) and estimated payload pose to desired
strut rates (6,) [m]/[s], theta_ad of eq. (24)."""


# Desired rates and weights of the goals.


def rates_from_stops(displacements_m: Array, stroke_m: float) -> Array:
    """Return desired strut rates (6,) [m]/[s] away from stops, zero if no stop is near.

    They are the negative gradient of half the sum of squared displacements beyond a fraction of the
    stroke, divided by a time constant; after Chaumette and Marchand (2000), reference [3].
    """
    beyond = np.maximum(0.0, np.abs(displacements_m) - ACTIVE * stroke_m)
    return -np.sign(displacements_m) * beyond / RELAX_S


def cluttered() -> mujoco.MjModel:
    """Return the hexapod with a sphere next to its mirror cell; contact is as stiff as loops.

    The sphere is on the y axis of the world, at the height of the cell's centre.
    """
    spec = mujoco.MjSpec.from_file(str(HEXAPOD_MJCF))
    cell = spec.geom("mirror_cell")
    middle = np.array(spec.body("payload").pos) + np.array(cell.pos)
    spec.worldbody.add_geom(
        name="obstacle",
        type=mujoco.mjtGeom.mjGEOM_SPHERE,
        size=[RADIUS_M, 0, 0],
        pos=middle + np.array([0, cell.size[0] + GAP_M + RADIUS_M, 0]),
        contype=1,
        conaffinity=1,
        condim=1,
        priority=1,
        solref=[2.5e-4, 1],
        solimp=[0.9999, 0.9999, 0.001, 0.5, 2],
    )
    cell.contype = cell.conaffinity = 1
    spec.option.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    return spec.compile()


class Clearance:
    """Function from the payload's pose to its distance from the obstacle and the direction away."""

    def __init__(self, model: mujoco.MjModel) -> None:
        """Take the model of :func:`cluttered`."""
        self._model, self._data = model, mujoco.MjData(model)
        mujoco.mj_kinematics(model, self._data)
        self._to_world = self._data.site("base").xmat.reshape(3, 3).copy()
        self._joint = model.jnt_qposadr[model.joint("payload").id]
        self._obstacle, self._cell = model.geom("obstacle").id, model.geom("mirror_cell").id

    def __call__(self, pose: Pose) -> tuple[float, Array]:
        """Return the clearance [m], negative for overlap, and direction (3,) away, in base axes."""
        turn, at = self._to_world @ pose.rotation @ self._to_world.T, self._joint
        self._data.qpos[:] = self._model.qpos0
        self._data.qpos[at : at + 3] += self._to_world @ pose.translation_m
        mujoco.mju_mat2Quat(self._data.qpos[at + 3 : at + 7], turn.ravel())
        mujoco.mj_kinematics(self._model, self._data)
        nearest = np.zeros(6)  # on the obstacle, on the cell
        distance = mujoco.mj_geomDistance(
            self._model, self._data, self._obstacle, self._cell, FARTHEST_M, nearest
        )
        away = nearest[3:] - self._data.geom_xpos[self._obstacle]
        return distance, self._to_world.T @ (away / np.linalg.norm(away))


def retreat(clearance: Clearance, pose: Pose) -> Array:
    """Return the desired secondary velocity [t_x, t_y, t_z, gamma], v_sd of eq. (24), in base axes.

    It is the negative gradient by translation of half the squared deficit to the safe clearance,
    divided by a time constant, [m]/[s]; gamma is zero.
    """
    distance, away = clearance(pose)
    return np.append(max(0.0, SAFE_M - distance) / RELAX_S * away, 0.0)


def manipulability(axes: Array) -> float:
    """Return Yoshikawa's measure sqrt(det(J_m J_m^T)) of pointing, J_m the first rows of `axes`.

    Args:
        axes: Directions of the joints in payload axes, from the base outwards, shape (3, n).
    """
    J_m = axes[:2]
    return float(np.sqrt(np.linalg.det(J_m @ J_m.T)))


def manipulability_gradient(axes: Array) -> Array:
    """Return the gradient of :func:`manipulability` by the joint angles (n,) of a serial arm.

    In payload axes, joint j turns the axes a_i of all joints before it at the rate -a_j x a_i, and
    of none after it. The measure w has the differential dw = w tr(J_m^+ dJ_m).
    """
    J_m, n = axes[:2], axes.shape[1]
    turned = -np.cross(axes[:, :, None], axes[:, None, :], axis=0)[:2]  # (2, j, i)
    turned *= np.tri(n, k=-1)  # only axes i before joint j
    return manipulability(axes) * np.einsum("ir,rji->j", np.linalg.pinv(J_m), turned)


# The hexapod.


def controller_for(
    testbed: Testbed, major_weight: float | None, goal: Goal
) -> PrioritizedController[Pose]:
    """Return the hexapod's controller for a goal, with the mapping or a weighted pseudo-inverse.

    The Jacobian is constant; within the stroke its pointing error is less than that by noise.
    """
    strict = major_weight is None
    allocate = None if strict else compromising(goal, MAJOR, SECONDARY, major_weight)
    mapping = StrutMapping(hexapod(testbed.model), goal, "constant", allocate=allocate)
    amplifier, handover_s = testbed.amplifier(), testbed.bench.handover_s
    return PrioritizedController(testbed.loops, mapping, amplifier, handover_s)


def without_roll(measurement: Measurement, pose: Pose) -> Measurement:
    """Correct a reading of the detector for the roll of the payload.

    The detector turns with the payload, so that roll moves a spot off the axis at constant
    pointing. The correction is pointing minus reading at the estimated pose.
    """
    read, pointed = -pointing_angles(pose.rotation.T), pointing_angles(pose.rotation)
    return Measurement(measurement.output - read + pointed, measurement.displacement)


def no_rates(displacements_m: Array, pose: Pose) -> Array:
    """Return desired strut rates of zero, for runs without a secondary goal."""
    return np.zeros_like(displacements_m)


@dataclass(frozen=True)
class SeekerState(NestedState):
    """State of a :class:`Seeker` and of its controller.

    Attributes:
        secondary_reference: Integral of the desired strut rates, (6,).
        temperature_c: Estimated coil temperatures, (6,).
        steering: Controller with the current weights.
    """

    secondary_reference: Array
    temperature_c: Array
    steering: PrioritizedController[Pose]


@dataclass(frozen=True)
class Seeker:
    """Controller that points, and pursues a secondary goal as far as pointing allows.

    Attributes:
        controller_for: Function from weights to a controller.
        goal: Initial weights.
        rates: Function for the desired strut rates.
        reweighs: Whether the weights follow the coil temperatures, estimated from the commanded
            currents with a thermal model.
    """

    controller_for: Callable[[Goal], PrioritizedController[Pose]]
    goal: Goal = EQUAL
    rates: Rates = no_rates
    reweighs: bool = False

    def start(self) -> SeekerState:
        """Return the state at rest, at the nominal pose, with cold coils."""
        steering = self.controller_for(self.goal)
        return SeekerState(steering.start(), 0, np.zeros(6), COILS.cold(), steering)

    def step(self, state: SeekerState, reference: Array, measurement: Measurement) -> SeekerState:
        """Perform one control tick."""
        steering, drives, period_s = state.steering, state.steering.drives, BENCH.control_period_s
        temperature_c = COILS.step(state.temperature_c, drives.current_a(state.inputs), period_s)
        if self.reweighs and state.ticks % REWEIGH_TICKS == 0:
            heat = smooth_step((temperature_c - WARM_C) / (LIMIT_C - WARM_C))
            weights = 1.0 + (HEAVIEST - 1.0) * heat
            steering = self.controller_for(Goal(joint_weight=tuple(weights)))
        moved_m = period_s * self.rates(drives.displacements(state.inputs), state.pose)
        reference_m = state.secondary_reference + moved_m
        corrected = without_roll(measurement, state.pose)
        controller = steering.step(state.controller, reference, corrected, reference_m)
        return SeekerState(controller, state.ticks + 1, reference_m, temperature_c, steering)


def target_path(target_urad: tuple[float, float], duration_s: float) -> Array:
    """Return a path (N, 2) [rad]: a slew to where a target is expected, then a spiral there."""
    time_s = BENCH.time_s(duration_s)
    path = smooth_step(time_s / SLEW_S)[:, None] * 1e-6 * np.array(target_urad)
    searching = time_s >= SLEW_S
    search = replace(BENCH, duration_s=duration_s - SLEW_S)
    path[searching] += search.desired_rad(time_s[searching] - SLEW_S)
    return path


def simulate_reliability(strategy: Strategy, duration_s: float, loops: Loops) -> GoalRun:
    """Simulate a search for a target where two coils become hot."""
    testbed = Testbed(load_model(), BENCH, loops)
    make_controller = partial(controller_for, testbed, strategy.major_weight)
    path = target_path(HOT_TARGET_URAD, duration_s)
    seeker = Seeker(make_controller, reweighs=strategy.pursues)
    run = hexapod_rig(testbed).fly(seeker, path, seed=strategy.seed)
    current_a = testbed.amplifier().current_a(run.inputs)
    temperature_c = COILS.temperatures_c(current_a, BENCH.control_period_s)
    return _goal_run(run, temperature_c.max(axis=1), temperature_c=temperature_c)


def simulate_stroke(strategy: Strategy, duration_s: float, loops: Loops) -> GoalRun:
    """Simulate a search for a target where two struts reach their stops."""
    model = load_model()
    stroke_m = float(model.jnt_range[model.actuator_trnid[0, 0], 1])
    testbed = Testbed(model, BENCH, loops)
    if not strategy.limited:
        testbed = testbed.scaled(stroke=LONGER)
    make_controller = partial(controller_for, testbed, strategy.major_weight)
    seeker = Seeker(make_controller)
    if strategy.pursues:
        seeker = replace(seeker, rates=lambda at_m, _: rates_from_stops(at_m, stroke_m))
    path = target_path(FAR_TARGET_URAD, duration_s)
    run = hexapod_rig(testbed).fly(seeker, path, seed=strategy.seed)
    return _goal_run(run, 1e6 * (stroke_m - np.abs(run.displacement).max(axis=1)))


def simulate_obstacle(strategy: Strategy, duration_s: float, loops: Loops) -> GoalRun:
    """Simulate a search for a target where the payload comes near an obstacle."""
    obstructed = cluttered()
    model, clearance = obstructed if strategy.limited else load_model(), Clearance(obstructed)
    testbed = Testbed(model, BENCH, loops)
    make_controller = partial(controller_for, testbed, strategy.major_weight)
    controller = make_controller(OBSTRUCTED)
    kinematics = controller.mapping.at(controller.mapping.nominal).kinematics
    # Strut rates that give the payload v_sd without regard to pointing: J_s times them is v_sd.
    struts = kinematics.expand(np.linalg.pinv(kinematics.J[SECONDARY]).T).T
    seeker = Seeker(make_controller, OBSTRUCTED)
    if strategy.pursues:
        seeker = replace(seeker, rates=lambda _, pose: struts @ retreat(clearance, pose))
    path = target_path(OBSTRUCTED_TARGET_URAD, duration_s)
    failures = [Failure(LOCKED_STRUT, "locked")]
    run = hexapod_rig(testbed).fly(seeker, path, failures=failures, seed=strategy.seed)
    poses = forward_kinematics(hexapod(model), run.displacement[::STRIDE])
    pairs = zip(poses.rotation, poses.translation_m, strict=True)
    clear_m = [clearance(Pose(*pose))[0] for pose in pairs]
    return _goal_run(run, 1e6 * np.repeat(clear_m, STRIDE)[: len(run.time_s)])


def _goal_run(run: Run, measure: Array, **arrays: Array) -> GoalRun:
    logged = {name: values for name, values in hexapod_arrays(run).items() if name != "time_s"}
    return GoalRun(run.time_s, run.error, measure, run.closure_max_m, logged | arrays)


# The serial arm, which points its camera: resolved rates with feedback from a tracker.


@dataclass(frozen=True)
class ArmState:
    """State of an :class:`ArmController` after a tick.

    Attributes:
        inputs: Commanded joint rates, (7,).
        start_rad: Joint angles at the start of the period, (7,).
        J_T: Jacobian of the camera's twist in camera axes, halfway through the period, (6, 7).
        ticks: Number of ticks so far.
    """

    inputs: Array
    start_rad: Array
    J_T: Array
    ticks: int


class ArmController:
    """Controller that points the camera at a target with known path; W1 is the identity.

    If the strategy pursues the goal, it increases the manipulability as far as pointing allows.
    """

    def __init__(self, model: mujoco.MjModel, turns_rad: Array, strategy: Strategy) -> None:
        """Take the desired rotation of the line of sight in each period (N, 3), in base axes."""
        self._turns_rad, self._strategy = turns_rad, strategy
        self._data = mujoco.MjData(model)
        self._reader = JacobianReader(model, site="payload", axes="payload")
        healthy = ConstrainedSystem.of(self._reader.at(self._data))
        self._system = healthy.with_failures(locked=SHOULDER if strategy.limited else ())

    def start(self) -> ArmState:
        """Return the state at rest at the nominal pose."""
        n = len(self._data.qpos)
        return ArmState(np.zeros(n), np.zeros(n), np.zeros((6, n)), ticks=0)

    def step(self, state: ArmState, reference: Array, measurement: Measurement) -> ArmState:
        """Perform one control tick."""
        start_rad = state.start_rad + PERIOD_S * state.inputs
        # Halfway through the period: the Jacobian at its start would cause a drift.
        self._data.qpos[:] = start_rad + 0.5 * PERIOD_S * state.inputs
        J_T = self._reader.at(self._data).J_T
        kinematics = self._system.at(J_T=J_T).kinematics()
        ahead = camera_axes(self._data).T @ self._turns_rad[state.ticks] / PERIOD_S
        pointing = ahead[:2] + LOOP_GAIN_PER_S * (reference - measurement.output)
        W1, weight = np.ones(len(kinematics.actuators)), self._strategy.major_weight
        if weight is None:
            mapping = kinematics.velocity_mapping(POINTING, joint_weight=W1)
        else:
            mapping = weighted_pseudo_inverse(kinematics.J, POINTING, [], weight, W1)
        rates_d = np.zeros(len(W1))
        if self._strategy.pursues:
            uphill = manipulability_gradient(J_T[:3, kinematics.actuators])
            rates_d = GAIN_PER_S * smooth_step(state.ticks * PERIOD_S / FADE_S) * uphill
        rates = kinematics.expand(mapping(pointing, rates_d))
        return ArmState(rates, start_rad, J_T, state.ticks + 1)


class Tracker:
    """Tracker in the camera that measures the target once per tick, a :class:`.Sensors`."""

    def __init__(self, views: Array, axis: Array, seed: int) -> None:
        """Take the directions of the target (N, 3) and the axis of the sweep (3,), in base axes."""
        self._views, self._axis = iter(views), axis
        self._rng = np.random.default_rng(seed)

    def read(self, pose: Pose, displacements: Array) -> Reading:
        """Return the noisy rotation of the line of sight from the target, (2,), in camera axes."""
        view = next(self._views)
        deviation, across = np.cross(pose.rotation[:, 2], view), np.cross(self._axis, view)
        # Sampled in the axes of the sweep: the noise does not depend on the camera's roll.
        noise = np.stack([self._axis, across], axis=1) @ self._rng.standard_normal(2)
        to_target = pose.rotation.T @ (deviation + TRACKER_NOISE_RAD * noise)
        return Reading(-to_target[:2], displacements)


class Servos:
    """Drives from joint rates (7,) to commands of position servos, called once per period."""

    def __init__(self, model: mujoco.MjModel) -> None:
        """Start at the nominal pose."""
        # The lag of a servo, damping over stiffness, is compensated by a lead.
        self._lead_s = -model.actuator_biasprm[:, 2] / model.actuator_gainprm[:, 0]
        self._command_rad = np.zeros(model.nu)

    def __call__(self, rates: Array) -> Array:
        """Return the joint angles at the end of the period, with a lead against servo lag."""
        self._command_rad = self._command_rad + PERIOD_S * rates
        return self._command_rad + self._lead_s * rates


def simulate_singularity(strategy: Strategy, duration_s: float, loops: Loops) -> GoalRun:
    """Simulate a sweep of the arm's line of sight about a perpendicular axis.

    The error is [about the axis of the sweep, across it]; the measure is the condition number of
    the pointing Jacobian. `loops`, those of the hexapod, are not used.
    """
    model, locked = load_model(ARM_MJCF), SHOULDER if strategy.limited else ()
    working = [joint for joint in range(model.nu) if joint not in locked]
    time_s = np.arange(round(duration_s / PERIOD_S)) * PERIOD_S
    axis_rad = np.deg2rad(AXIS_DEG)
    axis = np.array([np.cos(axis_rad), np.sin(axis_rad), 0.0])
    turned = ANGLE_RAD * smooth_step(np.append(time_s, duration_s) / (duration_s - REST_S))
    views = Rotation.from_rotvec(turned[:, None] * axis).apply([0.0, 0.0, 1.0])
    now, then = views[:-1], views[1:]
    plant = Plant(model)
    bench = Bench(
        plant,
        Tracker(now, axis, strategy.seed),
        time_s=time_s,
        period_s=PERIOD_S,
        failures=[Failure(joint, "locked") for joint in locked],
        drives=Servos(model),
    )
    controller = ArmController(model, np.cross(now, then - now), strategy)
    # The tracker measures the error itself: its reference is zero.
    still = np.zeros((len(time_s), len(POINTING)))
    run = run_loop(bench, controller, still, log=attrgetter("start_rad", "J_T"))
    start_rad, J_T = map(np.array, zip(*run.logged, strict=True))
    singular_values = np.linalg.svd(J_T[:, POINTING][:, :, working], compute_uv=False)
    deviation = np.cross(bench.rotation[:, :, 2], now)
    return GoalRun(
        time_s=time_s,
        error_rad=np.stack(
            [np.vecdot(deviation, axis), np.vecdot(deviation, np.cross(axis, now))], axis=1
        ),
        measure=singular_values[:, 0] / singular_values[:, -1],
        closure_residual_max_m=max(bench.closure_residual_m.max(), plant.closure_residual_m()),
        arrays={
            "singular_values": singular_values,
            "joint_rates_rad_per_s": run.inputs,
            "joint_command_rad": start_rad + PERIOD_S * run.inputs,
            # At the end of each period, as the commands.
            "joint_rad": np.vstack([bench.displacement[1:], plant.displacements()]),
        },
    )
