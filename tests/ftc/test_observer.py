"""The believed model beside the plant: what it learns, how fast it forgets."""

from dataclasses import replace

import control
import numpy as np
import pytest

from ftc.fdi import CERTAIN, Fault, Uncertainty
from ftc.fdi.bank import hypothesis_bank
from ftc.fdi.diagnosis import FdiConfig
from ftc.fdi.observer import MEMORY_S, Observer, ObserverState
from tests.cart_runs import Record, carts, outputs

NOMINAL, PERIOD_S = carts(1), 10e-3


def watched(uncertainty: Uncertainty, y: np.ndarray, u: np.ndarray) -> ObserverState:
    """After N samples of outputs (N, p) under commands (N, n), white noise from the start."""
    bank = hypothesis_bank(NOMINAL, (), uncertainty, 2)
    watch = Observer(bank.believed, FdiConfig(uncertainty=uncertainty), PERIOD_S)
    state, before = watch.start(), np.zeros(2)
    for measured, command in zip(y, u, strict=True):
        state, _ = watch.step(state, np.concatenate([command, before, [1.0]]), measured)
        before = command
    return state


def test_what_drifts_stays_uncertain_as_by_the_riccati_equation():
    """A random walk of variance q a sample in unit noise: P = (q + sqrt(q^2 + 4 q)) / 2."""
    drifting = replace(CERTAIN, offset=3.0, offset_rate=0.8)
    q = 0.8**2 * PERIOD_S
    state = watched(drifting, np.zeros((600, 2)), np.zeros((600, 2)))
    expected = (q + np.sqrt(q**2 + 4 * q)) / 2
    np.testing.assert_allclose(state.parameters.covariance, expected * np.eye(2), rtol=1e-6)


def test_the_spectrum_is_remembered_for_the_time_stated():
    """Of what was before a silence, e^-1 is left after so long."""
    N = round(MEMORY_S / PERIOD_S)
    y = np.vstack([np.random.default_rng(0).standard_normal((N, 2)), np.zeros((N, 2))])
    u = np.zeros((2 * N, 2))
    loud, quiet = (watched(CERTAIN, y[:n], u[:n]) for n in (N, 2 * N))
    left = quiet.spectrum.covariance[0] / loud.spectrum.covariance[0]
    np.testing.assert_allclose(left, (1 - 1 / N) ** N, rtol=1e-6)


@pytest.mark.parametrize("seed", range(3))
def test_what_the_motion_shows_is_learned(seed):
    """A gain of 5 % more, by commands that move both carts, within what is left uncertain."""
    gains = replace(CERTAIN, gain=0.05)
    sound = NOMINAL.plant
    stronger = control.ss(sound.A, sound.B * [1.05, 1.0], sound.C, sound.D)
    plant = replace(NOMINAL, plant=stronger)
    record = Record.of(plant, 2, seed, samples=300, size=5e-2)
    state = watched(gains, record.y, record.u)
    mean, covariance = state.parameters.mean[:2], state.parameters.covariance[:2, :2]
    assert np.diag(covariance).max() < 0.01
    off = mean - [1.0, 0.0]
    assert off @ np.linalg.solve(covariance, off) < 20


def test_at_rest_no_gain_is_learned():
    gains = replace(CERTAIN, gain=0.05)
    state = watched(gains, np.ones((100, 2)), np.zeros((100, 2)))
    np.testing.assert_allclose(state.parameters.covariance[:2, :2], np.eye(2))
    np.testing.assert_array_equal(state.parameters.mean[:2], 0.0)


GAINS = replace(CERTAIN, gain=0.02)


def strongest(left: np.ndarray, u: np.ndarray, believed: float = 0.5) -> list[float]:
    """The most that cart 0, believed weak, may have of its force, while it has `left` (N,)."""
    faults = (Fault(0, "weak", believed),)
    bank = hypothesis_bank(NOMINAL, faults, GAINS, 2)
    watch = Observer(bank.believed, FdiConfig(uncertainty=GAINS), PERIOD_S, weak=faults)
    state, before, seen = watch.start(), np.zeros(2), []
    y = outputs(NOMINAL, 2, u * np.column_stack([left, np.ones(len(u))]))
    y += np.random.default_rng(0).standard_normal(y.shape)
    for measured, command in zip(y, u, strict=True):
        state, _ = watch.step(state, np.concatenate([command, before, [1.0]]), measured)
        before = command
        [(actuator, most)] = watch.strongest(state)
        assert actuator == 0
        seen.append(most)
    [(_, doubted)] = watch.strongest(watch.doubting(state))
    assert doubted >= 1.0  # at an alarm it may be sound, whatever was believed
    return seen


def test_without_motion_a_weak_actuator_may_be_sound_two_seconds_later():
    """From half of its force: evidence that is older counts for nothing."""
    seen = strongest(np.full(260, 0.5), np.zeros((260, 2)))
    assert np.diff(seen).min() > 0
    assert seen[50] < 0.9 and 1.0 <= seen[200] < 1.1


@pytest.mark.parametrize("seed", range(3))
def test_what_a_weak_actuator_has_left_is_followed_and_no_sound_one_is_driven_harder(seed):
    """While it fails further, stays, comes back and becomes twice as strong as ever.

    Commanded by the inverse of the most that it may have, or as a sound one, it does at most a
    tenth more than a sound one.
    """
    rng = np.random.default_rng(seed)
    u = np.cumsum(3e-2 * rng.standard_normal((700, 2)), axis=0)
    left = np.interp(np.arange(700), [0, 100, 200, 500, 600, 700], [0.5, 0.5, 0.4, 1, 1, 2])
    seen = np.array(strongest(left, u))[50:]
    does = left[50:] / np.minimum(seen, 1.0)
    assert (does / np.maximum(1.0, left[50:])).max() < 1.1
    assert (seen - left[50:]).max() < 0.25
