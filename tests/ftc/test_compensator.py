"""Loops of compensators: minimal realizations, frequency responses and stability margins."""

import control
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import block_diag

from ftc import LoopShape, compensator, margins
from ftc.control import NoResponse, sensitivity_peak
from ftc.control.compensator import minimal
from ftc.control.frequency_response import frequency_response
from tests.random_systems import orthogonal

PERIOD_S = 1e-3
FREQUENCY_RAD_S = np.geomspace(5.0, 3000.0, 200)


def masses(seed: int, k: int = 5, m: int = 2) -> control.StateSpace:
    """Return sampled coupled masses, one of them without a spring: a double pole at z = 1."""
    rng = np.random.default_rng(seed)
    shapes = np.linalg.qr(rng.normal(size=(k, k)))[0]
    stiffness = shapes @ np.diag([0.0, *rng.uniform(1e2, 1e5, k - 1)]) @ shapes.T
    A = np.block([[np.zeros((k, k)), np.eye(k)], [-stiffness, -1e-4 * stiffness]])
    B = np.vstack([np.zeros((k, m)), rng.normal(size=(k, m))])
    C = np.hstack([rng.normal(size=(m, k)), np.zeros((m, k))])
    return control.c2d(control.ss(A, B, C, 0), PERIOD_S, "zoh")


@pytest.mark.parametrize("seed", range(5))
def test_a_response_is_the_solution_of_its_linear_system_at_each_frequency(seed):
    """The loops have double poles, and compensator states that differ by ten decades."""
    low_pass = control.ss(control.tf([1e5], [1, 4e2, 1e5, 0]))
    channel = control.c2d(low_pass, PERIOD_S, "tustin")
    L = masses(seed) * control.append(channel, channel)
    z = np.exp(1j * FREQUENCY_RAD_S * PERIOD_S)
    solved = np.array(
        [L.C @ np.linalg.solve(each * np.eye(L.nstates) - L.A, L.B) + L.D for each in z]
    )
    result = frequency_response(L)(FREQUENCY_RAD_S)
    size = 1 + np.linalg.norm(solved, axis=(1, 2))  # margins and peaks are those of I + L
    assert (np.linalg.norm(result - solved, axis=(1, 2)) < 1e-11 * size).all()


def test_margins_and_peak_are_those_of_python_control_on_a_fine_grid():
    plant = control.ss(control.tf([400.0], [1, 8.0, 400.0]))
    L = control.c2d(plant, PERIOD_S, "zoh") * control.c2d(
        control.ss(control.tf([6.0], [1, 0])), PERIOD_S, "tustin"
    )
    fine = 2 * np.pi * np.geomspace(0.1, 400.0, 4000)
    gain, phase, _, at_phase, at_gain, _ = control.stability_margins(
        control.frequency_response(L, fine)
    )
    result = margins(L)
    assert result.gain_margin_db == pytest.approx(20 * np.log10(gain), rel=1e-6)
    assert result.phase_margin_deg == pytest.approx(phase, rel=1e-6)
    assert result.phase_crossover_hz == pytest.approx(at_phase / (2 * np.pi), rel=1e-6)
    assert result.crossover_hz == pytest.approx(at_gain / (2 * np.pi), rel=1e-6)
    nearest = np.abs(1 + control.frequency_response(L, fine).complex).min()
    assert sensitivity_peak(L) == pytest.approx(1 / nearest, rel=1e-3)  # between two frequencies
    margin = 10 ** (result.gain_margin_db / 20)
    for factor, stable in ((0.98 * margin, True), (1.02 * margin, False)):
        assert (np.abs(control.feedback(factor * L, 1).poles()).max() < 1) == stable


def test_a_loop_whose_gain_stays_below_one_has_infinite_margins():
    result = margins(control.ss([[0.9]], [[0.01]], [[1.0]], 0, PERIOD_S))
    assert np.isinf(result.phase_margin_deg) and np.isnan(result.crossover_hz)


@pytest.mark.parametrize("seed", range(6))
def test_a_response_that_is_real_to_round_off_has_its_gain_margin(seed):
    """Cancelling modes leave round-off of either sign, which differs in batches."""
    rng = np.random.default_rng(seed)
    turns = 0.9 * np.exp(1j * rng.uniform(0.01, 1.0, size=3))
    A = block_diag(*(np.array([[z.real, -z.imag], [z.imag, z.real]]) for z in turns))
    B, C, T = rng.normal(size=(6, 1)), rng.normal(size=(1, 6)), orthogonal(rng, 6)
    both = block_diag(A, T @ A @ T.T), np.vstack([B, T @ B]), np.hstack([C, -C @ T.T])
    result = margins(control.ss(*both, -0.3, PERIOD_S))
    assert result.gain_margin_db == pytest.approx(-20 * np.log10(0.3))


def test_a_slow_loop_has_the_margins_of_a_fast_one():
    """Time is scaled 20 times: crossovers and peaks of slow arms may lie below 0.1 Hz."""
    loops = []
    for slower in (1.0, 20.0):
        lag = control.tf([1.0], [slower**2, slower, 0.0])  # corner and integrator at 1 rad/s
        loops.append(control.c2d(control.ss(4 * lag), slower * PERIOD_S, "zoh"))
    fast, slow = (margins(loop) for loop in loops)
    assert slow.crossover_hz == pytest.approx(fast.crossover_hz / 20, rel=1e-9)
    assert slow.phase_margin_deg == pytest.approx(fast.phase_margin_deg, rel=1e-9)
    peaks = [sensitivity_peak(loop) for loop in loops]
    assert peaks[1] == pytest.approx(peaks[0], rel=1e-3)


def plant(seed: int, driven: int, hidden: int) -> control.StateSpace:
    """Return a plant of stable minimal and unobservable or uncontrollable modes, states mixed."""
    rng = np.random.default_rng(seed)
    n = driven + 2 * hidden
    A = np.zeros((n, n))
    A[:driven, :driven] = rng.uniform(-1, 1, (driven, driven)) - 3 * np.eye(driven)
    # Controllable but not observable modes, then observable but not controllable ones.
    A[driven : driven + hidden, :driven] = rng.uniform(-1, 1, (hidden, driven))
    A[:driven, driven + hidden :] = rng.uniform(-1, 1, (driven, hidden))
    B, C = np.zeros((n, 2)), np.zeros((2, n))
    B[:driven], C[:, :driven] = rng.uniform(-1, 1, (driven, 2)), rng.uniform(-1, 1, (2, driven))
    T = np.linalg.qr(rng.standard_normal((n, n)))[0] @ np.diag(rng.uniform(0.5, 2.0, n))
    T_inverse = np.linalg.inv(T)
    return control.ss(T @ A @ T_inverse, T @ B, C @ T_inverse, 0)


@given(st.integers(0, 999), st.integers(1, 5), st.integers(0, 3), st.sampled_from([1e-9, 1e9]))
def test_undamped_hidden_modes_are_removed(seed, driven, hidden, unit):
    """The response is unchanged and all remaining poles are stable, for any unit of the inputs."""
    whole = plant(seed, driven, hidden)
    part = minimal(whole)
    assert part.nstates <= driven
    assert part.poles().real.max(initial=-1.0) < 0
    assert hidden or part is whole
    for w in np.geomspace(0.1, 100.0, 15):
        np.testing.assert_allclose(part(1j * w), whole(1j * w), atol=1e-6)
    scaled = minimal(control.ss(whole.A, unit * whole.B, whole.C, 0))
    assert scaled.nstates == part.nstates
    np.testing.assert_allclose(scaled(1j), unit * part(1j), rtol=1e-6, atol=1e-9 * unit)


def test_an_unstable_controllable_and_observable_mode_stays():
    """An upright pendulum has to be stabilized by the loop."""
    upright = control.ss([[0, 1], [4, 0]], [[0], [1]], [[1, 0]], 0)
    np.testing.assert_allclose(sorted(minimal(upright).poles().real), [-2, 2], atol=1e-9)


def test_a_channel_that_does_not_respond_is_rejected():
    dead = control.ss([[0.0, 1.0], [-4.0, -1.0]], [[0.0], [0.0]], [[1.0, 0.0]], 0)
    with pytest.raises(NoResponse, match=r"plant must respond at 2 Hz, got gain 0"):
        compensator(dead, LoopShape(2.0, 8.0, 0.7), 1e-3)
