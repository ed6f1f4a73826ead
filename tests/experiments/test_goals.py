"""Tests of the study `goals`: laws of the secondary goals, and unchanged pointing in runs."""

from dataclasses import replace
from functools import cache

import mujoco
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from experiments import goals_physics as physics
from fjh.rig.arm import ARM_MJCF
from fjh.rig.compromise import weighted_pseudo_inverse
from fjh.rig.hexapod.coil import COPPER_PER_K, Coils
from fjh.rig.hexapod.columns import MAJOR, SECONDARY
from fjh.rig.hexapod.detector import pointing_angles
from fjh.rig.hexapod.testbed import TestbedConfig
from ftc import Measurement
from prioritized import velocity_mapping
from sim import Plant, Pose, jacobians, load_model

STROKE_M = 635e-6
seeds = st.integers(0, 2**32 - 1)


def slope(function, at: np.ndarray, step: float) -> np.ndarray:
    """Return the gradient of a scalar function by central differences."""
    steps = step * np.eye(len(at))
    return np.array([(function(at + e) - function(at - e)) / (2 * step) for e in steps])


@given(seeds)
def test_a_step_of_the_coils_solves_their_heat_balance(seed):
    """The reference is a general integrator of C dT/dt = R(T) I^2 - (T - T_ambient) / R_th."""
    rng = np.random.default_rng(seed)
    start, current = rng.uniform(20, 150, 6), rng.uniform(-4, 4, 6)

    def rate(_: float, T: np.ndarray) -> np.ndarray:
        heat = 5.0 * (1 + COPPER_PER_K * (T - 20)) * current**2
        return (heat - (T - 20) / physics.COILS.thermal_resistance_k_per_w) / 4.0

    exact = solve_ivp(rate, (0, 3.0), start, rtol=1e-10, atol=1e-9).y[:, -1]
    np.testing.assert_allclose(physics.COILS.step(start, current, 3.0), exact, rtol=1e-7)
    # At rest T = T_a + R_a I^2 / (1/R_th - kappa R_20 I^2): the closed form of the balance.
    lost = 1 / physics.COILS.thermal_resistance_k_per_w - COPPER_PER_K * 5.0 * current**2
    steady = physics.COILS.step(physics.COILS.cold(), current, 1e4)
    np.testing.assert_allclose(steady, 20 + 5.0 * current**2 / lost, rtol=1e-12)


def test_at_its_critical_current_a_copper_coil_heats_at_a_constant_rate():
    """Heat and loss have equal slopes; above this current there is thermal runaway."""
    coil = Coils(5.0, 4.0, np.array([1.5]), 20.0)
    at = np.array([1 / np.sqrt(COPPER_PER_K * 5.0 * 1.5)])
    rise = coil.step(coil.cold(), at, 8.0) - 20
    np.testing.assert_allclose(rise, 8.0 * coil.net_power_w(coil.cold(), at) / 4.0, rtol=1e-9)


@given(seeds)
def test_desired_rates_from_stops_are_the_negative_gradient_of_a_potential(seed):
    displacements = np.random.default_rng(seed).uniform(-STROKE_M, STROKE_M, 6)

    def potential(l_m: np.ndarray) -> float:
        beyond = np.maximum(0.0, np.abs(l_m) - 0.82 * STROKE_M)
        return float(0.5 * np.sum(beyond**2) / 0.2)

    rates = physics.rates_from_stops(displacements, STROKE_M)
    np.testing.assert_allclose(rates, -slope(potential, displacements, 1e-8), atol=2e-7)


@cache
def clearance() -> physics.Clearance:
    return physics.Clearance(physics.cluttered())


def random_pose(seed: int) -> Pose:
    turn, moved = np.random.default_rng(seed).uniform(-1, 1, (2, 3))
    return Pose(Rotation.from_rotvec(3e-3 * turn).as_matrix(), 3e-4 * moved)


@given(seeds)
def test_the_clearance_is_that_of_a_sphere_and_a_cylinder(seed):
    """The distance from the centre to the lateral surface, less the radius, is in base axes."""
    pose = random_pose(seed)
    # World axes are diag(1, -1, -1) of base; the cell is 0.1445 m below the payload's origin.
    centre = np.array([0.0, -(0.065 + physics.GAP_M + physics.RADIUS_M), 0.144482272])
    seen = pose.rotation.T @ (centre - pose.translation_m)
    assert abs(seen[2] - 0.144482272) < 0.015  # at the lateral surface
    distance, away = clearance()(pose)
    assert distance == pytest.approx(
        np.hypot(seen[0], seen[1]) - 0.065 - physics.RADIUS_M, abs=1e-9
    )
    assert np.linalg.norm(away) == pytest.approx(1.0)


@given(seeds)
def test_the_retreat_is_the_negative_gradient_of_the_missing_clearance(seed):
    pose = random_pose(seed)

    def potential(t_m: np.ndarray) -> float:
        distance, _ = clearance()(replace(pose, translation_m=t_m))
        return 0.5 * max(0.0, physics.SAFE_M - distance) ** 2 / 0.2

    assume(abs(clearance()(pose)[0] - physics.SAFE_M) > 1e-6)  # there the slope has a kink
    velocity = physics.retreat(clearance(), pose)
    np.testing.assert_allclose(velocity[:3], -slope(potential, pose.translation_m, 1e-7), atol=1e-8)
    assert velocity[3] == 0.0


@given(seeds, st.sampled_from([range(7), range(3, 7), (1, 2, 5, 6)]))
def test_the_gradient_of_manipulability_equals_finite_differences(seed, moving):
    """The closed form uses the joint axes, the reference MuJoCo's kinematics."""
    model = load_model(ARM_MJCF)
    data, moving = mujoco.MjData(model), list(moving)

    def axes(joint_rad: np.ndarray) -> np.ndarray:
        data.qpos[moving] = joint_rad
        return jacobians(model, data, "payload", "payload").J_T[:3, moving]

    at = np.random.default_rng(seed).uniform(-1, 1, len(moving))
    expected = slope(lambda q: physics.manipulability(axes(q)), at, 1e-6)
    np.testing.assert_allclose(physics.manipulability_gradient(axes(at)), expected, atol=1e-7)


@given(seeds)
def test_a_reading_of_the_detector_is_corrected_for_roll(seed):
    """Off the axis roll moves the spot; at the estimated pose the correction is exact."""
    rng = np.random.default_rng(seed)
    pose = Pose(Rotation.from_rotvec(4e-3 * rng.uniform(-1, 1, 3)).as_matrix(), np.zeros(3))
    detector = replace(TestbedConfig().detector(), noise_m=0.0)
    read = Measurement(detector.read(pose.rotation, rng), np.zeros(6))
    pointing = pointing_angles(pose.rotation)
    # The detector's small-angle optics have an error of (4 mrad)^3.
    np.testing.assert_allclose(physics.without_roll(read, pose).output, pointing, atol=5e-8)


@given(seeds)
def test_a_weighted_pseudo_inverse_is_least_squares_exact_in_the_limit(seed):
    """The pseudo-inverse's error falls with the square of the weight; the mapping has none."""
    rng = np.random.default_rng(seed)
    J, W1, W2, w = rng.normal(size=(6, 5)), rng.uniform(1, 3, 5), rng.uniform(1, 3, 4), 7.0
    v_m, rates_d, v_sd = rng.normal(size=2), rng.normal(size=5), rng.normal(size=4)
    mapping = weighted_pseudo_inverse(J, MAJOR, SECONDARY, w, W1, W2)
    matrix = np.vstack([w * J[MAJOR], np.diag(W1), W2[:, None] * J[SECONDARY]])
    targets = np.concatenate([w * v_m, W1 * rates_d, W2 * v_sd])
    expected = np.linalg.lstsq(matrix, targets)[0]
    np.testing.assert_allclose(mapping(v_m, rates_d, v_sd), expected, atol=1e-10)

    J = J[:2] / np.linalg.svd(J[:2], compute_uv=False)[-1]

    def rates(weight: float) -> np.ndarray:
        return weighted_pseudo_inverse(J, MAJOR, [], weight, np.ones(5))(v_m, rates_d)

    errors = [np.linalg.norm(J @ rates(weight) - v_m) for weight in (30.0, 300.0, 3000.0)]
    np.testing.assert_allclose(np.divide(errors[:-1], errors[1:]), 100.0, rtol=0.01)
    exact = velocity_mapping(J, MAJOR, joint_weight=np.ones(5))(v_m, rates_d)
    np.testing.assert_allclose(rates(1e5), exact, atol=1e-7)


@given(seeds)
def test_the_tracker_reads_the_rotation_of_the_camera_in_its_own_axes(seed):
    """The reading is -sin|w| w/|w| for a rotation vector w across the line of sight."""
    rng = np.random.default_rng(seed)
    to_target, camera = np.append(rng.uniform(-0.5, 0.5, 2), 0.0), Rotation.random(rng=rng)
    view = (camera * Rotation.from_rotvec(to_target)).apply([0.0, 0.0, 1.0])
    pose = Pose(camera.as_matrix(), rng.normal(size=3))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(physics, "TRACKER_NOISE_RAD", 0.0)
        read = physics.Tracker(view[None], np.array([1.0, 0.0, 0.0]), seed).read(pose, np.zeros(7))
    np.testing.assert_allclose(
        read.output, -np.sinc(np.linalg.norm(to_target) / np.pi) * to_target[:2], atol=1e-14
    )


def test_servos_with_lead_have_no_lag():
    """Joints without lag follow the mean of sampled commands: half a period, half a step ahead."""
    model, rates = load_model(ARM_MJCF), 1e-3 * np.array([1, -2, 3, -1, 2, -3, 1])
    plant, servos, periods = Plant(model), physics.Servos(model), 600
    for _ in range(periods):
        plant.step(servos(rates), physics.PERIOD_S)
    ahead_s = plant.displacements() / rates - periods * physics.PERIOD_S
    np.testing.assert_allclose(ahead_s, 0.5 * (physics.PERIOD_S + model.opt.timestep), rtol=0.01)


def test_pursued_goals_keep_their_limits_and_others_change_the_pointing(study):
    """The goal changes the pointing less than half as much as another seed does."""
    frames = study.tables
    worst = frames["runs"].pivot(index="goal", columns="name", values="worst")
    assert worst.pursued["reliability"] < physics.LIMIT_C - 10
    assert worst.pursued["stroke"] > 30
    assert worst.pursued["obstacle"] > 30
    assert worst.pursued["singularity"] < 3
    angles = frames["angles"].groupby(["goal", "name"])  # the larger one of each
    changed = angles.difference_rms_urad.max().unstack("name")
    noise = frames["another_seed"].set_index("goal").difference_rms_urad
    assert (changed.pursued / noise < 0.5).all()
    rms_urad = angles.rms_urad.max().unstack("name")
    ratio = rms_urad.nothing / rms_urad.unlimited
    assert (ratio[["stroke", "obstacle", "singularity"]] > 2).all()
    # The sphere stops the payload, which would have passed through it.
    assert -1.0 < worst.nothing["obstacle"] < 1.0
    assert worst.unlimited["obstacle"] < -100.0
    # The shoulder keeps the arm away from its singularity.
    assert worst.unlimited["singularity"] < 2.0
    # A weight of the pseudo-inverse that is good for one goal spoils another task.
    changes = changed.pseudo_inverse_10 / changed.pursued
    assert changes["obstacle"] < 1.5
    assert changes["singularity"] > 100


def test_the_coils_stay_cool_with_a_worse_heat_path_than_modelled(study):
    """The controller estimates the temperatures with its thermal model."""
    data = study.arrays("reliability.npz")
    current = TestbedConfig().amplifier(126e3).current_a(data["pursued_strut_input_percent"])
    estimated = data["pursued_temperature_c"]
    np.testing.assert_allclose(physics.COILS.temperatures_c(current, 1e-3), estimated, atol=1e-6)
    worse = replace(
        physics.COILS, thermal_resistance_k_per_w=1.2 * physics.COILS.thermal_resistance_k_per_w
    )
    hotter = worse.temperatures_c(current, 1e-3)
    assert estimated.max() < hotter.max() < physics.LIMIT_C
