"""The compiled parts of a simulated tick, against numpy and scipy over random poses."""

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from kernels import lib, pointer
from sim import Bench, Plant, Pose, load_model
from sim.plant import TaskSensor

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


@pytest.mark.parametrize("bad", [0.0, np.nan, np.inf])
def test_the_largest_gap_in_its_unit_hides_none_that_is_not_finite(bad):
    gaps, units = np.random.default_rng(0).normal(size=(2, 9))
    gaps[4] += bad
    found = lib.largest(pointer(gaps), pointer(units), 7)
    np.testing.assert_array_equal(found, np.abs(gaps * units)[:7].max())


MIXED = """<mujoco><worldbody><body><joint name="j" axis="0 1 0" stiffness="9"/>
<geom size=".1"/><site name="payload" pos="1 0 0"/>
<body pos="1 0 0"><joint name="t" axis="0 1 0"/><geom size=".1"/></body></body></worldbody>
<tendon><fixed name="t" stiffness="5"><joint joint="t" coef="2"/></fixed></tendon>
<equality><joint name="lock2" joint1="j" active="false"/></equality>
<actuator><position tendon="t" gear="3" kp="40"/><motor joint="j"/></actuator></mujoco>"""
"""Drives of both kinds, a tendon first; seen from the world."""


@pytest.mark.parametrize("mixed", [False, True], ids=["hexapod", "tendon and joint"])
def test_a_log_has_what_the_plant_says_of_itself_at_each_tick(mixed):
    model = mujoco.MjModel.from_xml_string(MIXED) if mixed else load_model()
    plant = Plant(model, base=None) if mixed else Plant(model)
    sensors, period_s = TaskSensor([0], 0.0, 0.0, seed=0), plant.model.opt.timestep * 4
    bench = Bench(plant, sensors, time_s=np.arange(3.0), period_s=period_s, keep_qpos=True)
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
