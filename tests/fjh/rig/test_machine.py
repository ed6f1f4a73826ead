"""The hexapod's plant off its model, against linear models, statics, and what was drawn."""

from dataclasses import replace

import control
import numpy as np
import pytest

from fjh.rig import Rig
from fjh.rig.hexapod.columns import MAJOR
from fjh.rig.hexapod.detector import pointing_angles
from fjh.rig.hexapod.machine import detector_noise_rad, floor_acceleration
from fjh.rig.hexapod.mismatch import ALL, ALONE, differing
from fjh.rig.hexapod.rig import hexapod_rig, nominal_testbed
from fjh.rig.hexapod.testbed import TestbedConfig
from fjh.rig.mismatch import EXACT
from fjh.rig.run import rms
from sim import Array, Failure, Plant, linearize
from tests.fjh.rigs import readings
from tests.fjh.rigs import rig as shared_rig

PERIOD_S = 1e-3
STILL = dict.fromkeys(("floor_um_per_s", "hysteresis", "drift_urad_per_s", "gain_drift_per_s"), 0.0)


@pytest.fixture(scope="module")
def rig() -> Rig:
    return shared_rig("hexapod")


@pytest.fixture(scope="module")
def linear(rig):
    return linearize(rig.model, Plant(rig.model).data)


def flown(rig: Rig, commands: Array):
    """The bench after displacements (N, 6) were commanded, and what the detector read."""
    bench = rig.bench(np.arange(len(commands)) * PERIOD_S, [], 0)
    return bench, readings(bench, rig.control.testbed.amplifier().inputs(commands))[:, :2]


def response(A: Array, B: Array, C: Array, inputs: Array) -> Array:
    """Of a linear model to inputs (N, k) that are held in each tick."""
    sampled = control.c2d(control.ss(A, B, C, 0), PERIOD_S)
    ticks = np.arange(len(inputs)) * PERIOD_S
    return np.asarray(control.forced_response(sampled, ticks, inputs.T).outputs).T


def test_a_plant_without_mismatch_is_the_model_to_the_last_bit():
    floor = floor_acceleration(150, PERIOD_S, 1e-5, [7])
    plain = hexapod_rig(start_m=np.full(6, 1e-6), floor_m_per_s2=floor)
    machine = replace(plain.machine, differs=differing(plain.model, EXACT, 5))
    failures, path = [Failure(2, "weak", 0.05), Failure(0, "locked", 0.1)], TestbedConfig()
    run, exact = (
        one.fly(one.controller(), path.spiral_rad(0.15), failures=failures, lead_in_s=0.05)
        for one in (plain, replace(plain, machine=machine))
    )
    for name in ("true", "measured", "inputs", "displacement", "qpos", "closure_m", "saturated"):
        np.testing.assert_array_equal(getattr(run, name), getattr(exact, name))


@pytest.mark.parametrize("seed", [0, 1])
def test_the_drawn_plant_moves_as_its_own_linear_model_a_tick_late(rig, seed):
    """All together, behind the converters' hold; fine steps make the integrator's error small."""
    drawn = rig.drawn(replace(ALL, **STILL, timestep_s=6.25e-5), seed)
    commands = 1e-5 * np.repeat(np.random.default_rng(seed).normal(size=(10, 6)), 30, axis=0)
    bench, _ = flown(drawn, commands)
    linear = linearize(drawn.machine.model, Plant(drawn.machine.model).data)
    late = np.vstack([np.zeros((1, 6)), commands[:-1]])
    predicted = response(linear.A, linear.B, linear.C_active, late)
    # Beyond the quantization, what is left is the integrator's error, below 1 % of the modes.
    error = np.abs(bench.displacement - predicted).max()
    assert error < 0.01 * np.abs(bench.displacement).max()


def test_the_payload_rests_at_its_nominal_pose_whatever_the_springs(rig):
    for seed in range(3):
        plant = Plant(rig.drawn(ALL, seed).machine.model)
        plant.settle(1.0)
        assert np.abs(plant.displacement()).max() < 1e-8  # the closures give by as much


def test_the_drift_of_the_detectors_zero_is_read_and_nothing_else(rig):
    drawn, commands = rig.drawn(ALONE["drift_urad_per_s"].scaled(100), 1), np.zeros((50, 6))
    (_, plain), (_, adrift) = flown(rig, commands), flown(drawn, commands)
    ramp = np.outer(np.arange(50) * PERIOD_S, drawn.machine.differs.drift_rad_per_s)
    np.testing.assert_allclose(adrift - plain, ramp, atol=1e-18)


def test_a_gain_that_drifts_grows_with_time_from_the_start(rig):
    """What is reached by constant commands, once the modes have died away."""
    drawn, commands = rig.drawn(ALONE["gain_drift_per_s"].scaled(100), 1), np.full((800, 6), 1e-4)
    (plain, _), (adrift, _) = flown(rig, commands), flown(drawn, commands)
    change = (adrift.displacement / plain.displacement)[500:] - 1
    time_s = np.arange(500, 800) * PERIOD_S
    expected = np.outer(time_s, drawn.machine.differs.gain_drift_per_s)
    np.testing.assert_allclose(change, expected, atol=0.02 * np.abs(expected).max())


def test_the_floor_moves_the_payload_as_its_linear_model_says(rig, linear):
    """Without control: pointing is that of B_floor under this very floor."""
    drawn = rig.drawn(ALONE["floor_um_per_s"], 2)
    bench, _ = flown(drawn, np.zeros((600, 6)))
    expected = response(linear.A, linear.B_floor, linear.C_twist[MAJOR], drawn.machine.floor(600))
    error = pointing_angles(bench.rotation) - expected
    assert np.abs(expected).max() > 3e-7
    assert np.sqrt((error**2).mean()) < 0.04 * np.sqrt((expected**2).mean())


def test_hysteresis_reads_as_its_chain_along_the_whole_loop(rig):
    """Displacement under a slow triangle of commands: forces of coil, spring and chain balance."""
    fine = hexapod_rig(nominal_testbed(TestbedConfig(dac_bits=32)))
    drawn = fine.drawn(ALONE["hysteresis"].scaled(10), 1)
    up = np.linspace(0, 3e-5, 400)
    commands = np.concatenate([up, up[::-1], -up, -up[::-1]])[:, None] * np.ones(6)
    bench, _ = flown(drawn, commands)
    slip, stretch, chain = drawn.machine.differs.hysteresis, np.zeros((6, 4)), []
    for by in np.diff(bench.displacement, axis=0, prepend=bench.displacement[:1]):
        stretch = slip.moved(stretch, by)
        chain.append(slip.force(stretch))
    k = rig.model.jnt_stiffness[rig.model.actuator_trnid[:, 0]]
    missing = k * commands - 0.9 * k * bench.displacement + np.array(chain)
    # What is missing is inertia, damping and the flexures, all small at this speed.
    assert np.abs(missing).max() < 0.05 * np.abs(k * commands).max()
    assert np.abs(np.array(chain)).max() > 0.03 * np.abs(k * commands).max()


@pytest.mark.long
@pytest.mark.parametrize("seed", [0, 1])
def test_pointing_holds_on_a_plant_with_all_mismatches(rig, seed):
    """Within 10 % of the sound linear model with the same noise on the same floor."""
    bench, ticks, drawn = TestbedConfig(), 8000, rig.drawn(ALL, seed)
    path, machine = bench.spiral_rad(8.0), drawn.machine
    run = drawn.fly(drawn.controller(), path, seed=seed)
    noise, floor = detector_noise_rad(bench, seed, ticks), machine.floor(ticks)
    expected = rig.predict(path, noise=noise, floor_m_per_s2=floor).rms
    np.testing.assert_allclose(rms(run.error - machine.zero_rad(ticks)), expected, rtol=0.1)
