"""The plant of a file off its model: MuJoCo's own controls, and the draws themselves."""

from typing import Any

import mujoco
import numpy as np
import pytest

from fjh.rig.draw import Draw
from fjh.rig.mismatch import EXACT, Mismatch, sampled_model
from fjh.rig.options import RobotOptions
from fjh.rig.robot import robot_of
from fjh.rig.robot_machine import ALL, RobotMachine
from sim import Bench, Mechanism, Plant, load_model
from sim.plant import JointSensors, TaskSensor
from tests.fjh.rigs import ARM, ROWS, readings, rig
from tests.robots import TEST_MODELS


@pytest.mark.parametrize("seed", range(3))
def test_the_controls_are_those_of_the_controllers_model(seed):
    """Whatever gains are drawn: no wire carries another change from rest than it would without."""
    driven = robot_of(TEST_MODELS / "driven.xml", RobotOptions(noise=1e-5), settle=False)
    gain, command = Mismatch(gain=ALL.gain), 1e-4 * np.array([1.0, -2.0, 3.0])
    changes, moved = [], []
    for sizes in (EXACT, gain, ALL):
        bench = RobotMachine(driven, sizes, seed).bench(np.zeros(1500), [], seed)
        rest = bench.plant.data.ctrl.copy()
        readings(bench, np.tile(command, (1500, 1)))
        changes.append(bench.plant.data.ctrl - rest)
        moved.append(bench.displacement[-1])
    np.testing.assert_allclose(changes[1:], [changes[0]] * 2, rtol=1e-12)
    ratio = moved[1] / moved[0]
    gains = sampled_model(driven.model, driven.known.drives, gain, Draw(seed, "uniform"))[1]
    assert ratio[0] == pytest.approx(gains[0], abs=1e-4)  # a coil moves by its gain
    assert ratio[1] == pytest.approx(1.0, abs=1e-4)  # a servo reaches its target whatever its gain
    assert abs(ratio[2] - 1) < abs(gains[2] - 1)  # one against a spring, in part


STEPS = np.outer(np.repeat([0.0, 1e-3], [20, 80]), np.arange(7.0))


def flown(mismatch: Mismatch, sense: Any = "task", seed: int = 3) -> tuple[Bench, np.ndarray]:
    """A tenth of a second of the arm under steps, and what its sensors read."""
    one = rig("arm", sense=sense, crossover=0.7, noise=1e-5).drawn(mismatch, seed)
    bench = one.bench(np.arange(100) * 1e-3, [], seed)
    return bench, readings(bench, STEPS)


def test_an_exact_plant_is_to_the_bit_a_bench_of_the_model():
    """And its encoders are those of `JointSensors` with its seed."""
    model = load_model(ARM, add_locks=True)
    plant = Plant(model, base=None, start=mujoco.MjData(model))
    sensors = JointSensors(Mechanism(model), ROWS["arm"], 1e-5, 3)
    expected = sensors.read(plant.pose(), plant.displacements())
    np.testing.assert_array_equal(flown(EXACT, "joints")[1][0], np.concatenate(expected))
    sensor = TaskSensor(ROWS["arm"], 1e-5, 1e-5, 3)
    bench = Bench(plant, sensor, time_s=np.arange(100) * 1e-3, period_s=1e-3)
    np.testing.assert_array_equal(flown(EXACT)[1], readings(bench, STEPS))


@pytest.mark.parametrize("sense", ["task", "joints", "both"])
def test_zeros_drift_in_what_is_read_and_the_task_of_encoders_with_them(sense):
    """Nothing moves otherwise; a task that is computed moves by the Jacobian times the drift."""
    difference = flown(Mismatch(drift_per_s=100.0), sense)[1] - flown(EXACT, sense)[1]
    task, encoders = difference[:, :2], difference[:, 2:]
    ramp = np.linspace(0, 1, 100)[:, None]
    np.testing.assert_allclose(encoders, ramp * encoders[-1], atol=1e-15)
    assert 0 < np.abs(encoders[-1]).max() <= 100.0 * 1e-5 * 0.099 * (1 + 1e-9)
    if sense == "joints":
        mechanism = Mechanism(load_model(ARM, add_locks=True))
        J = mechanism.jacobians(mechanism.nominal).J_T[:2]
        ramp, expected = ramp[:20], (ramp * (J @ encoders[-1]))[:20]  # before the steps turn it
        np.testing.assert_allclose(task[:20], expected, rtol=2e-3, atol=1e-9)
    else:
        np.testing.assert_allclose(task, ramp * task[-1], atol=1e-15)
