"""When the residuals are more than noise: rates of false alarms, and what is seen how soon."""

import numpy as np
import pytest
from scipy.stats import binom

from ftc.fdi.observer import ResidualTest

PERIOD_S = 4e-3
DITHER_HZ = 20.0
dithers = pytest.mark.parametrize("dither_hz", [None, DITHER_HZ])
WINDOWS = ResidualTest(1, 0.01, PERIOD_S).windows
LONGEST = WINDOWS[-1]


def alarms(watch, residuals: np.ndarray) -> np.ndarray:
    """Windows (N,) in which each sample raised an alarm, 0 for none."""
    recent, found = watch.start(), []
    for residual in residuals:
        recent = np.vstack([recent[1:], residual])
        found.append(watch.alarm(recent))
    return np.array(found)


@dithers
@pytest.mark.parametrize("outputs", [2, 8])
def test_the_rate_of_false_alarms_is_kept_and_not_by_far(outputs, dither_hz):
    """Samples of white noise that are in alarm: at most as many as stated, and not below a third.

    The latest samples of independent records, so that the count is binomial.
    """
    per_hour = 0.02 * 3600 / PERIOD_S
    watch = ResidualTest(outputs, per_hour, PERIOD_S, dither_hz)
    rng = np.random.default_rng(outputs)
    records = 4000
    found = sum(watch.alarm(rng.standard_normal((LONGEST, outputs))) > 0 for _ in range(records))
    assert found <= binom.ppf(0.999, records, 0.02)
    assert found >= binom.ppf(0.001, records, 0.02 / 2)


@pytest.mark.parametrize("outputs", [1, 3])
@dithers
def test_each_mean_has_its_share_of_false_alarms(outputs, dither_hz):
    """A union bound shares the rate out evenly: by the quantile of simulated chi-squares."""
    rng = np.random.default_rng(0)
    share = 0.01
    tests = len(WINDOWS) + (0 if dither_hz is None else 5)
    watch = ResidualTest(outputs, tests * share * 3600 / PERIOD_S, PERIOD_S, dither_hz)
    squares = (rng.standard_normal((200_000, 2 * outputs)) ** 2).cumsum(axis=1)
    assert (squares[:, outputs - 1] > watch.threshold).mean() == pytest.approx(share, rel=0.1)
    both = (squares[:, -1] > watch.demodulated_threshold).mean()
    assert both == pytest.approx(share, rel=0.1)


@pytest.mark.parametrize(("shift", "longest"), [(20.0, 1), (3.0, 8), (0.6, 128)])
def test_a_small_shift_is_seen_over_a_long_window_and_a_large_one_at_once(shift, longest):
    """The mean of M samples of noise has the deviation 1 / sqrt(M)."""
    watch = ResidualTest(2, 0.01, PERIOD_S)
    found = alarms(watch, np.tile([shift, 0.0], (LONGEST, 1)))
    first = np.flatnonzero(found)[0]
    assert longest / 4 < found[first] <= longest and first < longest


def wave(hz: float, size: float, phase: float = 0.3) -> np.ndarray:
    times = PERIOD_S * np.arange(3 * LONGEST)
    return np.outer(np.sin(2 * np.pi * hz * times + phase), [size, -0.5 * size])


@pytest.mark.parametrize("phase", np.linspace(0, np.pi, 4))
def test_a_lock_in_sees_a_sinusoid_that_no_mean_sees(phase):
    """Of its own frequency, in any phase: a little larger than the noise."""
    swing = wave(DITHER_HZ, 1.2, phase)
    plain = ResidualTest(2, 0.01, PERIOD_S)
    locked_in = ResidualTest(2, 0.01, PERIOD_S, DITHER_HZ)
    assert not alarms(plain, swing).any()
    assert alarms(locked_in, swing)[-1] > 0


@pytest.mark.parametrize("hz", [10.0, 27.0, 31.0, 45.0, 70.0])
def test_a_lock_in_does_not_see_another_frequency(hz):
    """Farther off than the reciprocal of its window, 0.5 s: but for its side lobes."""
    assert not alarms(ResidualTest(2, 0.01, PERIOD_S, DITHER_HZ), wave(hz, 1.2)).any()


def test_the_lock_in_is_a_mean_square_projection():
    """A sinusoid of amplitude a has a demodulated energy of M a^2 / 2: the alarm comes there."""
    watch = ResidualTest(1, 0.01, PERIOD_S, DITHER_HZ)
    least = np.sqrt(2 * watch.demodulated_threshold / LONGEST)
    times = PERIOD_S * np.arange(LONGEST)
    swing = np.sin(2 * np.pi * DITHER_HZ * times)[:, None]
    assert watch.alarm(1.02 * least * swing) == LONGEST
    assert watch.alarm(0.95 * least * swing) == 0


@dithers
def test_old_residuals_are_forgotten(dither_hz):
    watch = ResidualTest(2, 0.01, PERIOD_S, dither_hz)
    found = alarms(watch, np.vstack([np.full((5, 2), 100.0), np.zeros((LONGEST, 2))]))
    assert (found > 0).tolist() == [True] * (LONGEST + 4) + [False]


@pytest.mark.parametrize("hz", [1.5, 5.0, 10.0, 20.0])
def test_cosine_and_sine_of_a_demodulated_mean_are_nearly_independent(hz):
    """Else their squares are large together, and the stated rate of false alarms is exceeded."""
    test = ResidualTest(2, 0.01, PERIOD_S, hz)
    assert test.swing is not None
    for M in test.windows:
        if test.demodulated <= M:
            swing = test.swing[:M]
            assert np.linalg.eigvalsh(swing.T @ swing * 2 / M)[-1] < 1.25
    shorter = test.swing[: test.demodulated // 2]
    assert np.linalg.eigvalsh(shorter.T @ shorter * 2 / len(shorter))[-1] > 1.25
