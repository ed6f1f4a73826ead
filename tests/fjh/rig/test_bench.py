"""Sensors, converters, controller: the bench around the plant."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fjh.rig.hexapod import paper
from fjh.rig.hexapod.amplifier import Amplifier
from fjh.rig.hexapod.closed_form import hexapod
from fjh.rig.hexapod.columns import MAJOR, SECONDARY
from fjh.rig.hexapod.controller import StrutMapping, nominal_loops
from fjh.rig.hexapod.detector import Detector, pointing_angles, secondary_motion
from fjh.rig.hexapod.rig import hexapod_rig, nominal_testbed
from fjh.rig.hexapod.strut_sensors import StrutSensors
from fjh.rig.hexapod.testbed import TestbedConfig
from fjh.rig.hexapod.trajectory import spiral
from ftc import Goal, Measurement, PrioritizedController
from sim import NOMINAL, Pose

EQUAL = (1.0,) * 6


def test_pointing_angles_are_rotations_about_x_b_and_y_b_and_blind_to_z_b():
    alpha, beta = 3e-4, -2e-4
    R = Rotation.from_rotvec([alpha, beta, 0]).as_matrix()
    np.testing.assert_allclose(pointing_angles(R), [alpha, beta], atol=1e-10)
    spun = R @ Rotation.from_rotvec([0, 0, 0.5]).as_matrix()
    np.testing.assert_allclose(pointing_angles(spun), pointing_angles(R), atol=1e-15)


def test_secondary_motion_is_the_rotation_about_z_b_and_the_translation():
    pose = NOMINAL.moved(np.array([0, 0, 2e-5, 1e-6, 2e-6, 3e-6]))
    motion = secondary_motion(pose.rotation, pose.translation_m)
    np.testing.assert_allclose(motion, [2e-5, 1e-6, 2e-6, 3e-6], atol=1e-12)
    two = np.stack([pose.rotation, np.eye(3)]), np.stack([pose.translation_m, np.zeros(3)])
    np.testing.assert_array_equal(secondary_motion(*two), [motion, np.zeros(4)])


def test_the_detector_reads_the_pointing_angles_through_its_optics():
    R = Rotation.from_rotvec([1e-4, -5e-5, 0]).as_matrix()
    rng = np.random.default_rng(0)
    quiet = Detector(focal_length_m=1.0, half_width_m=5e-3, noise_m=0.0)
    np.testing.assert_allclose(quiet.read(R, rng), [1e-4, -5e-5], atol=1e-9)
    noisy = Detector(focal_length_m=1.0, half_width_m=5e-3, noise_m=3e-7)
    readings = np.array([noisy.read(R, rng) for _ in range(4000)])
    np.testing.assert_allclose(readings.std(axis=0), 3e-7, rtol=0.05)


def test_the_spot_saturates_at_the_edge_of_the_detector():
    detector = Detector(focal_length_m=1.0, half_width_m=5e-3, noise_m=0.0)
    R = Rotation.from_rotvec([0.02, 0, 0]).as_matrix()
    np.testing.assert_allclose(detector.read(R, np.random.default_rng(0)), [5e-3, 0], atol=1e-12)


def test_a_saturated_detector_reads_its_edge_and_no_noise():
    """The noise is the spot's: where the spot is off the detector, the reading stands still."""
    detector = Detector(focal_length_m=2.0, half_width_m=5e-3, noise_m=1e-5)
    rng = np.random.default_rng(0)
    for direction in ([0.02, -0.02, 0], [-0.02, 0.02, 0]):
        R = Rotation.from_rotvec(direction).as_matrix()
        edge_rad = np.sign(direction[:2]) * 5e-3 / 2.0
        for _ in range(20):
            np.testing.assert_array_equal(detector.read(R, rng), edge_rad)


def test_the_gauges_read_the_struts_with_the_noise_that_is_stated():
    """Each of its own, unbiased: 20000 samples give the standard deviation to a per cent."""
    true_m, rng = np.linspace(-1e-5, 1e-5, 6), np.random.default_rng(0)
    gauges = StrutSensors(noise_m=5e-8)
    errors = np.array([gauges.read(true_m, rng) for _ in range(20000)]) - true_m
    np.testing.assert_allclose(errors.std(axis=0), 5e-8, rtol=0.02)
    np.testing.assert_allclose(errors.mean(axis=0), 0, atol=4 * 5e-8 / np.sqrt(20000))
    np.testing.assert_allclose(np.corrcoef(errors.T), np.eye(6), atol=0.04)


def test_the_converter_sends_the_nearest_code_and_none_beyond_its_range():
    """-32768..32767: the largest positive input is one step short of 100 %."""
    amplifier = Amplifier(
        bits=16, full_input_a=4.0, limit_a=4.0, newton_per_a=20.0, newton_per_m=1e5
    )
    step_m, step_percent = 4.0 * 20.0 / 1e5 / 2**15, 100 / 2**15
    steps = np.array([-1.6, -1.4, -0.6, -0.4, 0.4, 0.6, 1.4, 1.6])
    codes = amplifier.inputs(steps * step_m) / step_percent
    np.testing.assert_array_equal(codes, [-2, -1, -1, 0, 0, 1, 1, 2])
    far = np.array([-40000, -32768, 32767, 32768, 40000])
    codes = amplifier.inputs(far * step_m) / step_percent
    np.testing.assert_array_equal(codes, [-32768, -32768, 32767, 32767, 32767])


def test_the_converter_has_sixteen_bits_and_the_amplifier_saturates():
    amplifier = Amplifier(
        bits=16, full_input_a=4.0, limit_a=3.0, newton_per_a=20.0, newton_per_m=1e5
    )
    step_m = 4.0 * 20.0 / 1e5 / 2**15
    fine = amplifier.displacements(amplifier.inputs(np.linspace(0, 5, 200) * step_m))
    np.testing.assert_allclose(np.unique(fine), np.arange(6) * step_m, atol=1e-18)
    assert amplifier.inputs(np.array(1.0)) == pytest.approx(100.0, abs=0.004)
    assert amplifier.inputs(np.array(-1.0)) == -100.0
    assert amplifier.current_a(np.array([50.0, -100.0])).tolist() == [2.0, -3.0]
    # Beyond its limit the amplifier gives no more force, so the strut goes no further.
    assert amplifier.displacements(np.array(100.0)) == pytest.approx(3.0 * 20.0 / 1e5)


def test_the_amplifiers_full_scale_is_the_coils_force_limit(model):
    """100 % input, largest current, largest coil force and full stroke are one point."""
    coil, strut = model.actuator("coil1"), model.joint("strut1")
    assert coil.gainprm[0] == strut.stiffness[0]
    amplifier = TestbedConfig().amplifier(newton_per_m=coil.gainprm[0])
    full_force = amplifier.current_a(np.array(100.0)) * amplifier.newton_per_a
    assert full_force == pytest.approx(coil.forcerange[1], rel=1e-9)
    assert amplifier.displacements(np.array(100.0)) == pytest.approx(strut.range[1], rel=1e-9)


@pytest.mark.long
def test_a_saturated_amplifier_shows_in_the_run():
    """Half a per cent of the current: the spiral outgrows it."""
    bench = TestbedConfig()
    weak = replace(bench, amplifier_limit_a=0.005 * bench.dac_full_input_a)
    rigs = [hexapod_rig(nominal_testbed(each)) for each in (bench, weak)]
    full, cut = (one.fly(one.controller(), bench.spiral_rad(4.0)) for one in rigs)
    assert np.abs(full.inputs).max() > 0.5
    limit_m = 0.005 * 0.000635
    assert np.abs(cut.displacement).max() < 1.1 * limit_m
    assert np.abs(full.displacement).max() > 1.1 * limit_m


def test_the_spiral_starts_at_the_centre_and_ends_after_eight_turns_at_its_radius():
    path = spiral(np.array([0.0, 1.0, 16.0]), radius_rad=1e-4, turns=8, duration_s=16)
    np.testing.assert_allclose(path, [[0, 0], [-1e-4 / 16, 0], [1e-4, 0]], atol=1e-15)


def test_the_loops_have_textbook_margins_at_the_crossovers_asked_for(model):
    bench = TestbedConfig()
    for loop, crossover in zip(nominal_loops(model, bench), bench.crossover_hz, strict=True):
        assert loop.crossover_hz == pytest.approx(crossover, rel=1e-3)
        assert loop.gain_margin_db > 6.0
        assert loop.phase_margin_deg > 45.0


def test_the_stated_gain_margin_is_where_the_loop_goes_unstable(model):
    """The whole discrete loop is stable just below the margin and unstable just above."""
    import control

    from fjh.rig.hexapod.controller import sampled
    from sim import Plant, linearize

    bench = TestbedConfig()
    loops = nominal_loops(model, bench)
    plant = Plant(model)
    gain = StrutMapping(hexapod(model), Goal(joint_weight=EQUAL), "constant").major_gain()
    P = sampled(linearize(plant.model, plant.data), gain, bench.control_period_s)
    for row, loop in enumerate(loops):
        margin = 10 ** (loop.gain_margin_db / 20)
        for factor, stable in ((0.98 * margin, True), (1.02 * margin, False)):
            closed = control.feedback(P[row, row] * loop.discrete * factor, 1)
            assert (np.abs(closed.poles()).max() < 1) == stable


@pytest.mark.parametrize("locked", [{}, {0: 0.0}, {3: 2e-4}])
def test_commanded_displacements_point_where_asked_with_the_secondary_goal_met(model, locked):
    """Forward through the exact geometry; a strut stuck off centre is a known offset."""
    machine = hexapod(model)
    goal = Goal(secondary_weight=(10.0, 10.0, 1.0, 1.0), locked_at=locked)
    mapping = StrutMapping(machine, goal, "analytic")
    asked, command, pose = np.array([8e-5, -5e-5]), np.zeros(6), NOMINAL
    for _ in range(4):  # the estimate settles in a tick or two
        command = mapping.displacements(asked, pose)
        pose = mapping.estimate(command, pose)
    assert all(command[k] == 0.0 for k in locked)
    lengths = command + [locked.get(k, 0.0) for k in range(6)]
    np.testing.assert_allclose(machine.displacements(pose), lengths, atol=1e-12)
    # J(x) l against the true x: the difference is of second order in the displacement.
    scale = np.abs(lengths).max()
    np.testing.assert_allclose(pointing_angles(pose.rotation), asked, atol=50 * scale**2 + 1e-9)
    others = Goal(secondary_weight=(1.0, 1.0, 1.0, 1.0), locked_at=locked)
    plain = StrutMapping(machine, others, "analytic")
    translation = [
        np.linalg.norm(m.estimate(m.displacements(asked, pose), pose).translation_m[:2])
        for m in (mapping, plain)
    ]
    assert translation[0] <= translation[1] + 1e-12


def test_the_constant_jacobian_is_the_analytic_one_at_the_nominal_pose(model):
    goal = Goal(joint_weight=EQUAL)
    machine = hexapod(model)
    asked = np.array([1e-4, 2e-5])
    analytic, constant = (
        StrutMapping(machine, goal, choice) for choice in ("analytic", "constant")
    )
    nominal = constant.displacements(asked, NOMINAL)
    np.testing.assert_array_equal(analytic.displacements(asked, NOMINAL), nominal)
    moved = NOMINAL.moved(np.array([0.01, 0, 0, 0.001, 0, 0]))
    np.testing.assert_array_equal(constant.displacements(asked, moved), nominal)
    assert np.abs(analytic.displacements(asked, moved) - nominal).max() > 1e-8
    struts_m = np.linspace(0, 5e-6, 6)
    pointing = constant.major_motion(struts_m, NOMINAL)
    np.testing.assert_array_equal(constant.major_motion(struts_m, moved), pointing)
    assert np.abs(analytic.major_motion(struts_m, moved) - pointing).max() > 1e-8


def test_the_secondary_rows_are_t_x_t_y_t_z_gamma(model):
    """The paper's Diag[10, 10, 1, 1] must fall on the translations across the line of sight."""
    J = np.linalg.inv(hexapod(model).inverse_jacobian(NOMINAL))
    np.testing.assert_allclose(J[SECONDARY], paper.JACOBIAN[[3, 4, 5, 2]], atol=6e-4)
    np.testing.assert_allclose(J[MAJOR], paper.JACOBIAN[[0, 1]], atol=6e-4)


def test_a_controller_step_is_a_pure_function(model):
    bench = TestbedConfig()
    mapping = StrutMapping(hexapod(model), Goal(joint_weight=EQUAL), "analytic")
    amplifier = bench.amplifier(newton_per_m=126e3)
    controller = PrioritizedController(
        nominal_loops(model, bench), mapping, amplifier, bench.handover_s
    )
    state = controller.start()
    measurement = Measurement(np.zeros(2), np.zeros(6))
    once = controller.step(state, np.array([1e-5, 0]), measurement)
    again = controller.step(state, np.array([1e-5, 0]), measurement)
    np.testing.assert_array_equal(once.inputs, again.inputs)
    np.testing.assert_array_equal(state.compensator, 0.0)
    assert np.abs(once.compensator).max() > 0


def test_the_same_seed_gives_the_same_run_to_the_bit_and_another_does_not():
    one, path = hexapod_rig(), TestbedConfig().spiral_rad(0.2)
    first, second, other = (one.fly(one.controller(), path, seed=seed) for seed in (3, 3, 4))
    np.testing.assert_array_equal(first.true, second.true)
    np.testing.assert_array_equal(first.measured, second.measured)
    assert np.any(first.measured != other.measured)


def test_a_pose_moves_along_the_manifold():
    rng = np.random.default_rng(0)
    pose = Pose(np.eye(3), np.zeros(3))
    for _ in range(1000):
        pose = pose.moved(0.1 * rng.normal(size=6))
    np.testing.assert_allclose(pose.rotation @ pose.rotation.T, np.eye(3), atol=1e-12)
