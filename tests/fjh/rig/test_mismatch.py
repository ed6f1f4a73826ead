"""Plants drawn off the model: each difference does what it says, and none is the model itself."""

from dataclasses import replace

import control
import numpy as np
import pytest
from scipy.stats import kstest

from fjh.rig import Rig
from fjh.rig.hexapod.columns import MAJOR
from fjh.rig.hexapod.detector import pointing_angles
from fjh.rig.hexapod.machine import detector_noise_rad, floor_acceleration
from fjh.rig.hexapod.mismatch import ALL, ALONE, SLIP_M, differing
from fjh.rig.hexapod.rig import hexapod_rig, nominal_testbed
from fjh.rig.hexapod.testbed import TestbedConfig
from fjh.rig.mismatch import EXACT, LIMITS, Mismatch
from fjh.rig.run import rms
from sim import Failure, Plant, linearize, load_model

PERIOD_S = 1e-3
FINE = TestbedConfig(dac_bits=32)
INSIDE = ("gain", "stiffness", "damping", "inertia")
"""Sizes of what is drawn into the model."""


@pytest.fixture(scope="module")
def rig() -> Rig:
    return hexapod_rig()


def flown(rig: Rig, commands: np.ndarray):
    """The bench after displacements (N, 6) were commanded, and what the detector read."""
    bench = rig.bench(np.arange(len(commands)) * PERIOD_S, [], 0)
    inputs, seen = rig.control.testbed.amplifier().inputs(commands), []
    for each in inputs:
        seen.append(bench.measure().output)
        bench.apply(each)
    return bench, np.array(seen)


def test_a_plant_without_mismatch_is_the_model_to_the_last_bit():
    floor = floor_acceleration(300, PERIOD_S, 1e-5, [7])
    plain = hexapod_rig(start_m=np.full(6, 1e-6), floor_m_per_s2=floor)
    machine = replace(plain.machine, differs=differing(plain.model, EXACT, 5))
    failures = [Failure(2, "weak", 0.1), Failure(0, "locked", 0.15)]
    run, exact = (
        one.fly(one.controller(), TestbedConfig().spiral_rad(0.3), failures=failures, lead_in_s=0.1)
        for one in (plain, replace(plain, machine=machine))
    )
    for name in ("true", "measured", "inputs", "displacement", "qpos", "closure_m", "saturated"):
        np.testing.assert_array_equal(getattr(run, name), getattr(exact, name))


@pytest.mark.parametrize("name", ALONE)
def test_every_mismatch_alone_changes_the_run(rig, name):
    plain, other, again = (
        one.fly(one.controller(), TestbedConfig().spiral_rad(0.2)).measured
        for one in (rig, rig.drawn(ALONE[name], 5), rig.drawn(ALONE[name], 5))
    )
    assert not np.array_equal(plain, other)
    np.testing.assert_array_equal(again, other)


def relative(rig: Rig, mismatch: Mismatch, seed: int) -> dict[str, np.ndarray]:
    """Relative differences of a plant from the model, by what is sampled."""
    drawn, known = rig.drawn(mismatch, seed).machine.model, rig.model
    springs, bodies = known.jnt_stiffness > 0, known.body_mass > 0
    dampers = known.jnt_dofadr[known.actuator_trnid[:, 0]]
    return {
        "gain": (drawn.actuator_gainprm / known.actuator_gainprm.clip(1e-9))[:, 0] - 1,
        "stiffness": drawn.jnt_stiffness[springs] / known.jnt_stiffness[springs] - 1,
        "damping": drawn.dof_damping[dampers] / known.dof_damping[dampers] - 1,
        "inertia": np.concatenate(
            [
                drawn.body_mass[bodies] / known.body_mass[bodies] - 1,
                drawn.body_inertia[bodies, 0] / known.body_inertia[bodies, 0] - 1,
            ]
        ),
    }


@pytest.mark.parametrize("name", INSIDE)
def test_what_is_drawn_fills_its_range_and_stays_inside(rig, name):
    size = getattr(ALL, name)
    drawn = np.array([relative(rig, ALONE[name], seed)[name] for seed in range(40)])
    assert np.abs(drawn).max() <= size * (1 + 1e-12)
    assert kstest(drawn.ravel() / size, "uniform", (-1, 2)).pvalue > 1e-3
    assert abs(np.corrcoef(drawn[:, 0], drawn[:, 1])[0, 1]) < 0.5
    for other in set(INSIDE) - {name}:
        assert not relative(rig, ALONE[name], 0)[other].any()


@pytest.mark.parametrize("name", ["gain", "damping", "inertia", "stiffness"])
def test_a_difference_is_drawn_alike_alone_and_with_the_others(rig, name):
    alone = relative(rig, ALONE[name], 3)[name]
    both = relative(rig, replace(ALL, hysteresis=0.0), 3)[name]
    np.testing.assert_array_equal(alone, both)


def test_drifts_lie_in_their_ranges_and_in_all_directions(rig):
    drawn = [rig.drawn(ALL, seed).machine.differs for seed in range(60)]
    zero = 1e6 * np.array([each.drift_rad_per_s for each in drawn])
    assert np.hypot(*zero.T).max() <= ALL.drift_urad_per_s
    assert kstest(np.arctan2(zero[:, 1], zero[:, 0]), "uniform", (-np.pi, 2 * np.pi)).pvalue > 1e-3
    gains = np.array([each.gain_drift_per_s for each in drawn]) / ALL.gain_drift_per_s
    assert kstest(gains.ravel(), "uniform", (-1, 2)).pvalue > 1e-3
    slips = np.array([each.hysteresis.slip for each in drawn])
    assert (slips >= SLIP_M[0]).all()
    assert (slips <= SLIP_M[1]).all()


STATIC = replace(ALL, floor_um_per_s=0.0, hysteresis=0.0, drift_urad_per_s=0.0, timestep_s=6.25e-5)
"""In fine steps, so that the integrator's error does not hide the others."""


@pytest.mark.parametrize("seed", [0, 1])
def test_the_drawn_plant_moves_as_its_own_linear_model_a_tick_late(rig, seed):
    """Gains, springs, dampers, weights and delay together, sampled behind the converters' hold."""
    drawn = rig.drawn(replace(STATIC, gain_drift_per_s=0.0), seed)
    rng = np.random.default_rng(seed)
    commands = 1e-5 * np.repeat(rng.normal(size=(10, 6)), 30, axis=0)
    bench, _ = flown(drawn, commands)
    linear = linearize(drawn.machine.model, Plant(drawn.machine.model).data)

    def predicted(B: np.ndarray, late: int) -> np.ndarray:
        sampled = control.c2d(control.ss(linear.A, B, linear.C_active, 0), PERIOD_S)
        late_commands = np.vstack([np.zeros((late, 6)), commands[: len(commands) - late]])
        ticks = np.arange(len(commands)) * PERIOD_S
        return np.asarray(control.forced_response(sampled, ticks, late_commands.T).outputs).T

    # Beyond the quantization, what is left is the integrator's error, below 1 % of the modes.
    scale = np.abs(bench.displacement).max()
    error = np.abs(bench.displacement - predicted(linear.B, 1)).max()
    assert error < 0.01 * scale
    # It can fail: at once instead of a tick late, and with all gains alike.
    assert np.abs(bench.displacement - predicted(linear.B, 0)).max() > 5 * error
    alike = linear.B / (1 + relative(rig, STATIC, seed)["gain"])
    assert np.abs(bench.displacement - predicted(alike, 1)).max() > 2 * error


def test_a_coarser_physics_step_is_further_from_the_linear_model(rig):
    """Semi-implicit Euler's error is of first order: twice the step, twice the error."""
    commands = 1e-5 * np.ones((80, 6)) * np.array([1, -1, 1, -1, 1, -1])
    linear = linearize(rig.model, Plant(rig.model).data)
    sampled = control.c2d(control.ss(linear.A, linear.B, linear.C_active, 0), PERIOD_S)
    ticks = np.arange(len(commands)) * PERIOD_S
    expected = np.asarray(control.forced_response(sampled, ticks, commands.T).outputs).T
    errors = [
        np.abs(flown(one, commands)[0].displacement - expected).max()
        for one in (rig, rig.drawn(ALONE["timestep_s"], 0))
    ]
    assert errors[1] == pytest.approx(2 * errors[0], rel=0.2)


def test_the_payload_rests_at_its_nominal_pose_whatever_springs_and_weights(rig):
    for seed in range(3):
        model = rig.drawn(ALL, seed).machine.model
        plant = Plant(model)
        plant.settle(1.0)
        assert np.abs(plant.displacement()).max() < 1e-8  # the closures give by as much
        # It can fail: the preload of the file leaves micrometres.
        model.qpos_spring[:] = rig.model.qpos_spring
        sagged = Plant(model)
        sagged.settle(1.0)
        assert np.abs(sagged.displacement()).max() > 1e-6


def test_the_drift_of_the_detectors_zero_is_read_and_nothing_else(rig):
    drawn, commands = rig.drawn(ALONE["drift_urad_per_s"].scaled(100), 1), np.zeros((50, 6))
    (_, plain), (_, adrift) = flown(rig, commands), flown(drawn, commands)
    ramp = np.outer(np.arange(50) * PERIOD_S, drawn.machine.differs.drift_rad_per_s)
    np.testing.assert_allclose(adrift - plain, ramp, atol=1e-18)


def test_a_gain_that_drifts_grows_with_time_from_the_start(rig):
    """What is reached by constant commands, once the modes have died away."""
    drawn, commands = rig.drawn(ALONE["gain_drift_per_s"].scaled(100), 1), np.full((1000, 6), 1e-4)
    (plain, _), (adrift, _) = flown(rig, commands), flown(drawn, commands)
    change = (adrift.displacement / plain.displacement)[500:] - 1
    time_s = np.arange(500, 1000) * PERIOD_S
    expected = np.outer(time_s, drawn.machine.differs.gain_drift_per_s)
    np.testing.assert_allclose(change, expected, atol=0.02 * np.abs(expected).max())


def test_the_floor_moves_the_payload_as_its_linear_model_says(rig):
    """Without control: pointing is that of B_floor under this very floor."""
    drawn = rig.drawn(ALONE["floor_um_per_s"], 2)
    bench, _ = flown(drawn, np.zeros((1000, 6)))
    linear = linearize(rig.model, Plant(rig.model).data)
    pointing = control.ss(linear.A, linear.B_floor, linear.C_twist[MAJOR], 0)
    floor = drawn.machine.floor(1000)
    ticks = np.arange(1000) * PERIOD_S
    response = control.forced_response(control.c2d(pointing, PERIOD_S), ticks, floor.T)
    expected = np.asarray(response.outputs).T
    error = pointing_angles(bench.rotation) - expected
    assert np.abs(expected).max() > 3e-7
    assert np.sqrt((error**2).mean()) < 0.04 * np.sqrt((expected**2).mean())


def test_hysteresis_leaves_the_stiffness_of_small_motion_as_it_was(rig):
    machine, joints = rig.drawn(ALONE["hysteresis"], 1).machine, rig.model.actuator_trnid[:, 0]
    slipping = machine.differs.hysteresis.stiffness.sum(axis=1)
    whole = machine.model.jnt_stiffness[joints] + slipping
    np.testing.assert_allclose(whole, rig.model.jnt_stiffness[joints], rtol=1e-14)
    np.testing.assert_allclose(slipping / whole, ALL.hysteresis, rtol=1e-12)


def test_hysteresis_reads_as_its_chain_along_the_whole_loop(rig):
    """Displacement under a slow triangle of commands: forces of coil, spring and chain balance."""
    drawn = hexapod_rig(nominal_testbed(FINE)).drawn(ALONE["hysteresis"].scaled(10), 1)
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


def test_scaling_takes_all_sizes_along():
    third = ALL.scaled(1 / 3)
    for name in set(LIMITS) - {"delay_ticks"}:
        assert getattr(third, name) == pytest.approx(getattr(ALL, name) / 3)
    assert third.delay_ticks == 0
    assert ALL.scaled(0) == EXACT
    assert ALL.scaled(1) == ALL
    assert Mismatch(delay_ticks=2).scaled(1.4).delay_ticks == 3
    with pytest.raises(ValueError, match=r"damping must be a number from 0 to 0\.99"):
        ALL.scaled(10)
    with pytest.raises(ValueError, match="factor must be a number"):
        ALL.scaled(-1)


@pytest.mark.parametrize("name", [*LIMITS, "timestep_s"])
@pytest.mark.parametrize("bad", [-1, np.nan, "much", 1e9])
def test_a_size_that_is_none_is_refused_by_name(name, bad):
    with pytest.raises(ValueError, match=name):
        Mismatch(**{name: bad})


def test_a_machine_without_suspensions_is_refused():
    stiff = load_model()
    stiff.jnt_stiffness[stiff.actuator_trnid[2, 0]] = 0.0
    with pytest.raises(ValueError, match="suspension springs"):
        differing(stiff, ALL, 0)


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
