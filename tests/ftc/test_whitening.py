"""Spectra of residuals, and the filters that whiten them."""

import numpy as np
import pytest
import scipy.linalg
import scipy.signal

from ftc.fdi.observer import Spectrum
from tests.spectra import spectrum_of

ORDER = 6


def coloured(seed: int, samples: int, outputs: int = 2) -> tuple[np.ndarray, np.ndarray]:
    """Gaussian processes (N, p) of random poles, and deviations (p,) of what drives them."""
    rng = np.random.default_rng(seed)
    deviation, found = 10.0 ** rng.uniform(-2, 2, outputs), []
    for each in deviation:
        radius, angle = rng.uniform(0.3, 0.95, 2), rng.uniform(0, np.pi, 2)
        poles = radius * np.exp(1j * angle)
        a = np.poly([*poles, *poles.conj()]).real
        white = each * rng.standard_normal(samples + 500)
        found.append(scipy.signal.lfilter([1.0], a, white)[500:])
    return np.column_stack(found), deviation


def measured(residuals: np.ndarray, memory: float = np.inf) -> Spectrum:
    return spectrum_of(residuals, ORDER, memory)


def filtered(weights: np.ndarray, residuals: np.ndarray) -> np.ndarray:
    parts = [np.convolve(r, w, "valid") for r, w in zip(residuals.T, weights.T, strict=True)]
    return np.column_stack(parts)


@pytest.mark.parametrize("seed", range(6))
def test_a_process_becomes_white_noise_of_unit_variance(seed):
    """Another record of it: no product with any earlier sample is left."""
    process, _ = coloured(seed, 8000)
    weights = measured(process[:4000]).filter()
    white = filtered(weights, process[4000:])
    np.testing.assert_allclose(white.var(axis=0), 1.0, atol=0.1)
    for lag in range(1, 2 * ORDER):
        products = (white[lag:] * white[:-lag]).mean(axis=0)
        assert np.abs(products).max() < 5 / np.sqrt(len(white))


@pytest.mark.parametrize("seed", range(6))
def test_the_filter_is_the_process_s_own(seed):
    """Its weights are the autoregression over the deviation of what drives it."""
    process, deviation = coloured(seed, 20_000)
    weights = measured(process).filter()
    np.testing.assert_allclose(1 / weights[0], deviation, rtol=0.05)
    left = filtered(weights * deviation, process)
    driven = np.linalg.norm(left, axis=0) / np.sqrt(len(left))
    np.testing.assert_allclose(driven, deviation, rtol=0.05)


def test_white_noise_is_left_alone():
    """But for what 20 000 samples leave uncertain, 1 / sqrt(N)."""
    noise = np.random.default_rng(0).standard_normal((20_000, 3))
    weights = measured(noise).filter()
    np.testing.assert_allclose(weights[0], 1.0, atol=0.03)
    np.testing.assert_allclose(weights[1:], 0.0, atol=0.04)


def test_a_disturbance_twice_as_large_is_weighed_half():
    process, _ = coloured(1, 2000)
    one, two = measured(process).filter(), measured(2 * process).filter()
    np.testing.assert_allclose(2 * two, one, rtol=1e-9, atol=1e-9)


def test_all_samples_count_alike_until_the_memory_is_full_and_later_ones_more_from_then_on():
    """A mean of products of up to M samples; after them, exponential forgetting at 1 / M."""
    process, _ = coloured(2, 400)
    plain = measured(process)
    by_hand = [
        (process[lag:] * process[: len(process) - lag]).sum(axis=0) / len(process)
        for lag in range(ORDER + 1)
    ]
    np.testing.assert_allclose(plain.covariance, by_hand, rtol=1e-9)
    assert plain.samples == len(process)
    loud = np.vstack([process[:100], 0 * process])
    assert (measured(loud, memory=100).covariance[0] < 0.03 * plain.covariance[0]).any()
    ratio = measured(loud, 100).covariance[0] / measured(loud[:100], 100).covariance[0]
    np.testing.assert_allclose(ratio, 0.99 ** (len(loud) - 100), rtol=1e-9)


@pytest.mark.parametrize("turn", [0.0, 0.3, np.pi])
def test_what_can_be_predicted_without_error_is_weighed_at_most_a_hundredfold(turn):
    """A constant, and sinusoids: their autocovariances are singular."""
    lags = np.cos(turn * np.arange(ORDER + 1))[:, None]
    weights = Spectrum(0 * lags, lags, 1000).filter()
    assert np.isfinite(weights).all()
    assert 20 < weights[0, 0] < 101


def test_what_was_fitted_to_few_residuals_is_as_large_as_new_ones_are():
    """Fitted to 100 samples of white noise, the filter leaves unit variance in the next ones."""
    rng, order, squares = np.random.default_rng(1), 10, []
    for _ in range(60):
        spectrum = spectrum_of(rng.standard_normal((100, 1)), order)
        new = rng.standard_normal(200)
        left = np.convolve(new, spectrum.filter()[:, 0], mode="valid")
        squares.append((left**2).mean())
    assert np.mean(squares) == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize("slow", [0.02, 0.05, 0.2])
def test_slow_inputs_are_noise_to_a_filter_that_is_decoupled_from_them(slow):
    """Fifty times the noise, by a critically damped filter of second order: of unit variance."""
    noise = Spectrum(np.zeros((ORDER + 1, 1)), np.eye(ORDER + 1, 1), 10**6)
    lags = slow * np.arange(ORDER + 1)
    inputs = scipy.linalg.toeplitz(2500 * (1 + lags) * np.exp(-lags)) + np.eye(ORDER + 1)
    plain, decoupled = noise.filter()[:, 0], noise.filter(slow=slow)[:, 0]
    assert plain @ inputs @ plain > 1000
    assert 0.6 < decoupled @ inputs @ decoupled < 1.001
    # What is faster is still seen: at 30 times the corner, by half of its power and more.
    fast = np.exp(1j * min(30 * slow, np.pi) * np.arange(ORDER + 1))
    assert abs(fast @ decoupled) > 0.5 * abs(fast @ plain)


def test_without_slow_inputs_the_decoupled_filter_would_leave_less_than_noise():
    """It has a smaller gain: the same noise is less of it, and the likelihood pays for that."""
    spectrum = measured(np.random.default_rng(0).standard_normal((5000, 2)))
    plain, decoupled = spectrum.filter(), spectrum.filter(slow=0.05)
    assert (decoupled[0] < plain[0]).all()
    assert ((decoupled**2).sum(axis=0) < (plain**2).sum(axis=0)).all()
