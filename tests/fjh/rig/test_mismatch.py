"""Plants with a mismatch: each size is sampled as documented and has the stated effect."""

from dataclasses import replace
from functools import cache
from typing import Any

import control
import mujoco
import numpy as np
import pytest
from scipy.stats import kstest

from fjh.rig import Rig
from fjh.rig.hexapod import mismatch as hexapod
from fjh.rig.hexapod.columns import MAJOR
from fjh.rig.hexapod.detector import pointing_angles
from fjh.rig.hexapod.machine import floor_acceleration
from fjh.rig.hexapod.rig import hexapod_rig, nominal_testbed
from fjh.rig.hexapod.testbed import TestbedConfig
from fjh.rig.mismatch import EXACT, LIMITS, Mismatch, sampled_model
from fjh.rig.options import RobotOptions
from fjh.rig.random_streams import RandomStreams
from fjh.rig.robot import Robot, robot_of
from fjh.rig.robot_machine import ALL as ROBOTS
from fjh.rig.robot_machine import SIZES, RobotMachine
from fjh.study.errors import WrongInput
from sim import Array, Bench, Failure, Mechanism, ModelError, Plant, linearize, load_model
from sim.plant import JointSensors, TaskSensor
from tests.fjh.rigs import ARM, ROWS, readings, shared_rig
from tests.robots import TEST_MODELS

EVERYTHING = {"hexapod": replace(hexapod.ALL, hysteresis=0.0), "driven": ROBOTS}
SAMPLED_SIZES = {"hexapod": hexapod.SAMPLED, "driven": ("gain", "damping", "inertia")}


def alone(everything: Mismatch, name: str) -> Mismatch:
    return Mismatch(**{name: getattr(everything, name)})


@cache
def driven() -> Robot:
    return robot_of(TEST_MODELS / "driven.xml", RobotOptions(noise=1e-5), settle=False)


def sampled_sizes(name: str, sizes: Mismatch, seed: int) -> dict[str, np.ndarray]:
    """Return relative differences of a plant's model from the nominal one by sampled size."""
    if name == "hexapod":
        nominal = shared_rig(name)
        known, other = nominal.model, nominal.with_mismatch(sizes, seed).machine.model
    else:
        known, streams = driven().model, RandomStreams(seed, sizes.family)
        other, _ = sampled_model(known, driven().nominal_plant.drives, sizes, streams)
    springs, bodies = known.jnt_stiffness > 0, known.body_mass > 0
    dampers = known.jnt_dofadr[known.actuator_trnid[:, 0]]
    servos = known.actuator_biasprm[:, 2] < 0
    kv, other_kv = (
        model.actuator_biasprm[servos, 2] / model.actuator_biasprm[servos, 1]
        for model in (known, other)
    )
    ratios = {
        "gain": [other.actuator_gainprm[:, 0] / known.actuator_gainprm[:, 0]],
        "stiffness": [other.jnt_stiffness[springs] / known.jnt_stiffness[springs]],
        "damping": [other.dof_damping[dampers] / known.dof_damping[dampers], other_kv / kv],
        "inertia": [
            other.body_mass[bodies] / known.body_mass[bodies],
            other.body_inertia[bodies, 0] / known.body_inertia[bodies, 0],
        ],
    }
    return {name: np.concatenate(parts) - 1 for name, parts in ratios.items()}


@cache
def many(machine: str) -> list[dict[str, np.ndarray]]:
    return [sampled_sizes(machine, EVERYTHING[machine], seed) for seed in range(40)]


@pytest.mark.parametrize(
    ("machine", "name"),
    [(machine, name) for machine in SAMPLED_SIZES for name in SAMPLED_SIZES[machine]],
)
def test_a_size_fills_its_range_and_is_sampled_independently_of_others(machine, name):
    everything = EVERYTHING[machine]
    samples, size = np.array([plant[name] for plant in many(machine)]), getattr(everything, name)
    assert np.abs(samples).max() <= size * (1 + 1e-9)
    assert kstest(samples.ravel() / size, "uniform", (-1, 2)).pvalue > 1e-3
    assert abs(np.corrcoef(samples[:, 0], samples[:, 1])[0, 1]) < 0.5
    for seed in (3, 7):
        result = sampled_sizes(machine, alone(everything, name), seed)
        np.testing.assert_allclose(result.pop(name), samples[seed], rtol=0, atol=1e-14)
        for other in result.values():
            assert np.abs(other).max() < 1e-12


def test_drifts_lie_in_their_ranges_and_in_all_directions():
    everything = hexapod.ALL
    differences = [
        shared_rig("hexapod").with_mismatch(everything, seed).machine.differs for seed in range(60)
    ]
    zero = 1e6 * np.array([each.drift_rad_per_s for each in differences])
    assert np.hypot(*zero.T).max() <= everything.drift_urad_per_s
    assert kstest(np.arctan2(zero[:, 1], zero[:, 0]), "uniform", (-np.pi, 2 * np.pi)).pvalue > 1e-3
    gains = np.array([each.gain_drift_per_s for each in differences]) / everything.gain_drift_per_s
    assert kstest(gains.ravel(), "uniform", (-1, 2)).pvalue > 1e-3
    slips = np.array([each.hysteresis.slip for each in differences])
    assert slips.min() >= hexapod.SLIP_M[0] and slips.max() <= hexapod.SLIP_M[1]


def excited(rig: Rig) -> np.ndarray:
    """Return the readings of a plant under steps for 60 ticks."""
    bench, steps = rig.bench(np.arange(60) * rig.period_s, [], 5), np.repeat([0.0, 1.0], [20, 40])
    peak = 1.0 if rig.title.startswith("University") else 1e-3
    return readings(bench, peak * np.outer(steps, np.arange(len(rig.actuators))))


@pytest.mark.parametrize(
    ("robot", "name"),
    [*(("hexapod", name) for name in hexapod.SIZES), *(("arm", name) for name in SIZES)],
)
def test_every_size_alone_changes_the_readings_and_a_seed_repeats_them(robot, name):
    rig = shared_rig(robot)
    plant_rig = rig.with_mismatch(alone(rig.machine.everything, name), 5)
    other, again = excited(plant_rig), excited(plant_rig)
    assert not np.array_equal(excited(rig), other)
    np.testing.assert_array_equal(again, other)


@pytest.mark.parametrize("name", ["hexapod", "arm"])
def test_a_mismatch_changes_the_plant_alone(name):
    rig, plant_rig = shared_rig(name, "all"), shared_rig(name).with_mismatch("all", 3)
    np.testing.assert_array_equal(excited(rig), excited(plant_rig))
    np.testing.assert_array_equal(plant_rig.nominal.plant.A, shared_rig(name).nominal.plant.A)


def test_scaling_multiplies_all_sizes():
    everything = hexapod.ALL
    third = everything.scaled(1 / 3)
    for name in set(LIMITS) - {"delay_ticks"}:
        assert getattr(third, name) == pytest.approx(getattr(everything, name) / 3)
    assert third.delay_ticks == 0 and Mismatch(delay_ticks=2).scaled(1.4).delay_ticks == 3
    assert everything.scaled(0) == EXACT and everything.scaled(1) == everything
    with pytest.raises(ValueError, match=r"damping must be a number from 0 to 0\.99"):
        everything.scaled(10)


def test_an_inapplicable_size_is_rejected_by_name():
    for name in shared_rig("arm").machine.unknown:
        with pytest.raises(WrongInput, match=f"{name} does not apply to this robot, got 0.001"):
            shared_rig("arm").with_mismatch(replace(EXACT, **{name: 1e-3}), 0)


@pytest.mark.parametrize("seed", range(3))
def test_the_controls_are_those_of_the_controllers_model(seed):
    """Controls change as much as without a mismatch, for all sampled gains."""
    gain, command = Mismatch(gain=ROBOTS.gain), 1e-4 * np.array([1.0, -2.0, 3.0])
    changes, moved = [], []
    for sizes in (EXACT, gain, ROBOTS):
        bench = RobotMachine(driven(), sizes, seed).bench(np.zeros(1500), [], seed)
        initial = bench.plant.data.ctrl.copy()
        readings(bench, np.tile(command, (1500, 1)))
        changes.append(bench.plant.data.ctrl - initial)
        moved.append(bench.displacement[-1])
    np.testing.assert_allclose(changes[1:], [changes[0]] * 2, rtol=1e-12)
    ratio = moved[1] / moved[0]
    gains = sampled_model(
        driven().model, driven().nominal_plant.drives, gain, RandomStreams(seed, "uniform")
    )[1]
    assert ratio[0] == pytest.approx(gains[0], abs=1e-4)  # a coil moves by its gain
    assert ratio[1] == pytest.approx(1.0, abs=1e-4)  # a servo reaches its target for any gain
    assert abs(ratio[2] - 1) < abs(gains[2] - 1)  # one acts partly against a spring


STEPS = np.outer(np.repeat([0.0, 1e-3], [20, 80]), np.arange(7.0))


def simulated(mismatch: Mismatch, sense: Any = "task", seed: int = 3) -> tuple[Bench, np.ndarray]:
    """Simulate the arm under steps for a tenth of a second; return bench and readings."""
    rig = shared_rig("arm", sense=sense, crossover=0.7, noise=1e-5).with_mismatch(mismatch, seed)
    bench = rig.bench(np.arange(100) * 1e-3, [], seed)
    return bench, readings(bench, STEPS)


def test_an_exact_plant_is_to_the_bit_a_bench_of_the_model():
    """Encoders are those of `JointSensors` with the same seed."""
    model = load_model(ARM, add_locks=True)
    plant = Plant(model, base=None, start=mujoco.MjData(model))
    sensors = JointSensors(Mechanism(model), ROWS["arm"], 1e-5, 3)
    expected = sensors.read(plant.pose(), plant.displacements())
    np.testing.assert_array_equal(simulated(EXACT, "joints")[1][0], np.concatenate(expected))
    sensor = TaskSensor(ROWS["arm"], 1e-5, 1e-5, 3)
    bench = Bench(plant, sensor, time_s=np.arange(100) * 1e-3, period_s=1e-3)
    np.testing.assert_array_equal(simulated(EXACT)[1], readings(bench, STEPS))


def test_delayed_commands_delay_the_motion_by_as_many_ticks():
    prompt, late = (simulated(sizes)[0].displacement for sizes in (EXACT, Mismatch(delay_ticks=2)))
    np.testing.assert_array_equal(late[2:], prompt[:-2])


@pytest.mark.parametrize("sense", ["task", "joints", "both"])
def test_zeros_of_sensors_drift_and_the_task_from_encoders_with_them(sense):
    """The motion is unchanged; a task from encoders shifts by the Jacobian times the drift."""
    difference = simulated(Mismatch(drift_per_s=100.0), sense)[1] - simulated(EXACT, sense)[1]
    task, encoders = difference[:, :2], difference[:, 2:]
    ramp = np.linspace(0, 1, 100)[:, None]
    np.testing.assert_allclose(encoders, ramp * encoders[-1], atol=1e-15)
    assert 0 < np.abs(encoders[-1]).max() <= 100.0 * 1e-5 * 0.099 * (1 + 1e-9)
    if sense == "joints":
        mechanism = Mechanism(load_model(ARM, add_locks=True))
        J = mechanism.jacobians(mechanism.nominal).J_T[:2]
        ramp, expected = ramp[:20], (ramp * (J @ encoders[-1]))[:20]
        np.testing.assert_allclose(task[:20], expected, rtol=2e-3, atol=1e-9)
    else:
        np.testing.assert_allclose(task, ramp * task[-1], atol=1e-15)


PERIOD_S = 1e-3
STILL = dict.fromkeys(("floor_um_per_s", "hysteresis", "drift_urad_per_s", "gain_drift_per_s"), 0.0)


@pytest.fixture(scope="module")
def rig() -> Rig:
    return shared_rig("hexapod")


def commanded(rig: Rig, commands: Array):
    """Return the bench after commanded displacements (N, 6), and the detector's readings."""
    bench = rig.bench(np.arange(len(commands)) * PERIOD_S, [], 0)
    return bench, readings(bench, rig.control.testbed.amplifier().inputs(commands))[:, :2]


def response(A: Array, B: Array, C: Array, inputs: Array) -> Array:
    """Return the response of a linear model to zero-order-hold inputs (N, k)."""
    sampled = control.c2d(control.ss(A, B, C, 0), PERIOD_S)
    ticks = np.arange(len(inputs)) * PERIOD_S
    return np.asarray(control.forced_response(sampled, ticks, inputs.T).outputs).T


def test_a_machine_without_suspensions_has_no_hexapod_mismatch():
    with pytest.raises(ModelError, match="needs struts with suspension springs"):
        hexapod.sampled_differences(shared_rig("arm").model, EXACT, 0)


def test_a_plant_without_mismatch_is_the_model_to_the_last_bit():
    floor = floor_acceleration(150, PERIOD_S, 1e-5, [7])
    plain = hexapod_rig(start_m=np.full(6, 1e-6), floor_m_per_s2=floor)
    machine = replace(plain.machine, differs=hexapod.sampled_differences(plain.model, EXACT, 5))
    failures, path = [Failure(2, "weak", 0.05), Failure(0, "locked", 0.1)], TestbedConfig()
    run, exact = (
        rig.fly(rig.controller(), path.spiral_rad(0.15), failures=failures, lead_in_s=0.05)
        for rig in (plain, replace(plain, machine=machine))
    )
    for name in ("true", "measured", "inputs", "displacement", "qpos", "closure_m", "saturated"):
        np.testing.assert_array_equal(getattr(run, name), getattr(exact, name))


@pytest.mark.parametrize("seed", [0, 1])
def test_a_sampled_plant_moves_as_its_linear_model_one_tick_late(rig, seed):
    """The plant has mismatch of all kinds, converters with hold, and fine integrator steps."""
    plant_rig = rig.with_mismatch(replace(hexapod.ALL, **STILL, timestep_s=6.25e-5), seed)
    commands = 1e-5 * np.repeat(np.random.default_rng(seed).normal(size=(10, 6)), 30, axis=0)
    bench, _ = commanded(plant_rig, commands)
    linear = linearize(plant_rig.machine.model, Plant(plant_rig.machine.model).data)
    late = np.vstack([np.zeros((1, 6)), commands[:-1]])
    predicted = response(linear.A, linear.B, linear.C_active, late)
    # The error of quantization and integrator is below 1 % of the modes.
    off = np.abs(bench.displacement - predicted)
    assert off.max() < 0.01 * np.abs(bench.displacement).max()


def test_the_payload_rests_at_its_nominal_pose_for_any_springs(rig):
    for seed in range(3):
        plant = Plant(rig.with_mismatch(hexapod.ALL, seed).machine.model)
        plant.settle(1.0)
        assert np.abs(plant.displacement()).max() < 1e-8  # the closures deviate by as much


def test_the_drift_of_the_detectors_zero_changes_only_the_readings(rig):
    plant_rig, commands = (
        rig.with_mismatch(hexapod.ALONE["drift_urad_per_s"].scaled(100), 1),
        np.zeros((50, 6)),
    )
    (_, plain), (_, adrift) = commanded(rig, commands), commanded(plant_rig, commands)
    ramp = np.outer(np.arange(50) * PERIOD_S, plant_rig.machine.differs.drift_rad_per_s)
    np.testing.assert_allclose(adrift - plain, ramp, atol=1e-18)


def test_a_gain_that_drifts_grows_with_time_from_the_start(rig):
    """Displacements under constant commands, after the modes have decayed."""
    plant_rig = rig.with_mismatch(hexapod.ALONE["gain_drift_per_s"].scaled(100), 1)
    commands = np.full((800, 6), 1e-4)
    (plain, _), (adrift, _) = commanded(rig, commands), commanded(plant_rig, commands)
    change = (adrift.displacement / plain.displacement)[500:] - 1
    time_s = np.arange(500, 800) * PERIOD_S
    expected = np.outer(time_s, plant_rig.machine.differs.gain_drift_per_s)
    np.testing.assert_allclose(change, expected, atol=0.02 * np.abs(expected).max())


def test_the_floor_moves_the_payload_as_in_the_linear_model(rig):
    """Pointing without control is that of B_floor under the same floor motion."""
    linear = linearize(rig.model, Plant(rig.model).data)
    plant_rig = rig.with_mismatch(hexapod.ALONE["floor_um_per_s"], 2)
    bench, _ = commanded(plant_rig, np.zeros((600, 6)))
    expected = response(
        linear.A, linear.B_floor, linear.C_twist[MAJOR], plant_rig.machine.floor(600)
    )
    error = pointing_angles(bench.rotation) - expected
    assert np.abs(expected).max() > 3e-7
    assert np.sqrt((error**2).mean()) < 0.04 * np.sqrt((expected**2).mean())


def test_hysteresis_balances_its_chain_along_a_complete_loop(rig):
    """Forces of coil, spring and chain balance under a slow triangle of commands."""
    fine = hexapod_rig(nominal_testbed(TestbedConfig(dac_bits=32)))
    plant_rig = fine.with_mismatch(hexapod.ALONE["hysteresis"].scaled(10), 1)
    up = np.linspace(0, 3e-5, 400)
    commands = np.concatenate([up, up[::-1], -up, -up[::-1]])[:, None] * np.ones(6)
    bench, _ = commanded(plant_rig, commands)
    slip, stretch, chain = plant_rig.machine.differs.hysteresis, np.zeros((6, 4)), []
    for by in np.diff(bench.displacement, axis=0, prepend=bench.displacement[:1]):
        stretch = slip.moved(stretch, by)
        chain.append(slip.force(stretch))
    k = rig.model.jnt_stiffness[rig.model.actuator_trnid[:, 0]]
    missing = k * commands - 0.9 * k * bench.displacement + np.array(chain)
    # Inertia, damping and flexures are neglected, as they are small at this speed.
    assert np.abs(missing).max() < 0.05 * np.abs(k * commands).max()
    assert np.abs(np.array(chain)).max() > 0.03 * np.abs(k * commands).max()
