"""Runs of the study `goals`: four secondary goals, and the controllers that pursue them."""

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
SLEW_S = 3.0  # from the axis to the target
STRIDE = 10  # ticks from one pose at which the clearance is measured to the next
RELAX_S = 0.2  # in which a strut or the payload comes back: slower than pointing, not than the slew

# Reliability. Struts 1 and 4 do most of the work, 84 % of their current. Their winding is light,
# 10 g of copper for 80 W, so that 16 s are long; strut 1 has lost a third of its heat path.
HOT_TARGET_URAD = (2771.0, 1600.0)
COILS = Coils(
    resistance_ohm=5.0,
    heat_capacity_j_per_k=4.0,
    thermal_resistance_k_per_w=np.array([2.2, 1.5, 1.5, 1.5, 1.5, 1.5]),
    ambient_c=20.0,
)
LIMIT_C, WARM_C, HEAVIEST = 90.0, 60.0, 10.0  # weights rise from 1 at WARM_C to HEAVIEST
REWEIGH_TICKS = 10  # at 20 the steps of the weights begin to show in the pointing

# Stroke. The least squares of displacements take 664 um of struts 1 and 4, beyond their stops.
FAR_TARGET_URAD = (3464.0, 2000.0)
ACTIVE = 0.82  # part of the stroke beyond which a strut is led back
LONGER = 1.5  # stroke of the machine on which no stop needs avoiding, in strokes of the hexapod

# Obstacle. The mirror cell swings by 0.3 mm towards it. Strut 1 is locked at its centre: with all
# six the secondary velocities are free, and a pseudo-inverse would have nothing to compromise.
OBSTRUCTED_TARGET_URAD = (2000.0, 0.0)
GAP_M, RADIUS_M, SAFE_M = 0.25e-3, 0.02, 0.1e-3  # the payload is led away below the safe clearance
LOCKED_STRUT = 0
OBSTRUCTED = Goal(secondary_weight=(1.0,) * 4, locked_at={LOCKED_STRUT: 0.0})
REACH_M = 1.0  # farther than anything here is

# Singularity. Healthy, the arm never comes near one of pointing; with its shoulder locked it does
# where the camera looks along the forearm. About this axis, from x_b towards y_b, the view passes
# close beside the forearm just when the wrist's pitch axis is parallel to the elbow's.
SHOULDER, AXIS_DEG, ANGLE_RAD = (0, 1, 2), 133.5, 2.2
GAIN_PER_S = 0.5  # of the manipulability's slope, about one: slow for servos, fast for the sweep
FADE_S = 2.0  # in which the goal sets in: desired rates that step would kick the servos
PERIOD_S, REST_S = 5e-3, 1.0  # of the arm's controller; at the end of the sweep
LOOP_GAIN_PER_S = 6.0  # a crossover of 1 Hz: a tenth of the slowest servo mode
TRACKER_NOISE_RAD = 1e-4  # of one sample: a tenth of a pixel, of a thousand over 60 degrees


@dataclass(frozen=True)
class Strategy:
    """How one run treats the secondary goal.

    Attributes:
        name: As in `goals.json`.
        pursues: Whether it does anything for the goal.
        major_weight: Of pointing in a weighted pseudo-inverse; None: pointing comes first.
        limited: Whether the limit is there: the stop, the obstacle, the broken shoulder.
        seed: Of the sensor noise.
    """

    name: str
    pursues: bool
    major_weight: float | None
    limited: bool
    seed: int


@dataclass(frozen=True)
class Flown:
    """What one run gave; time is along the first axis.

    Attributes:
        time_s: (N,).
        error_rad: Desired minus true pointing, (N, 2).
        measure: Of the secondary goal, (N,).
        closure_residual_max_m: Largest gap of a closed loop.
        arrays: What else is kept of it.
    """

    time_s: Array
    error_rad: Array
    measure: Array
    closure_residual_max_m: float
    arrays: dict[str, Array]


Loops = tuple[Loop, Loop]
Rates = Callable[[Array, Pose], Array]
"""Desired strut rates (6,), theta_ad of eq. (24), [m]/[s], where the struts are commanded to be
(6,) and the payload is estimated to be."""


# What leads where.


def joint_weights(temperature_c: Array) -> Array:
    """Diagonal of W1 for coils that are so hot, shape (6,): a smooth step from 1 to HEAVIEST."""
    return 1.0 + (HEAVIEST - 1.0) * smooth_step((temperature_c - WARM_C) / (LIMIT_C - WARM_C))


def rates_from_stops(displacements_m: Array, stroke_m: float) -> Array:
    """Desired strut rates (6,), [m]/[s], zero while no strut is near a stop.

    Down the gradient of half the squares of what struts (6,) stand beyond the active part of their
    stroke, over the time to come back; after Chaumette and Marchand (2000), reference [3] of the
    paper.
    """
    beyond = np.maximum(0.0, np.abs(displacements_m) - ACTIVE * stroke_m)
    return -np.sign(displacements_m) * beyond / RELAX_S


def cluttered() -> mujoco.MjModel:
    """The hexapod with a sphere beside its mirror cell; the two collide, as hard as the closures.

    The sphere stands on the world's y axis, as high as the cell's middle.
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
    """How far the payload is from the obstacle, and which way leads away, at any pose."""

    def __init__(self, model: mujoco.MjModel) -> None:
        """Take the machine of :func:`cluttered`."""
        self._model, self._data = model, mujoco.MjData(model)
        mujoco.mj_kinematics(model, self._data)
        self._to_world = self._data.site("base").xmat.reshape(3, 3).copy()
        self._joint = model.jnt_qposadr[model.joint("payload").id]
        self._obstacle, self._cell = model.geom("obstacle").id, model.geom("mirror_cell").id

    def __call__(self, pose: Pose) -> tuple[float, Array]:
        """Clearance [m], negative where they overlap, and the unit vector (3,) away, base axes."""
        turn, at = self._to_world @ pose.rotation @ self._to_world.T, self._joint
        self._data.qpos[:] = self._model.qpos0
        self._data.qpos[at : at + 3] += self._to_world @ pose.translation_m
        mujoco.mju_mat2Quat(self._data.qpos[at + 3 : at + 7], turn.ravel())
        mujoco.mj_kinematics(self._model, self._data)
        nearest = np.zeros(6)  # on the obstacle, on the cell
        distance = mujoco.mj_geomDistance(
            self._model, self._data, self._obstacle, self._cell, REACH_M, nearest
        )
        away = nearest[3:] - self._data.geom_xpos[self._obstacle]
        return distance, self._to_world.T @ (away / np.linalg.norm(away))


def retreat(clearance: Clearance, pose: Pose) -> Array:
    """Desired secondary velocity, v_sd of eq. (24): [t_x, t_y, t_z, gamma], shape (4,), base axes.

    Down the gradient, over translations, of half the square of what is missing to the safe
    clearance, divided by the time to come clear, [m]/[s]; no roll.
    """
    distance, away = clearance(pose)
    return np.append(max(0.0, SAFE_M - distance) / RELAX_S * away, 0.0)


def manipulability(axes: Array) -> float:
    """Yoshikawa's measure sqrt(det(J_m J_m^T)) of pointing, J_m the first two rows of `axes`.

    Args:
        axes: Directions of the joints in payload axes, from the base outwards, shape (3, n).
    """
    J_m = axes[:2]
    return float(np.sqrt(np.linalg.det(J_m @ J_m.T)))


def manipulability_gradient(axes: Array) -> Array:
    """Slope of :func:`manipulability` over the joint angles, shape (n,), for a serial arm.

    Seen from the payload, joint j turns the axes of all joints before it by -a_j x a_i, and none
    after it; with w the measure, dw = w tr(J_m^+ dJ_m).
    """
    J_m, n = axes[:2], axes.shape[1]
    turned = -np.cross(axes[:, :, None], axes[:, None, :], axis=0)[:2]  # (2, j, i)
    turned *= np.tri(n, k=-1)  # only axes i before joint j
    return manipulability(axes) * np.einsum("ir,rji->j", np.linalg.pinv(J_m), turned)


# The hexapod.


def controller_for(
    testbed: Testbed, major_weight: float | None, goal: Goal
) -> PrioritizedController[Pose]:
    """The hexapod's controller for a goal, by the mapping or a weighted pseudo-inverse.

    The Jacobian is constant: within the stroke that costs pointing less than noise does.
    """
    allocate = None
    if major_weight is not None:
        allocate = compromising(goal, MAJOR, SECONDARY, major_weight)
    mapping = StrutMapping(hexapod(testbed.model), goal, "constant", allocate=allocate)
    return PrioritizedController(
        testbed.loops, mapping, testbed.amplifier(), testbed.bench.handover_s
    )


def unrolled(measurement: Measurement, pose: Pose) -> Measurement:
    """What the detector would read if the payload had not rolled.

    The detector turns with the payload: off the axis, a roll about it moves the spot although
    the pointing stays. What it reads and what is pointed at are compared at the estimated pose.
    """
    read, pointed = -pointing_angles(pose.rotation.T), pointing_angles(pose.rotation)
    return Measurement(measurement.output - read + pointed, measurement.displacement)


def no_rates(displacements_m: Array, pose: Pose) -> Array:
    """No secondary goal."""
    return np.zeros_like(displacements_m)


@dataclass(frozen=True)
class SeekerState(NestedState):
    """State of a :class:`Seeker`, beside that of its controller.

    Attributes:
        secondary_reference: Desired strut rates integrated so far, (6,).
        temperature_c: Estimated coil temperatures, (6,).
        steering: The controller with the present weights.
    """

    secondary_reference: Array
    temperature_c: Array
    steering: PrioritizedController[Pose]


@dataclass(frozen=True)
class Seeker:
    """A controller that points, and pursues a secondary goal as far as pointing allows.

    Attributes:
        controller_for: Its controller for weights.
        goal: The weights at first.
        rates: Desired of the struts.
        reweighs: Whether the weights follow the coils' temperatures, which it estimates from the
            currents that it sends, with a thermal model of its own.
    """

    controller_for: Callable[[Goal], PrioritizedController[Pose]]
    goal: Goal = EQUAL
    rates: Rates = no_rates
    reweighs: bool = False

    def start(self) -> SeekerState:
        """At rest at the nominal pose, coils cold."""
        steering = self.controller_for(self.goal)
        return SeekerState(steering.start(), 0, np.zeros(6), COILS.cold(), steering)

    def step(self, state: SeekerState, reference: Array, measurement: Measurement) -> SeekerState:
        """One control tick."""
        steering, drives, period_s = state.steering, state.steering.drives, BENCH.control_period_s
        temperature_c = COILS.step(state.temperature_c, drives.current_a(state.inputs), period_s)
        if self.reweighs and state.ticks % REWEIGH_TICKS == 0:
            steering = self.controller_for(Goal(joint_weight=tuple(joint_weights(temperature_c))))
        moved_m = period_s * self.rates(drives.displacements(state.inputs), state.pose)
        reference_m = state.secondary_reference + moved_m
        seen = unrolled(measurement, state.pose)
        controller = steering.step(state.controller, reference, seen, reference_m)
        return SeekerState(controller, state.ticks + 1, reference_m, temperature_c, steering)


def off_axis_path(target_urad: tuple[float, float], duration_s: float) -> Array:
    """A slew to the best known position of the target, then the testbed's spiral there, (N, 2)."""
    time_s = BENCH.time_s(duration_s)
    path = smooth_step(time_s / SLEW_S)[:, None] * 1e-6 * np.array(target_urad)
    searching = time_s >= SLEW_S
    search = replace(BENCH, duration_s=duration_s - SLEW_S)
    path[searching] += search.desired_rad(time_s[searching] - SLEW_S)
    return path


def fly_reliability(strategy: Strategy, duration_s: float, loops: Loops) -> Flown:
    """One search where two coils become hot."""
    testbed = Testbed(load_model(), BENCH, loops)
    find = partial(controller_for, testbed, strategy.major_weight)
    path = off_axis_path(HOT_TARGET_URAD, duration_s)
    seeker = Seeker(find, reweighs=strategy.pursues)
    run = hexapod_rig(testbed).fly(seeker, path, seed=strategy.seed)
    current_a = testbed.amplifier().current_a(run.inputs)
    temperature_c = COILS.temperatures_c(current_a, BENCH.control_period_s)
    return _flown(run, temperature_c.max(axis=1), temperature_c=temperature_c)


def fly_stroke(strategy: Strategy, duration_s: float, loops: Loops) -> Flown:
    """One search where two struts come to their stops."""
    model = load_model()
    stroke_m = float(model.jnt_range[model.actuator_trnid[0, 0], 1])
    testbed = Testbed(model, BENCH, loops)
    if not strategy.limited:
        testbed = testbed.scaled(stroke=LONGER)
    find = partial(controller_for, testbed, strategy.major_weight)
    seeker = Seeker(find)
    if strategy.pursues:
        seeker = replace(seeker, rates=lambda at_m, _: rates_from_stops(at_m, stroke_m))
    path = off_axis_path(FAR_TARGET_URAD, duration_s)
    run = hexapod_rig(testbed).fly(seeker, path, seed=strategy.seed)
    return _flown(run, 1e6 * (stroke_m - np.abs(run.displacement).max(axis=1)))


def fly_obstacle(strategy: Strategy, duration_s: float, loops: Loops) -> Flown:
    """One search beside an obstacle."""
    obstructed = cluttered()
    model, clearance = obstructed if strategy.limited else load_model(), Clearance(obstructed)
    testbed = Testbed(model, BENCH, loops)
    find = partial(controller_for, testbed, strategy.major_weight)
    controller = find(OBSTRUCTED)
    kinematics = controller.mapping.at(controller.mapping.nominal).kinematics
    # Strut rates that give the payload v_sd if pointing is left aside: J_s of them is v_sd.
    struts = kinematics.expand(np.linalg.pinv(kinematics.J[SECONDARY]).T).T
    seeker = Seeker(find, OBSTRUCTED)
    if strategy.pursues:
        seeker = replace(seeker, rates=lambda _, pose: struts @ retreat(clearance, pose))
    path = off_axis_path(OBSTRUCTED_TARGET_URAD, duration_s)
    failures = [Failure(LOCKED_STRUT, "locked")]
    run = hexapod_rig(testbed).fly(seeker, path, failures=failures, seed=strategy.seed)
    poses = forward_kinematics(hexapod(model), run.displacement[::STRIDE])
    each = zip(poses.rotation, poses.translation_m, strict=True)
    clear_m = [clearance(Pose(*pose))[0] for pose in each]
    return _flown(run, 1e6 * np.repeat(clear_m, STRIDE)[: len(run.time_s)])


def _flown(run: Run, measure: Array, **arrays: Array) -> Flown:
    own = {name: each for name, each in hexapod_arrays(run).items() if name != "time_s"}
    return Flown(run.time_s, run.error, measure, run.closure_max_m, own | arrays)


# The serial arm, which points its camera: resolved rates, closed over a tracker in the camera.


@dataclass(frozen=True)
class ArmState:
    """State of an :class:`ArmController` after a tick.

    Attributes:
        inputs: Joint rates, (7,).
        begun_rad: Joint angles at the start of the period, (7,).
        J_T: Twist of the camera per joint rate in its own axes, halfway through it, (6, 7).
        ticks: So far.
    """

    inputs: Array
    begun_rad: Array
    J_T: Array
    ticks: int


class ArmController:
    """A controller that turns the camera to a target whose path is known, W1 the identity.

    If it pursues the goal, it climbs the manipulability as far as pointing leaves the joints free.
    """

    def __init__(self, model: mujoco.MjModel, turns_rad: Array, strategy: Strategy) -> None:
        """Follow a line of sight that turns by (N, 3) in each period, base axes."""
        self._turns_rad, self._strategy = turns_rad, strategy
        self._data = mujoco.MjData(model)
        self._reader = JacobianReader(model, site="payload", axes="payload")
        healthy = ConstrainedSystem.of(self._reader.at(self._data))
        self._system = healthy.with_failures(locked=SHOULDER if strategy.limited else ())

    def start(self) -> ArmState:
        """At rest at the nominal pose."""
        n = len(self._data.qpos)
        return ArmState(np.zeros(n), np.zeros(n), np.zeros((6, n)), ticks=0)

    def step(self, state: ArmState, reference: Array, measurement: Measurement) -> ArmState:
        """One control tick."""
        begun_rad = state.begun_rad + PERIOD_S * state.inputs
        # Halfway through the period: rates held from its start would drift off the curved path.
        self._data.qpos[:] = begun_rad + 0.5 * PERIOD_S * state.inputs
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
        return ArmState(rates, begun_rad, J_T, state.ticks + 1)


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


def fly_singularity(strategy: Strategy, duration_s: float, loops: Loops) -> Flown:
    """One sweep of the arm's line of sight about an axis across it.

    Its error is [about the axis of the sweep, across it], its measure the condition number of the
    pointing Jacobian. The loops are the hexapod's, of no use here.
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
    run = run_loop(bench, controller, still, log=attrgetter("begun_rad", "J_T"))
    begun_rad, J_T = map(np.array, zip(*run.logged, strict=True))
    singular_values = np.linalg.svd(J_T[:, POINTING][:, :, working], compute_uv=False)
    off = np.cross(bench.rotation[:, :, 2], now)
    return Flown(
        time_s=time_s,
        error_rad=np.stack([np.vecdot(off, axis), np.vecdot(off, np.cross(axis, now))], axis=1),
        measure=singular_values[:, 0] / singular_values[:, -1],
        closure_residual_max_m=max(bench.closure_residual_m.max(), plant.closure_residual_m()),
        arrays={
            "singular_values": singular_values,
            "joint_rates_rad_per_s": run.inputs,
            "joint_command_rad": begun_rad + PERIOD_S * run.inputs,
            # At the end of each period, as the commands.
            "joint_rad": np.vstack([bench.displacement[1:], plant.displacements()]),
        },
    )
