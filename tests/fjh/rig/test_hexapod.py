"""Parts of the hexapod: kinematics both ways, loops, mapping, path, sensors and amplifiers."""

import copy
from dataclasses import replace
from functools import cache

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from fjh.rig.hexapod import paper
from fjh.rig.hexapod.amplifier import Amplifier, displacement_limits
from fjh.rig.hexapod.closed_form import Hexapod, hexapod
from fjh.rig.hexapod.columns import MAJOR, SECONDARY
from fjh.rig.hexapod.controller import StrutMapping, nominal_loops
from fjh.rig.hexapod.detector import Detector, pointing_angles
from fjh.rig.hexapod.forward import UnreachableLengths, forward_kinematics
from fjh.rig.hexapod.strut_sensors import StrutSensors
from fjh.rig.hexapod.testbed import TestbedConfig
from fjh.rig.hexapod.trajectory import spiral
from ftc import Goal
from prioritized import ConstrainedSystem
from sim import NOMINAL, Plant, Pose, jacobians, load_model
from tests.random_systems import SEEDS


def test_the_jacobian_of_the_model_is_eq_39_signs_included(model):
    jac = jacobians(model, mujoco.MjData(model), site="payload", axes="base")
    kin = ConstrainedSystem(jac.J_T, jac.J_C, jac.active).kinematics()
    np.testing.assert_allclose(kin.J, paper.JACOBIAN, atol=6e-4)
    assert kin.J[1, 0] == pytest.approx(1.00455, abs=5e-6)  # printed as 1.004
    assert np.linalg.cond(kin.J) == pytest.approx(paper.CONDITION_NUMBER, abs=0.005)
    A = hexapod(model).inverse_jacobian(NOMINAL)
    np.testing.assert_allclose(A @ kin.J, np.eye(6), atol=1e-12)
    # The paper's Diag[10, 10, 1, 1] weights translations across the line of sight.
    assert [*MAJOR, *SECONDARY] == [0, 1, 3, 4, 5, 2]


def test_the_loops_have_textbook_margins_at_the_specified_crossovers(model):
    bench = TestbedConfig()
    for loop, crossover in zip(nominal_loops(model, bench), bench.crossover_hz, strict=True):
        assert loop.crossover_hz == pytest.approx(crossover, rel=1e-3)
        assert loop.gain_margin_db > 6.0
        assert loop.phase_margin_deg > 45.0


@pytest.mark.parametrize("locked", [{}, {0: 0.0}, {3: 2e-4}])
def test_commanded_displacements_point_at_the_demand(model, locked):
    """The exact geometry gives the pointing; a strut locked off center is a known offset."""
    machine, target = hexapod(model), np.array([8e-5, -5e-5])
    weighted, plain = (
        StrutMapping(machine, Goal(secondary_weight=weight, locked_at=locked), "analytic")
        for weight in ((10.0, 10.0, 1.0, 1.0), (1.0, 1.0, 1.0, 1.0))
    )
    command, pose = np.zeros(6), NOMINAL
    for _ in range(4):  # the estimate settles in a tick or two
        command = weighted.displacements(target, pose)
        pose = weighted.estimate(command, pose)
    assert all(command[k] == 0.0 for k in locked)
    lengths = command + [locked.get(k, 0.0) for k in range(6)]
    np.testing.assert_allclose(machine.displacements(pose), lengths, atol=1e-12)
    # J(x) l differs from the true x by second order in the displacement.
    scale = np.abs(lengths).max()
    np.testing.assert_allclose(pointing_angles(pose.rotation), target, atol=50 * scale**2 + 1e-9)
    less, more = (
        np.linalg.norm(m.estimate(m.displacements(target, pose), pose).translation_m[:2])
        for m in (weighted, plain)
    )
    assert less <= more + 1e-12


def test_the_constant_jacobian_is_the_analytic_one_at_the_nominal_pose(model):
    analytic, constant = (
        StrutMapping(hexapod(model), Goal(joint_weight=(1.0,) * 6), choice)
        for choice in ("analytic", "constant")
    )
    moved, target = NOMINAL.moved(np.array([0.01, 0, 0, 0.001, 0, 0])), np.array([1e-4, 2e-5])
    nominal = constant.displacements(target, NOMINAL)
    np.testing.assert_array_equal(constant.displacements(target, moved), nominal)
    np.testing.assert_array_equal(analytic.displacements(target, NOMINAL), nominal)
    assert np.abs(analytic.displacements(target, moved) - nominal).max() > 1e-8


def turned(*rotation_vector: float) -> np.ndarray:
    return Rotation.from_rotvec(rotation_vector).as_matrix()


def test_pointing_angles_are_rotations_about_x_b_and_y_b_and_blind_to_z_b():
    R = turned(3e-4, -2e-4, 0)
    np.testing.assert_allclose(pointing_angles(R), [3e-4, -2e-4], atol=1e-10)
    spun = R @ turned(0, 0, 0.5)
    np.testing.assert_allclose(pointing_angles(spun), pointing_angles(R), atol=1e-15)


def test_the_detector_reads_the_pointing_angles_through_its_optics():
    R, rng = turned(1e-4, -5e-5, 0), np.random.default_rng(0)
    quiet, noisy = Detector(1.0, 5e-3, noise_m=0.0), Detector(1.0, 5e-3, noise_m=3e-7)
    np.testing.assert_allclose(quiet.read(R, rng), [1e-4, -5e-5], atol=1e-9)
    readings = np.array([noisy.read(R, rng) for _ in range(4000)])
    np.testing.assert_allclose(readings.std(axis=0), 3e-7, rtol=0.05)


def test_a_saturated_detector_reads_its_edge_and_no_noise():
    """The noise is the spot's: beyond the detector the reading is constant."""
    rng, noisy = np.random.default_rng(0), Detector(2.0, half_width_m=5e-3, noise_m=1e-5)
    for sign in 20 * (1.0, -1.0):
        read = noisy.read(turned(0.02 * sign, -0.02 * sign, 0), rng)
        np.testing.assert_array_equal(read, sign * np.array([1, -1]) * 5e-3 / 2.0)


def test_the_gauges_have_the_stated_noise():
    """Samples are independent and unbiased; 20000 give the standard deviation to a percent."""
    true_m, rng = np.linspace(-1e-5, 1e-5, 6), np.random.default_rng(0)
    gauges = StrutSensors(noise_m=5e-8)
    errors = np.array([gauges.read(true_m, rng) for _ in range(20000)]) - true_m
    np.testing.assert_allclose(errors.std(axis=0), 5e-8, rtol=0.02)
    np.testing.assert_allclose(errors.mean(axis=0), 0, atol=4 * 5e-8 / np.sqrt(20000))
    np.testing.assert_allclose(np.corrcoef(errors.T), np.eye(6), atol=0.04)


def test_the_spiral_reaches_its_radius_in_eight_turns():
    path = spiral(np.array([0.0, 1.0, 16.0]), radius_rad=1e-4, turns=8, duration_s=16)
    np.testing.assert_allclose(path, [[0, 0], [-1e-4 / 16, 0], [1e-4, 0]], atol=1e-15)


PLAIN = Amplifier(bits=16, full_input_a=4.0, limit_a=4.0, newton_per_a=20.0, newton_per_m=1e5)
STEP_M, STEP_PERCENT = 4.0 * 20.0 / 1e5 / 2**15, 100 / 2**15


@pytest.fixture(scope="module")
def amplifier(model):
    return TestbedConfig().amplifier(model.actuator_gainprm[0, 0])


def settled_plant(model, amplifier, command_m):
    """Return a plant that has settled at the converted displacements of a command."""
    plant = Plant(model)
    plant.settle(0.5, amplifier.displacements(amplifier.inputs(command_m)))
    return plant


def test_the_converter_sends_the_nearest_code_and_none_beyond_its_range():
    """Codes are -32768..32767: the largest positive input is one step short of 100 %."""
    steps = np.array([-40000, -32768, -1.6, -1.4, -0.6, -0.4, 0.4, 0.6, 1.4, 1.6, 32767, 32768])
    codes = PLAIN.inputs(steps * STEP_M) / STEP_PERCENT
    expected = [-32768, -32768, -2, -1, -1, 0, 0, 1, 1, 2, 32767, 32767]
    np.testing.assert_array_equal(codes, expected)


def test_beyond_its_limit_the_amplifier_gives_no_more_current():
    weak = replace(PLAIN, limit_a=3.0)
    fine = weak.displacements(weak.inputs(np.linspace(0, 5, 200) * STEP_M))
    np.testing.assert_allclose(np.unique(fine), np.arange(6) * STEP_M, atol=1e-18)
    assert weak.current_a(np.array([50.0, -100.0])).tolist() == [2.0, -3.0]
    assert weak.displacements(np.array(100.0)) == pytest.approx(3.0 * 20.0 / 1e5)


def test_the_amplifiers_full_scale_is_the_coils_force_limit(model, amplifier):
    """100 % input, largest current, largest coil force and full stroke coincide."""
    coil, strut = model.actuator("coil1"), model.joint("strut1")
    assert coil.gainprm[0] == strut.stiffness[0]
    full_force = amplifier.current_a(np.array(100.0)) * amplifier.newton_per_a
    assert full_force == pytest.approx(coil.forcerange[1], rel=1e-9)
    assert amplifier.displacements(np.array(100.0)) == pytest.approx(strut.range[1], rel=1e-9)


@pytest.mark.parametrize("side", [0, 1], ids=["lower", "upper"])
def test_a_strut_at_its_limit_rests_there_with_the_stated_current(model, amplifier, side):
    """The coil balances the spring: k l = (N/A) I, up to flexures of 0.1 % of the stiffness."""
    currents_a = [0.5, 1.0, 2.0, 3.0, 4.0, 9.0]
    limits = displacement_limits(model, amplifier, currents_a)[side]
    for strut, (limit_m, most_a) in enumerate(zip(limits, currents_a, strict=True)):
        plant = settled_plant(model, amplifier, limit_m * np.eye(6)[strut])
        current_a = plant.coil_force_n()[strut] / amplifier.newton_per_a
        stated_a = (2 * side - 1) * min(most_a, amplifier.limit_a)
        assert plant.displacements()[strut] == pytest.approx(limit_m, rel=2e-3)
        # The error is half a step of the converter, one step at its upper end.
        step_a = amplifier.full_input_a / 2 ** (amplifier.bits - 1)
        assert current_a == pytest.approx(stated_a, abs=1.01 * step_a)


def test_a_shorter_stroke_is_the_limit(model, amplifier):
    """The first of stop and current counts; a stop bears the excess force of the coil."""
    short = copy.copy(model)
    short.jnt_range[short.actuator_trnid[1, 0]] = [-1e-4, 2e-4]
    short.jnt_limited[short.actuator_trnid[0, 0]] = False
    lower, upper = displacement_limits(short, amplifier)
    assert (lower[1], upper[1]) == (-1e-4, 2e-4)
    assert -lower[0] == pytest.approx(amplifier.limit_a * 20.0 / 126e3)
    assert upper[2:] == pytest.approx(635e-6, rel=1e-4)
    for limit_m in (lower[1], upper[1]):
        plant = settled_plant(short, amplifier, 2 * limit_m * np.eye(6)[1])
        assert plant.displacements()[1] == pytest.approx(limit_m, rel=1e-2)
    np.testing.assert_array_equal(displacement_limits(model, amplifier, 0.0), np.zeros((2, 6)))


@cache
def machine() -> Hexapod:
    return hexapod(load_model())


@given(
    SEEDS,
    st.sampled_from([(0.0, 0.03), (0.05, 2e-3)]),
    st.sampled_from([(), (1,), (5,), (2, 3), (0,)]),
)
def test_the_pose_has_the_lengths_that_it_was_computed_from(seed, spreads_m, shape):
    """Lengths differ by 7 %, fifty times the paper's stroke, or nodes are moved."""
    rng, (moved_m, range_m) = np.random.default_rng(seed), spreads_m
    bottom_m, top_m = rng.uniform(-moved_m, moved_m, (2, 6, 3))
    other = Hexapod(bottom_m=machine().bottom_m + bottom_m, top_m=machine().top_m + top_m)
    target = rng.uniform(-range_m, range_m, (*shape, 6))
    pose = forward_kinematics(other, target)
    np.testing.assert_allclose(other.displacements(pose), target, atol=1e-14)
    assert pose.translation_m.shape == (*shape, 3)
    orthonormal = pose.rotation @ pose.rotation.swapaxes(-1, -2)
    np.testing.assert_allclose(orthonormal, np.broadcast_to(np.eye(3), (*shape, 3, 3)), atol=1e-14)


@given(SEEDS)
def test_a_pose_is_recovered_from_its_lengths(seed):
    """A set of lengths has one pose in the range of the assembled machine."""
    twist = np.random.default_rng(seed).uniform(-1, 1, (4, 6)) * np.repeat([0.05, 0.02], 3)
    there = NOMINAL.moved(twist)
    pose = forward_kinematics(machine(), machine().displacements(there))
    np.testing.assert_allclose(pose.rotation, there.rotation, atol=1e-13)
    np.testing.assert_allclose(pose.translation_m, there.translation_m, atol=1e-13)


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e3])
@pytest.mark.parametrize("away", [0.0, 100.0])
def test_any_unit_of_length_and_any_origin_are_valid(scale, away):
    """Round-off is measured relative to the nodes' distances, whose differences are the lengths."""
    shift = np.array([0, 0, away])
    other = Hexapod(
        bottom_m=scale * (machine().bottom_m + shift), top_m=scale * (machine().top_m + shift)
    )
    target = scale * np.random.default_rng(3).uniform(-6e-4, 6e-4, (50, 6))
    off = np.abs(other.displacements(forward_kinematics(other, target)) - target).max()
    assert off <= 16 * np.finfo(float).eps * scale * (2 + away)


def test_the_pose_equals_that_of_the_physics(model):
    """MuJoCo closes the loops by its own constraints."""
    plant = Plant(model)
    plant.step(np.array([2e-4, -1e-4, 3e-4, 0.0, -2e-4, 1e-4]), 0.3)
    pose, truth = forward_kinematics(machine(), plant.displacements()), plant.pose()
    np.testing.assert_allclose(pose.translation_m, truth.translation_m, atol=1e-8)
    np.testing.assert_allclose(pose.rotation, truth.rotation, atol=3e-8)
    assert np.abs(truth.translation_m).max() > 1e-5


@pytest.mark.parametrize("target", [[2.0, 0, 0, 0, 0, 0], 6 * [-0.41], 3 * [-0.38, 0.5]])
def test_unreachable_lengths_are_rejected_and_the_others_solved(target):
    """Lengths are longer than the other struts permit, negative, or both."""
    many = np.zeros((4, 6))
    many[2] = target
    with pytest.raises(UnreachableLengths, match=r"displacements_m: .*1 of 4 sets of") as rejection:
        forward_kinematics(machine(), many)
    np.testing.assert_array_equal(rejection.value.reached, [True, True, False, True])
    assert rejection.value.residual_m[2] > 0.1
    forward_kinematics(machine(), many[rejection.value.reached])


def test_lengths_beyond_the_range_of_floats_are_rejected():
    with pytest.raises(ValueError, match=r"displacements_m must be at most 1e\+50, got 1e\+60"):
        forward_kinematics(machine(), np.full(6, -1e60))


def test_a_singular_start_does_not_stop_a_batch():
    """Starts have a strut of zero length, or all six in one plane, with a singular Jacobian."""
    on_its_node = machine().bottom_m[0] - machine().top_m[0]
    both = Pose(np.stack([np.eye(3)] * 2), np.stack([on_its_node, np.zeros(3)]))
    with pytest.raises(UnreachableLengths) as rejection:
        forward_kinematics(machine(), np.zeros(6), start=both)
    np.testing.assert_array_equal(rejection.value.reached, [False, True])
    flat = Pose(np.eye(3), np.array([0.0, 0.0, on_its_node[2]]))
    assert np.linalg.cond(machine().inverse_jacobian(flat)) > 1e10
    with pytest.raises(UnreachableLengths):
        forward_kinematics(machine(), np.zeros(6), start=flat)


@pytest.mark.parametrize("turn", np.linspace(0.0, 2.0, 9))
def test_a_payload_turned_by_a_right_angle_is_singular(turn):
    """The singularity is that of Fichter (1986), A Stewart platform-based manipulator."""
    angle = turn + np.radians([10, 110, 130, 230, 250, 350])
    bottom_m = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    top_m = 0.5 * bottom_m @ np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]]) + np.eye(3)[2]
    with pytest.raises(ValueError, match="singular"):
        Hexapod(bottom_m, top_m).moved(NOMINAL, 1e-6 * np.arange(6.0))
