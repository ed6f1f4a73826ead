"""Test the kernels of a simulated tick against numpy and scipy at random poses."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fjh.rig.hexapod.closed_form import Hexapod
from kernels import lib, pointer
from sim import Bench, Plant, Pose, load_model
from sim.plant import TaskSensor
from tests.sim.machines import plant_of

seeds = pytest.mark.parametrize("seed", range(8))


def pose(rng: np.random.Generator, *batch: int) -> Pose:
    turns = Rotation.random(int(np.prod(batch)), rng=rng).as_matrix()
    return Pose(turns.reshape(*batch, 3, 3), rng.normal(size=(*batch, 3)))


@pytest.mark.parametrize("angle", [0.0, 1e-200, 1e-12, 1e-5, 0.3, 3.0, np.pi, 40.0])
def test_a_pose_turns_about_its_rotation_vector_and_then_shifts(angle):
    rng = np.random.default_rng(1)
    at, axis = pose(rng, 5), rng.normal(size=(5, 3))
    turn = angle * axis / np.linalg.norm(axis, axis=1, keepdims=True)
    moved = at.moved(np.concatenate([turn, axis], axis=1))
    expected = Rotation.from_rotvec(turn).as_matrix() @ at.rotation
    np.testing.assert_allclose(moved.rotation, expected, atol=2e-14)
    np.testing.assert_array_equal(moved.translation_m, at.translation_m + axis)


@seeds
def test_a_newton_step_applies_the_twist_of_the_length_errors(seed):
    """Check as well that the struts follow to second order of the step."""
    rng = np.random.default_rng(seed)
    bottom, top = rng.normal(size=(2, 6, 3))
    geometry, at = Hexapod(bottom - [0, 0, 5], top), pose(rng)  # struts long enough for a direction
    here = geometry.posture(at)
    requested = here.displacement_m + 1e-6 * rng.normal(size=6)
    twist = np.linalg.solve(here.inverse_jacobian, requested - here.displacement_m)
    there, expected = geometry.moved(at, requested), geometry.posture(at.moved(twist))
    size = np.linalg.cond(here.inverse_jacobian)
    for name in ("rotation", "translation_m", "displacement_m", "inverse_jacobian"):
        close = {"atol": 1e-15 * size, "rtol": 1e-13}
        np.testing.assert_allclose(getattr(there, name), getattr(expected, name), **close)
    change, missed = here.inverse_jacobian @ rng.normal(size=6), []
    for step in (1e-3, 1e-4):
        requested = here.displacement_m + step * change
        missed.append(np.abs(geometry.moved(at, requested).displacement_m - requested).max())
    assert missed[0] / missed[1] == pytest.approx(100, rel=0.2)


@seeds
def test_the_spot_is_where_the_beam_crosses_the_focal_plane(seed):
    rng = np.random.default_rng(seed)
    R, noise, seen = pose(rng).rotation, rng.normal(size=2), np.empty(2)
    focal, half_width, deviation = 2.0, 1.5, 0.1
    lib.spot(pointer(R), focal, half_width, deviation, pointer(noise), pointer(seen))
    beam = np.linalg.solve(R, [0.0, 0.0, 1.0])
    spot = np.clip(focal * beam[:2] / beam[2] + deviation * noise, -half_width, half_width)
    np.testing.assert_allclose(seen, np.array([spot[1], -spot[0]]) / focal, rtol=1e-12)


def test_the_largest_gap_is_that_of_the_rows_that_count():
    rng = np.random.default_rng(0)
    gaps, counts = rng.normal(size=20), np.array([1.0, 0.0, 1.0])
    owners = rng.integers(3, size=20).astype(np.int32)
    for rows in range(21):
        own = [abs(gap) for gap, owner in zip(gaps[:rows], owners, strict=False) if owner != 1]
        result = lib.largest_gap(*map(pointer, (gaps, owners, counts)), rows)
        assert result == max(own, default=0.0)


@pytest.mark.parametrize("bad", [0.0, np.nan, np.inf])
def test_the_largest_gap_is_not_finite_if_any_gap_is_not(bad):
    gaps, units = np.random.default_rng(0).normal(size=(2, 9))
    gaps[4] += bad
    result = lib.largest(pointer(gaps), pointer(units), 7)
    np.testing.assert_array_equal(result, np.abs(gaps * units)[:7].max())


@pytest.mark.parametrize("mixed", [False, True], ids=["hexapod", "tendon and joint"])
def test_a_log_equals_the_state_of_the_plant_at_each_tick(mixed):
    """Check drives of both kinds, with world axes."""
    plant = plant_of("drives") if mixed else Plant(load_model())
    sensors, period_s = TaskSensor([0], 0.0, 0.0, seed=0), plant.model.opt.timestep * 4
    bench = Bench(plant, sensors, time_s=np.arange(3.0), period_s=period_s, log_qpos=True)
    for tick in range(3):
        bench.measure()
        assert bench.qpos is not None and bench.actuator_force is not None
        np.testing.assert_array_equal(bench.rotation[tick], plant.pose().rotation)
        np.testing.assert_array_equal(bench.translation_m[tick], plant.pose().translation_m)
        np.testing.assert_array_equal(bench.displacement[tick], plant.displacements())
        np.testing.assert_array_equal(bench.qpos[tick], plant.data.qpos)
        np.testing.assert_array_equal(bench.actuator_force[tick], plant.data.actuator_force)
        assert bench.closure_residual_m[tick] == plant.closure_residual_m()
        bench.apply(1e-5 * np.arange(len(plant.drives)))
    assert np.abs(bench.displacement[2]).max() > 1e-8
    with pytest.raises(IndexError):
        bench.measure()
