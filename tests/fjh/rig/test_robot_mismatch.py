"""Plants of any file that differ from their controller's model by what was drawn, and nothing else.

The oracles are MuJoCo's own controls, and the draws themselves.
"""

from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
import pytest
from scipy.stats import kstest

from fjh.rig.draw import Draw
from fjh.rig.mismatch import EXACT, Mismatch, sampled_model
from fjh.rig.mjcf import robot_rig
from fjh.rig.options import RobotOptions
from fjh.rig.robot import Robot, robot_of
from fjh.rig.robot_machine import ALL, SIZES, RobotMachine
from fjh.study.errors import WrongInput
from sim import HEXAPOD_MJCF, Bench, Mechanism, Plant, load_model
from sim.plant import JointSensors, TaskSensor

ARM = HEXAPOD_MJCF.with_name("arm.xml")

DRIVEN = """
<mujoco><option timestep="1e-3" integrator="implicitfast"><flag contact="disable"/></option>
  <worldbody>
  <body name="boom"><joint name="boom" axis="0 1 0" stiffness="40" damping="2"/>
    <geom type="capsule" fromto="0 0 0 .4 0 0" size=".02" mass="1"/>
    <body name="slide" pos=".4 0 0"><joint name="slide" type="slide" axis="0 0 1" damping="5"/>
      <geom size=".05" mass=".5"/>
      <body name="tip"><joint name="tip" axis="0 1 0" stiffness="3" damping=".1"/>
        <geom type="capsule" fromto="0 0 0 .1 0 0" size=".01" mass=".1"/>
        <site name="payload" pos=".1 0 0"/></body></body></body>
  </worldbody><actuator>
    <motor name="coil" joint="boom" gear="3"/>
    <position name="ram" joint="slide" kp="4000" kv="60"/>
    <position name="wrist" joint="tip" kp="20" kv=".4" gear="2"/>
  </actuator></mujoco>
"""
"""A motor against a spring, a servo without and one with a spring: all three laws of commands."""


@pytest.fixture(scope="module")
def driven(tmp_path_factory) -> Robot:
    file = tmp_path_factory.mktemp("driven") / "driven.xml"
    file.write_text(DRIVEN)
    return robot_of(file, RobotOptions(noise=1e-5), settle=False)


def alone(name: str) -> Mismatch:
    return replace(EXACT, **{name: getattr(ALL, name)})


def sampled(robot: Robot, sizes: Mismatch, seed: int) -> tuple[mujoco.MjModel, np.ndarray]:
    """The model of a plant, and the gains (n,) of its drives."""
    return sampled_model(robot.model, robot.known.drives, sizes, Draw(seed, sizes.family))


@pytest.mark.parametrize("seed", range(3))
def test_the_controls_are_those_of_the_controllers_model(driven, seed):
    """Whatever gains are drawn: no wire carries another change from rest than it would without."""
    changes, moved, command = [], [], 1e-4 * np.array([1.0, -2.0, 3.0])
    for sizes in (EXACT, alone("gain"), ALL):
        bench = RobotMachine(driven, sizes, seed).bench(np.zeros(1500), [], seed)
        rest = bench.plant.data.ctrl.copy()
        for _ in range(1500):
            bench.measure()
            bench.apply(command)
        changes.append(bench.plant.data.ctrl - rest)
        moved.append(bench.displacement[-1])
    np.testing.assert_allclose(changes[1:], [changes[0]] * 2, rtol=1e-12)
    ratio, gains = moved[1] / moved[0], sampled(driven, alone("gain"), seed)[1]
    assert ratio[0] == pytest.approx(gains[0], abs=1e-4)  # a coil moves by its gain
    assert ratio[1] == pytest.approx(1.0, abs=1e-4)  # a servo reaches its target whatever its gain
    assert abs(ratio[2] - 1) < abs(gains[2] - 1)  # one against a spring, in part


def drawn(robot: Robot, mismatch: Mismatch, seed: int) -> dict[str, np.ndarray]:
    """Relative differences of a model from the known one, by what is drawn."""
    model, (other, gains) = robot.model, sampled(robot, mismatch, seed)
    servos, bodies = [1, 2], model.body_mass > 0
    kv = other.actuator_biasprm[servos, 2] / other.actuator_biasprm[servos, 1]
    np.testing.assert_allclose(other.actuator_gainprm[:, 0] / model.actuator_gainprm[:, 0], gains)
    return {
        "gain": gains - 1,
        "damping": np.concatenate(
            [
                other.dof_damping / model.dof_damping - 1,
                kv * model.actuator_biasprm[servos, 1] / model.actuator_biasprm[servos, 2] - 1,
            ]
        ),
        "inertia": np.concatenate(
            [
                (other.body_mass[bodies] / model.body_mass[bodies]) - 1,
                (other.body_inertia[bodies, 0] / model.body_inertia[bodies, 0]) - 1,
            ]
        ),
    }


@pytest.mark.parametrize("name", ["gain", "damping", "inertia"])
def test_what_is_drawn_fills_its_range_and_is_alike_alone_and_with_the_others(driven, name):
    one = np.array([drawn(driven, alone(name), seed)[name] for seed in range(40)])
    size = getattr(ALL, name)
    assert kstest(one.ravel() / size, "uniform", (-1, 2)).pvalue > 1e-3
    assert np.abs(one).max() <= size * (1 + 1e-9)
    np.testing.assert_allclose(one[7], drawn(driven, ALL, 7)[name], atol=1e-12)
    for other in {"gain", "damping", "inertia"} - {name}:
        assert np.abs(drawn(driven, alone(name), 0)[other]).max() < 1e-12


def flown(mismatch: Mismatch, sense: Any = "task", seed: int = 3) -> tuple[Bench, np.ndarray]:
    """A tenth of a second of the arm under steps, and what its sensors read."""
    options = RobotOptions(sense=sense, crossover=0.7, noise=1e-5)
    bench = robot_rig(ARM, options).drawn(mismatch, seed).bench(np.arange(100) * 1e-3, [], seed)
    return bench, np.array([np.concatenate(each) for each in readings(bench)])


def readings(bench: Bench) -> list[tuple[np.ndarray, np.ndarray]]:
    read = []
    for tick in range(100):
        read.append(tuple(bench.measure()))
        bench.apply(1e-3 * np.arange(7.0) * (tick >= 20))
    return read


def test_an_exact_plant_is_to_the_bit_a_bench_of_the_model():
    model, rows = load_model(ARM, add_locks=True), (0, 1)
    plain = Bench(
        Plant(model, base=None, start=mujoco.MjData(model)),
        TaskSensor(rows, 1e-5, 1e-5, 3),
        time_s=np.arange(100) * 1e-3,
        period_s=1e-3,
    )
    expected = np.array([np.concatenate(each) for each in readings(plain)])
    np.testing.assert_array_equal(flown(EXACT)[1], expected)


@pytest.mark.parametrize("name", SIZES)
def test_every_size_changes_the_flight_and_a_seed_repeats_it(name):
    one = flown(alone(name))[1]
    assert not np.array_equal(one, flown(EXACT)[1])
    np.testing.assert_array_equal(one, flown(alone(name))[1])


@pytest.mark.parametrize("name", RobotMachine.unknown)
def test_a_size_that_a_robot_does_not_have_is_refused_by_its_name(name):
    with pytest.raises(WrongInput, match=f"no mismatch of {name}, got 0.001"):
        flown(replace(EXACT, **{name: 1e-3}))


def test_a_late_command_moves_the_plant_a_tick_late():
    prompt, late = flown(EXACT)[0].displacement, flown(alone("delay_ticks"))[0].displacement
    np.testing.assert_array_equal(late[1:], prompt[:-1])


@pytest.mark.parametrize("sense", ["task", "joints", "both"])
def test_zeros_drift_in_what_is_read_and_the_task_of_encoders_with_them(sense):
    """Nothing moves otherwise; a task that is computed moves by the Jacobian times the drift."""
    adrift = replace(EXACT, drift_per_s=100.0)
    difference = flown(adrift, sense)[1] - flown(EXACT, sense)[1]
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


def test_encoders_alone_are_read_of_the_plant_as_it_is():
    """With an exact plant the rig's encoders are those of `JointSensors` with its seed."""
    model = load_model(ARM, add_locks=True)
    sensors = JointSensors(Mechanism(model), (0, 1), 1e-5, 3)
    plant = Plant(model, base=None, start=mujoco.MjData(model))
    expected = sensors.read(plant.pose(), plant.displacements())
    np.testing.assert_array_equal(flown(EXACT, "joints")[1][0], np.concatenate(expected))
