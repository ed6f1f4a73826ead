"""Errors of a model tracked while nothing has failed, against least squares in one go."""

from dataclasses import replace
from fractions import Fraction
from unittest.mock import patch

import numpy as np
import pytest

from ftc.fdi import CERTAIN, Uncertainty
from ftc.fdi.diagnosis import FdiConfig
from ftc.fdi.observer import Observer, ObserverState, Parameters, Spectrum
from ftc.fdi.uncertainty import UncertainModel

J, P = 4, 2
seeds = pytest.mark.parametrize("seed", range(5))
STEADY = replace(CERTAIN, offset=3.0)


def measurements(seed: int, samples: int, true: np.ndarray | None = None):
    """Regressors (N, J + p, p), whitened residuals (N, p), and parameters drawn from the prior."""
    rng = np.random.default_rng(seed)
    spread = np.concatenate([np.ones(J), np.full(P, STEADY.offset)])
    true = spread * rng.standard_normal(J + P) if true is None else true
    moving = rng.normal(size=(samples, J, P)) * 10.0 ** rng.uniform(-2, 0, (1, J, 1))
    regressors = np.concatenate([moving, np.broadcast_to(np.eye(P), (samples, P, P))], axis=1)
    white = np.einsum("r,nrp->np", true, regressors) + rng.standard_normal((samples, P))
    return regressors, white, true


def watching(errors: int, outputs: int, rates: Uncertainty) -> Observer:
    """An observer of a model without states, of which the test says what it predicts."""
    M, N = np.zeros((errors + 1, 0, 1)), np.zeros((errors + 1, outputs, 1))
    none = np.zeros((0, 0)), M, np.zeros((outputs, 0)), N, np.zeros((0, 0))
    model = UncertainModel(*none, 1, None, 0.0, errors + 1)
    return Observer(model, FdiConfig(uncertainty=rates), 0.01)


def updated(watch: Observer, parameters: Parameters, white, moving):
    """As the watch does it at a sample, without a spectrum; regressors of offsets are one."""
    errors, p = moving.shape
    predicted, memory = np.vstack([np.zeros(p), moving]), np.zeros((1, errors + 1, p))
    plain, spectrum = np.ones((1, p)), Spectrum(white[None], white[None], 0)
    before = ObserverState(0, moving, memory, parameters, spectrum, plain, plain, white, 1)
    with patch.object(UncertainModel, "step", lambda *_: (predicted, moving)):
        after, _ = watch.step(before, np.zeros(1), white)
    return after.parameters, after.residual


def tracked(regressors, white, rates: Uncertainty = STEADY) -> tuple[Parameters, np.ndarray]:
    watch, parameters, innovations = watching(J, P, rates), Parameters.prior(J, P, STEADY), []
    for H, e in zip(regressors, white, strict=True):
        parameters, innovation = updated(watch, parameters, e, H[:J])
        innovations.append(innovation)
    return parameters, np.array(innovations)


@seeds
def test_what_does_not_drift_is_estimated_as_by_the_normal_equations(seed):
    """Of all samples at once, each row weighted alike, the prior as further measurements."""
    regressors, white, _ = measurements(seed, 200)
    found, _ = tracked(regressors, white)
    H = regressors.transpose(0, 2, 1).reshape(-1, J + P)
    prior = np.diag(1 / np.array([1.0] * J + [STEADY.offset] * P) ** 2)
    information = prior + H.T @ H
    np.testing.assert_allclose(found.covariance, np.linalg.inv(information), rtol=1e-6, atol=1e-9)
    expected = np.linalg.solve(information, H.T @ white.ravel())
    np.testing.assert_allclose(found.mean, expected, rtol=1e-6, atol=1e-8)


def exactly(regressors, white) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance by the normal equations of all samples, in rational numbers."""
    H, e = regressors.transpose(0, 2, 1).reshape(-1, J + P), white.ravel()
    rows = [[Fraction(x) for x in row] for row in np.column_stack([H, e]).tolist()]
    sums = [
        [sum((row[i] * row[j] for row in rows), Fraction()) for j in range(J + P + 1)]
        for i in range(J + P)
    ]
    for i in range(J + P):
        sums[i][i] += 1 if i < J else 1 / Fraction(STEADY.offset**2)
        sums[i] += [Fraction(i == j) for j in range(J + P)]
    for i in range(J + P):  # information is positive definite: no pivot is zero
        sums[i] = [x / sums[i][i] for x in sums[i]]
        for k in range(J + P):
            if k != i:
                sums[k] = [x - sums[k][i] * y for x, y in zip(sums[k], sums[i], strict=True)]
    solved = np.array([row[J + P :] for row in sums], dtype=float)
    return solved[:, 0], solved[:, 1:]


@seeds
def test_regressors_a_trillion_times_the_noise_leave_a_covariance(seed):
    """A motion that shows one direction far better than the others, as least squares has it.

    A covariance that is updated by a difference is indefinite after three such samples.
    """
    regressors, white, true = measurements(seed, 8)
    rng = np.random.default_rng([seed, 2])
    size = 10.0 ** rng.uniform(0, 12, (8, 1, P))
    moving = rng.normal(size=(J, 1)) * size + regressors[:, :J]
    white += np.einsum("j,njp->np", true[:J], moving - regressors[:, :J])
    regressors[:, :J] = moving
    found, innovations = tracked(regressors, white, CERTAIN)
    mean, covariance = exactly(regressors, white)
    deviation = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(np.sqrt(np.diag(found.covariance)), deviation, rtol=1e-3)
    assert np.abs((found.mean - mean) / deviation).max() < 1e-2
    assert np.abs(innovations).max() < 6.0


def test_errors_lie_within_their_covariance():
    """The squared distance of the estimate from the truth is a chi-square variable, on average."""
    distances = []
    for seed in range(200):
        regressors, white, true = measurements(seed, 30)
        found, _ = tracked(regressors, white)
        wrong = found.mean - true
        distances.append(wrong @ np.linalg.solve(found.covariance, wrong))
    assert np.mean(distances) == pytest.approx(J + P, abs=4 * np.sqrt(2 * (J + P) / 200))


@pytest.mark.parametrize("drift", [STEADY, replace(STEADY, drift_rate=2.0, offset_rate=10.0)])
def test_innovations_are_white_of_unit_variance(drift):
    """Also of parameters that drift: the rate is a deviation after a second, of each."""
    every = []
    for seed in range(40):
        rng = np.random.default_rng([seed, 1])
        regressors, _, true = measurements(seed, 100)
        rate = np.repeat([drift.drift_rate, drift.offset_rate], [J, P])
        walk = true + np.cumsum(rate * 0.1 * rng.standard_normal((100, J + P)), axis=0)
        noise = rng.standard_normal((100, P))
        white = np.einsum("nr,nrp->np", walk, regressors) + noise
        every.append(tracked(regressors, white, drift)[1])
    found = np.array(every)
    np.testing.assert_allclose(found.var(axis=(0, 1)), 1.0, atol=5 * np.sqrt(2 / 4000))
    for lag in (1, 2, 5):
        products = (found[:, lag:] * found[:, :-lag]).mean(axis=(0, 1))
        assert np.abs(products).max() < 5 / np.sqrt(40 * (100 - lag))


@pytest.mark.parametrize("which", range(J + P))
def test_a_parameter_that_drifts_is_followed_and_one_that_is_told_not_to_is_not(which):
    """A ramp of three standard deviations in 20 s."""
    rng = np.random.default_rng(which)
    regressors, white, _ = measurements(which, 2000, np.zeros(J + P))
    regressors[:, :J] = rng.normal(size=(2000, J, P))
    ramp = 3 * np.linspace(0, 1, 2000)
    white = white + ramp[:, None] * regressors[:, which]
    follows, _ = tracked(regressors, white, replace(STEADY, drift_rate=0.3, offset_rate=0.3))
    stays, _ = tracked(regressors, white)
    assert follows.mean[which] == pytest.approx(3.0, abs=0.4)
    assert stays.mean[which] < 2.2


@seeds
def test_what_the_motion_does_not_show_keeps_its_prior(seed):
    """Its covariance stays that of the prior, and the share of the rest is unmoved by it."""
    regressors, white, _ = measurements(seed, 100)
    rng = np.random.default_rng(seed)
    hidden = np.linalg.qr(rng.normal(size=(J, J)))[0][:, 0]
    regressors[:, :J] -= np.einsum("j,k,nkp->njp", hidden, hidden, regressors[:, :J])
    found, _ = tracked(regressors, white)
    direction = np.concatenate([hidden, np.zeros(P)])
    np.testing.assert_allclose(found.covariance @ direction, direction, atol=1e-9)
    assert abs(found.mean @ direction) < 1e-9
    shown = np.linalg.eigvalsh(found.covariance[:J, :J])
    assert shown[-1] == pytest.approx(1.0) and shown[-2] < 1.0


def test_an_innovation_is_measured_in_the_deviation_that_the_uncertainty_gives_it():
    """The threshold grows with the motion: S = 1 + h^2 for one parameter of variance one."""
    one, watch = Parameters.prior(1, 1, CERTAIN), watching(1, 1, CERTAIN)
    for h in (0.0, 1.0, 10.0):
        _, found = updated(watch, one, np.array([5.0]), np.array([[h]]))
        assert found == pytest.approx(5.0 / np.sqrt(1 + h**2))


def test_offsets_walk_at_their_rate_and_errors_at_theirs():
    """Variance grows with time."""
    rates = replace(STEADY, drift_rate=0.2, offset_rate=0.7)
    prior = Parameters.prior(J, P, STEADY)
    later = prior.spread(watching(J, P, rates).drift(4.0))
    grown = np.diag(later.covariance - prior.covariance)
    np.testing.assert_allclose(grown, [0.2**2 * 4] * J + [0.7**2 * 4] * P)
    np.testing.assert_array_equal(later.mean, prior.mean)
