"""Plants drawn off the model: each difference does what it says, and none is the model itself."""

from dataclasses import fields, replace

import control
import numpy as np
import pytest
from experiments.rig.hexapod.bench import simulated
from experiments.rig.hexapod.floor import floor_acceleration
from experiments.rig.hexapod.inexact import InexactPlant
from experiments.rig.hexapod.prediction import predicted_error_rad
from experiments.rig.hexapod.simulation import SpiralRun, track_spiral
from scipy.stats import kstest

from experiments.rig.hexapod.columns import COLUMNS, MAJOR
from experiments.rig.hexapod.controller import nominal_loops
from experiments.rig.hexapod.mismatch import ALL, ALONE, SLIP_M, mismatched
from experiments.rig.hexapod.testbed import Testbed, TestbedConfig
from experiments.rig.mismatch import EXACT, LIMITS, Mismatch
from sim import Failure, MaxwellSlip, Plant, linearize, load_model, pointing_angles

W_A, PERIOD_S = COLUMNS[0].goal, 1e-3
QUIET = TestbedConfig(detector_noise_m=0.0, dac_bits=32)
INSIDE = ("gain", "stiffness", "damping", "inertia")
"""Sizes of what is drawn into the model."""


@pytest.fixture(scope="module")
def testbed(model) -> Testbed:
    bench = TestbedConfig()
    return Testbed(model, bench, nominal_loops(model, bench))


def flown(testbed: Testbed, commands: np.ndarray, seed: int = 0, failures=()):
    """The bench after displacements (N, 6) were commanded, and what the detector read."""
    time_s = np.arange(len(commands)) * PERIOD_S
    bench = simulated(testbed, time_s, failures, seed)
    inputs, seen = testbed.amplifier().inputs(commands), []
    for each in inputs:
        seen.append(bench.measure().output)
        bench.apply(each)
    return bench, np.array(seen)


def test_a_plant_without_mismatch_is_the_model_to_the_last_bit(testbed):
    run = SpiralRun(
        W_A,
        failures=(Failure(2, "weak", 0.1), Failure(0, "locked", 0.15)),
        start_m=np.full(6, 1e-6),
        lead_in_s=0.05,
        duration_s=0.3,
        floor_m_per_s2=floor_acceleration(300, PERIOD_S, 1e-5, [7]),
    )
    plain, exact = track_spiral(testbed, run), track_spiral(mismatched(testbed, EXACT, 5), run)
    for each in fields(plain):
        np.testing.assert_array_equal(getattr(plain, each.name), getattr(exact, each.name))


@pytest.mark.parametrize("name", ALONE)
def test_every_mismatch_alone_changes_the_run(testbed, name):
    run = SpiralRun(W_A, duration_s=0.2, jacobian="constant")
    plain, other = (
        track_spiral(testbed, run),
        track_spiral(mismatched(testbed, ALONE[name], 5), run),
    )
    assert not np.array_equal(plain.measured_rad, other.measured_rad)
    again = track_spiral(mismatched(testbed, ALONE[name], 5), run)
    np.testing.assert_array_equal(again.measured_rad, other.measured_rad)


def relative(testbed: Testbed, mismatch: Mismatch, seed: int) -> dict[str, np.ndarray]:
    """Relative differences of a drawn plant from the model, by what is drawn."""
    drawn, known = mismatched(testbed, mismatch, seed).machine.model, testbed.model
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
def test_what_is_drawn_fills_its_range_and_stays_inside(testbed, name):
    size = getattr(ALL, name)
    drawn = np.array([relative(testbed, ALONE[name], seed)[name] for seed in range(40)])
    assert np.abs(drawn).max() <= size * (1 + 1e-12)
    assert kstest(drawn.ravel() / size, "uniform", (-1, 2)).pvalue > 1e-3
    assert abs(np.corrcoef(drawn[:, 0], drawn[:, 1])[0, 1]) < 0.5
    for other in set(INSIDE) - {name}:
        assert not relative(testbed, ALONE[name], 0)[other].any()


@pytest.mark.parametrize("name", ["gain", "damping", "inertia", "stiffness"])
def test_a_difference_is_drawn_alike_alone_and_with_the_others(testbed, name):
    alone = relative(testbed, ALONE[name], 3)[name]
    both = relative(testbed, replace(ALL, hysteresis=0.0), 3)[name]
    np.testing.assert_array_equal(alone, both)


def test_drifts_lie_in_their_ranges_and_in_all_directions(testbed):
    drawn = [mismatched(testbed, ALL, seed).machine for seed in range(60)]
    zero = 1e6 * np.array([each.drift_rad_per_s for each in drawn])
    assert np.hypot(*zero.T).max() <= ALL.drift_urad_per_s
    assert kstest(np.arctan2(zero[:, 1], zero[:, 0]), "uniform", (-np.pi, 2 * np.pi)).pvalue > 1e-3
    gains = np.array([each.gain_drift_per_s for each in drawn]) / ALL.gain_drift_per_s
    assert kstest(gains.ravel(), "uniform", (-1, 2)).pvalue > 1e-3
    slips = np.array([chain_of(each).slip for each in drawn])
    assert (slips >= SLIP_M[0]).all()
    assert (slips <= SLIP_M[1]).all()


def chain_of(machine: InexactPlant) -> MaxwellSlip:
    assert machine.hysteresis is not None
    return machine.hysteresis


def floor_of(machine: InexactPlant, ticks: int) -> np.ndarray:
    floor = machine.floor(ticks, PERIOD_S)
    assert floor is not None
    return floor


STATIC = replace(ALL, floor_um_per_s=0.0, hysteresis=0.0, drift_urad_per_s=0.0, timestep_s=6.25e-5)
"""In fine steps, so that the integrator's error does not hide the others."""


@pytest.mark.parametrize("seed", [0, 1])
def test_the_drawn_plant_moves_as_its_own_linear_model_a_tick_late(testbed, seed):
    """Gains, springs, dampers, weights and delay together, sampled behind the converters' hold."""
    machine = mismatched(testbed, replace(STATIC, gain_drift_per_s=0.0), seed)
    rng = np.random.default_rng(seed)
    commands = 1e-5 * np.repeat(rng.normal(size=(10, 6)), 30, axis=0)
    bench, _ = flown(machine, commands)
    model = machine.machine.model
    linear = linearize(model, Plant(model).data)

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
    alike = linear.B / (1 + relative(testbed, STATIC, seed)["gain"])
    assert np.abs(bench.displacement - predicted(alike, 1)).max() > 2 * error


def test_a_coarser_physics_step_is_further_from_the_linear_model(testbed):
    """Semi-implicit Euler's error is of first order: twice the step, twice the error."""
    commands = 1e-5 * np.ones((80, 6)) * np.array([1, -1, 1, -1, 1, -1])
    linear = linearize(testbed.model, Plant(testbed.model).data)
    sampled = control.c2d(control.ss(linear.A, linear.B, linear.C_active, 0), PERIOD_S)
    ticks = np.arange(len(commands)) * PERIOD_S
    expected = np.asarray(control.forced_response(sampled, ticks, commands.T).outputs).T
    errors = [
        np.abs(flown(machine, commands)[0].displacement - expected).max()
        for machine in (testbed, mismatched(testbed, ALONE["timestep_s"], 0))
    ]
    assert errors[1] == pytest.approx(2 * errors[0], rel=0.2)


def test_the_payload_rests_at_its_nominal_pose_whatever_springs_and_weights(testbed):
    for seed in range(3):
        model = mismatched(testbed, ALL, seed).machine.model
        plant = Plant(model)
        plant.settle(1.0)
        assert np.abs(plant.displacement()).max() < 1e-8  # the closures give by as much
        # It can fail: the preload of the file leaves micrometres.
        model.qpos_spring[:] = testbed.model.qpos_spring
        sagged = Plant(model)
        sagged.settle(1.0)
        assert np.abs(sagged.displacement()).max() > 1e-6


def test_the_drift_of_the_detectors_zero_is_read_and_nothing_else(testbed):
    machine = mismatched(testbed, ALONE["drift_urad_per_s"].scaled(100), 1)
    commands = np.zeros((50, 6))
    (_, plain), (_, adrift) = flown(testbed, commands), flown(machine, commands)
    ramp = np.outer(np.arange(50) * PERIOD_S, machine.machine.drift_rad_per_s)
    np.testing.assert_allclose(adrift - plain, ramp, atol=1e-18)


def test_a_gain_that_drifts_grows_with_time_from_the_start(testbed):
    machine = mismatched(testbed, ALONE["gain_drift_per_s"], 1).machine
    amplifier = testbed.amplifier().displacements
    drives = machine.drives(testbed.model, amplifier, PERIOD_S)
    inputs = np.linspace(1, 6, 6)
    reached = np.array([drives(inputs) for _ in range(1001)]) / amplifier(inputs) - 1
    assert not reached[0].any()
    np.testing.assert_allclose(reached[1000], machine.gain_drift_per_s, rtol=1e-9)
    np.testing.assert_allclose(reached[500], 0.5 * reached[1000], rtol=1e-9)


def test_the_floor_moves_the_payload_as_its_linear_model_says(testbed):
    """Without control: pointing is that of B_floor under this very floor."""
    machine = mismatched(testbed, ALONE["floor_um_per_s"], 2)
    bench, _ = flown(machine, np.zeros((1000, 6)))
    linear = linearize(testbed.model, Plant(testbed.model).data)
    pointing = control.ss(linear.A, linear.B_floor, linear.C_twist[MAJOR], 0)
    floor = floor_of(machine.machine, 1000)
    ticks = np.arange(1000) * PERIOD_S
    response = control.forced_response(control.c2d(pointing, PERIOD_S), ticks, floor.T)
    expected = np.asarray(response.outputs).T
    error = pointing_angles(bench.rotation) - expected
    assert np.abs(expected).max() > 3e-7
    assert np.sqrt((error**2).mean()) < 0.04 * np.sqrt((expected**2).mean())


def test_hysteresis_leaves_the_stiffness_of_small_motion_as_it_was(testbed):
    machine = mismatched(testbed, ALONE["hysteresis"], 1).machine
    joints = testbed.model.actuator_trnid[:, 0]
    slipping = chain_of(machine).stiffness.sum(axis=1)
    whole = machine.model.jnt_stiffness[joints] + slipping
    np.testing.assert_allclose(whole, testbed.model.jnt_stiffness[joints], rtol=1e-14)
    np.testing.assert_allclose(slipping / whole, ALL.hysteresis, rtol=1e-12)


def test_hysteresis_reads_as_its_chain_along_the_whole_loop(testbed):
    """Displacement under a slow triangle of commands: forces of coil, spring and chain balance."""
    size = ALONE["hysteresis"].scaled(10)
    machine = mismatched(replace(testbed, bench=QUIET), size, 1)
    up = np.linspace(0, 3e-5, 400)
    commands = np.concatenate([up, up[::-1], -up, -up[::-1]])[:, None] * np.ones(6)
    bench, _ = flown(machine, commands)
    slip, stretch, chain = chain_of(machine.machine), np.zeros((6, 4)), []
    for by in np.diff(bench.displacement, axis=0, prepend=bench.displacement[:1]):
        stretch = slip.moved(stretch, by)
        chain.append(slip.force(stretch))
    k = testbed.model.jnt_stiffness[testbed.model.actuator_trnid[:, 0]]
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


def test_a_machine_without_suspensions_is_refused(testbed):
    stiff = load_model()
    stiff.jnt_stiffness[stiff.actuator_trnid[2, 0]] = 0.0
    with pytest.raises(ValueError, match="suspension springs"):
        mismatched(replace(testbed, model=stiff), ALL, 0)


@pytest.mark.long
@pytest.mark.parametrize("seed", [0, 1])
def test_pointing_holds_on_a_plant_with_all_mismatches(testbed, seed):
    """Within 10 % of the sound linear model with the same noise on the same floor."""
    machine = mismatched(testbed, ALL, seed)
    run = SpiralRun(W_A, seed=seed, duration_s=8.0, jacobian="constant")
    got = track_spiral(machine, run)
    ticks = len(got.time_s)
    error = got.desired_rad - got.true_rad - machine.machine.zero_rad(ticks, PERIOD_S)
    floor = floor_of(machine.machine, ticks)
    expected = predicted_error_rad(testbed, replace(run, floor_m_per_s2=floor))
    assert expected is not None
    rms = [np.sqrt((each**2).mean(axis=0)) for each in (error, expected)]
    np.testing.assert_allclose(rms[0], rms[1], rtol=0.1)
