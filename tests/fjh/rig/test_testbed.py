"""What stands around the hexapod: path, detector, strut sensors."""

import numpy as np
from scipy.spatial.transform import Rotation

from fjh.rig.hexapod.detector import Detector, pointing_angles
from fjh.rig.hexapod.strut_sensors import StrutSensors
from fjh.rig.hexapod.trajectory import spiral

QUIET = Detector(focal_length_m=1.0, half_width_m=5e-3, noise_m=0.0)


def turned(*rotation_vector: float) -> np.ndarray:
    return Rotation.from_rotvec(rotation_vector).as_matrix()


def test_pointing_angles_are_rotations_about_x_b_and_y_b_and_blind_to_z_b():
    R = turned(3e-4, -2e-4, 0)
    np.testing.assert_allclose(pointing_angles(R), [3e-4, -2e-4], atol=1e-10)
    spun = R @ turned(0, 0, 0.5)
    np.testing.assert_allclose(pointing_angles(spun), pointing_angles(R), atol=1e-15)


def test_the_detector_reads_the_pointing_angles_through_its_optics():
    R, rng = turned(1e-4, -5e-5, 0), np.random.default_rng(0)
    np.testing.assert_allclose(QUIET.read(R, rng), [1e-4, -5e-5], atol=1e-9)
    noisy = Detector(focal_length_m=1.0, half_width_m=5e-3, noise_m=3e-7)
    readings = np.array([noisy.read(R, rng) for _ in range(4000)])
    np.testing.assert_allclose(readings.std(axis=0), 3e-7, rtol=0.05)


def test_a_saturated_detector_reads_its_edge_and_no_noise():
    """The noise is the spot's: where the spot is off the detector, the reading stands still."""
    rng = np.random.default_rng(0)
    np.testing.assert_allclose(QUIET.read(turned(0.02, 0, 0), rng), [5e-3, 0], atol=1e-12)
    noisy = Detector(focal_length_m=2.0, half_width_m=5e-3, noise_m=1e-5)
    for sign in (1.0, -1.0):
        R = turned(0.02 * sign, -0.02 * sign, 0)
        for _ in range(20):
            np.testing.assert_array_equal(noisy.read(R, rng), sign * np.array([1, -1]) * 5e-3 / 2.0)


def test_the_gauges_read_the_struts_with_the_noise_that_is_stated():
    """Each of its own, unbiased: 20000 samples give the standard deviation to a per cent."""
    true_m, rng = np.linspace(-1e-5, 1e-5, 6), np.random.default_rng(0)
    gauges = StrutSensors(noise_m=5e-8)
    errors = np.array([gauges.read(true_m, rng) for _ in range(20000)]) - true_m
    np.testing.assert_allclose(errors.std(axis=0), 5e-8, rtol=0.02)
    np.testing.assert_allclose(errors.mean(axis=0), 0, atol=4 * 5e-8 / np.sqrt(20000))
    np.testing.assert_allclose(np.corrcoef(errors.T), np.eye(6), atol=0.04)


def test_the_spiral_goes_from_the_centre_in_eight_turns_to_its_radius():
    path = spiral(np.array([0.0, 1.0, 16.0]), radius_rad=1e-4, turns=8, duration_s=16)
    np.testing.assert_allclose(path, [[0, 0], [-1e-4 / 16, 0], [1e-4, 0]], atol=1e-15)
