"""Observer: model errors, spectrum of the residuals, and alarms."""

from dataclasses import replace
from unittest.mock import patch

import numpy as np
import pytest
import scipy.linalg
import scipy.signal
from scipy.stats import binom

from ftc.fdi import CERTAIN, Fault, Uncertainty, observer
from ftc.fdi.bank import hypothesis_bank
from ftc.fdi.diagnosis import FdiConfig
from ftc.fdi.observer import (
    LEARNING_S,
    ORDER,
    Observer,
    ObserverState,
    Parameters,
    ResidualTest,
    Spectrum,
)
from ftc.fdi.uncertainty import UncertainModel
from tests.ftc.carts import Record, carts, outputs
from tests.ftc.spectra import spectrum_of

PERIOD_S = 10e-3
WRONG = replace(
    CERTAIN, gain=0.05, damping=0.2, offset=3.0, offset_rate=0.8, drift_rate=0.3, delay_s=1e-3
)


def cart_observer(uncertainty: Uncertainty, *faults: Fault, **options) -> Observer:
    bank = hypothesis_bank(carts(1), faults, uncertainty, 2)
    return Observer(bank.base_model, FdiConfig(uncertainty=uncertainty), PERIOD_S, **options)


def observe(kalman: Observer, y: np.ndarray, u: np.ndarray) -> list[ObserverState]:
    """Return the states after each of N samples of outputs (N, p) and commands (N, n)."""
    states, before = [kalman.start()], np.zeros(2)
    for measured, command in zip(y, u, strict=True):
        states.append(kalman.step(states[-1], np.array([*command, *before, 1.0]), measured)[0])
        before = command
    return states[1:]


LARGEST, LEARNS_S, FORGETS_S = 9.0, 0.3, 0.5


def kalman_reference(model, state: ObserverState, v, y: np.ndarray | None) -> dict[str, np.ndarray]:
    """Compute a sample by a Kalman filter in Joseph's form, and a mean of products."""
    p, J = len(model.C), len(model.M) - 1
    moving = np.concatenate([state.X[0], v])
    X = np.array([model.A @ x + M @ moving for x, M in zip(state.X, model.M, strict=True)])
    Y = np.array([model.C @ x + N @ moving for x, N in zip(state.X, model.N, strict=True)])
    rates = np.repeat([WRONG.drift_rate, WRONG.offset_rate], [J, p])
    walk = np.diag(rates**2 * PERIOD_S)
    mean, P = state.parameters.mean, state.parameters.covariance
    spectrum = state.spectrum.covariance
    result = {"X": X, "residual": np.zeros(p), "mean": mean, "P": P, "spectrum": spectrum}
    if y is None:
        return result | {"memory": np.stack([*state.memory[1:], np.zeros_like(Y)]), "P": P + walk}
    Y[0] = y - Y[0]
    memory = np.stack([*state.memory[1:], Y])
    white = np.einsum("qp,qcp->cp", state.whitening, memory[::-1])
    G = np.vstack([white[1:], np.diag(state.whitening.sum(axis=0))])
    S = np.eye(p) + G.T @ P @ G
    e = white[0] - G.T @ mean
    residual = np.linalg.solve(np.linalg.cholesky(S), e)
    result |= {"memory": memory, "residual": residual}
    known = state.spectrum.samples * PERIOD_S >= LEARNS_S
    if state.measured + 1 <= ORDER or (known and residual @ residual > LARGEST):
        return result
    K = np.linalg.solve(S, G.T @ P).T
    without = np.eye(J + p) - K @ G.T
    mean, P = mean + K @ e, without @ P @ without.T + K @ K.T
    residuals = Y[0] - np.einsum("j,jp->p", mean[:J], Y[1:]) - mean[J:]
    recent = np.stack([*state.spectrum.recent[1:], residuals])
    share = 1 / min(state.spectrum.samples + 1, FORGETS_S / PERIOD_S)
    spectrum = (1 - share) * spectrum + share * recent[::-1] * residuals
    return result | {"mean": mean, "P": P + walk, "spectrum": spectrum}


@pytest.mark.parametrize("seed", range(4))
def test_each_sample_is_that_of_a_kalman_filter_in_covariances(seed, monkeypatch):
    """Unmeasured samples, gated ones and those after them are included."""
    monkeypatch.setattr(observer, "MEMORY_S", FORGETS_S)  # so that 150 samples are the memory
    monkeypatch.setattr(observer, "LEARNING_S", LEARNS_S)
    record = Record.of(carts(1), 2, seed, samples=150, size=5e-2)
    kalman = cart_observer(WRONG, largest=LARGEST)
    state, before, gated = kalman.start(), np.zeros(2), 0
    for sample, (u, y) in enumerate(zip(record.u, record.y, strict=True)):
        v = np.concatenate([u, before, [1.0]])
        given = None if sample in (60, 61, 90) else y + 30.0 * (sample == 120)
        expected = kalman_reference(kalman.model, state, v, given)
        samples, before = state.spectrum.samples, u
        state, _ = kalman.step(state, v, given)
        gated += given is not None and state.spectrum.samples == samples
        result = {name: getattr(state, name) for name in ("X", "residual", "memory")}
        result |= {"mean": state.parameters.mean, "P": state.parameters.covariance}
        result |= {"spectrum": state.spectrum.covariance}
        for name, value in expected.items():
            tiny = 1e-9 * np.abs(value).max()
            np.testing.assert_allclose(result[name], value, rtol=1e-9, atol=tiny, err_msg=name)
        if sample % 40 == 30:
            state = kalman.with_spectrum(state)
    assert gated > 2 * ORDER


@pytest.mark.parametrize("seed", range(4))
def test_a_random_step_adds_its_variance_and_leaves_the_root_triangular(seed):
    """The steps include zeros, and the root may have empty columns."""
    rng = np.random.default_rng(seed)
    root = np.tril(rng.normal(size=(6, 6))) * np.sign(rng.integers(0, 3, 6))
    deviations = 10.0 ** rng.uniform(-3, 1, 6) * rng.integers(0, 2, 6)
    after = Parameters(np.zeros(6), root).spread(deviations)
    expected = root @ root.T + np.diag(deviations**2)
    np.testing.assert_allclose(after.covariance, expected, rtol=1e-9, atol=1e-12)
    np.testing.assert_array_equal(np.triu(after.root, 1), 0.0)


def test_relearning_follows_the_new_residuals():
    """Noise and offsets are larger; the known spectrum counts a quarter of the learning time."""
    kalman, rng = cart_observer(replace(CERTAIN, offset=3.0)), np.random.default_rng(0)
    known = observe(kalman, rng.standard_normal((400, 2)), np.zeros((400, 2)))[-1]
    v, zero = np.append(np.zeros(4), 1.0), np.array([40.0, -60.0])
    state, since = kalman.relearning(kalman.step(known, v, zero, learns=False)[0]), []
    for _ in range(round(LEARNING_S / PERIOD_S)):
        state, _ = kalman.step(state, v, zero + 4 * rng.normal(size=2))
        since.append(state.spectrum.recent[-1])
    np.testing.assert_allclose(state.parameters.mean, zero, atol=2.0)
    expected = 0.2 * known.spectrum.covariance[0] + 0.8 * np.mean(np.square(since), axis=0)
    np.testing.assert_allclose(state.spectrum.covariance[0], expected, rtol=0.02)


def strongest(remaining: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Return the largest likely force of cart 0, assumed weak by half, with this real force."""
    weak = Fault(0, "weak", 0.5)
    kalman = cart_observer(replace(CERTAIN, gain=0.02), weak, weak=(weak,))
    y = outputs(carts(1), 2, u * np.column_stack([remaining, np.ones(len(u))]))
    y += np.random.default_rng(0).standard_normal(y.shape)
    states = observe(kalman, y, u)
    [(_, doubted)] = kalman.strongest(kalman.after_alarm(states[-1]))
    assert doubted >= 1.0  # at an alarm it may be healthy
    seen = [kalman.strongest(state) for state in states]
    assert all(actuator == 0 for [(actuator, _)] in seen)
    return np.array([most for [(_, most)] in seen])


def test_without_motion_a_weak_actuator_may_be_healthy_two_seconds_later():
    """Evidence of half its force is forgotten after that time."""
    seen = strongest(np.full(260, 0.5), np.zeros((260, 2)))
    assert np.diff(seen).min() > 0
    assert seen[50] < 0.9 and 1.0 <= seen[200] < 1.1


@pytest.mark.parametrize("seed", range(3))
def test_the_remaining_force_of_a_weak_actuator_is_tracked(seed):
    """An actuator commanded by its tracked force exceeds a healthy one by at most a tenth."""
    u = np.cumsum(3e-2 * np.random.default_rng(seed).standard_normal((700, 2)), axis=0)
    remaining = np.interp(np.arange(700), [0, 100, 200, 500, 600, 700], [0.5, 0.5, 0.4, 1, 1, 2])
    seen = strongest(remaining, u)[50:]
    does = remaining[50:] / np.minimum(seen, 1.0)
    assert (does / np.maximum(1.0, remaining[50:])).max() < 1.1
    assert (seen - remaining[50:]).max() < 0.25


J, P, OFFSET = 4, 2, 3.0


def estimate(regressors, white) -> tuple[Parameters, np.ndarray]:
    """Estimate by an observer without a spectrum, whose model predicts the given regressors."""
    M, N = np.zeros((J + 1, 0, 1)), np.zeros((J + 1, P, 1))
    none = np.zeros((0, 0)), M, np.zeros((P, 0)), N, np.zeros((0, 0))
    model = UncertainModel(*none, 1, None, 0.0, J + 1)
    kalman, plain = Observer(model, FdiConfig(uncertainty=CERTAIN), 0.01), np.ones((1, P))
    result, innovations = Parameters.prior(J, P, replace(CERTAIN, offset=OFFSET)), []
    for H, e in zip(regressors, white, strict=True):
        predicted, memory = np.vstack([np.zeros(P), H[:J]]), np.zeros((1, J + 1, P))
        spectrum = Spectrum(e[None], e[None], 0)
        before = ObserverState(0, H[:J], memory, result, spectrum, plain, plain, e, 1)
        with patch.object(UncertainModel, "step", return_value=(predicted, H[:J])):
            after, _ = kalman.step(before, np.zeros(1), e)
        result = after.parameters
        innovations.append(after.residual)
    return result, np.array(innovations)


def solved(regressors, white) -> tuple[np.ndarray, np.ndarray]:
    """Return mean and root of the covariance by batch least squares, with the prior as rows.

    Rows by size and pivots of columns keep each row's accuracy (Powell and Reid, 1969).
    """
    prior = np.append(np.ones(J), np.full(P, OFFSET))
    H = np.vstack([regressors.transpose(0, 2, 1).reshape(-1, J + P), np.diag(1 / prior)])
    e, order = np.append(white.ravel(), np.zeros(J + P)), np.argsort(-np.abs(H).max(axis=1))
    Q, R, pivots = scipy.linalg.qr(H[order], mode="economic", pivoting=True)
    root = np.empty((J + P, J + P))
    root[pivots] = scipy.linalg.solve_triangular(R, np.eye(J + P))
    return root @ Q.T @ e[order], root


@pytest.mark.parametrize("seed", range(5))
def test_regressors_a_trillion_times_the_noise_give_a_valid_covariance(seed):
    """A covariance updated by differences is indefinite after three such samples."""
    rng = np.random.default_rng(seed)
    true = np.append(np.ones(J), np.full(P, OFFSET)) * rng.standard_normal(J + P)
    size = 10.0 ** rng.uniform(0, 12, (8, 1, P))
    moving = rng.normal(size=(J, 1)) * size + rng.normal(size=(8, J, P))
    regressors = np.concatenate([moving, np.broadcast_to(np.eye(P), (8, P, P))], axis=1)
    white = np.einsum("r,nrp->np", true, regressors) + rng.standard_normal((8, P))
    result, innovations = estimate(regressors, white)
    mean, root = solved(regressors, white)
    deviation = np.linalg.norm(root, axis=1)
    np.testing.assert_allclose(np.sqrt(np.diag(result.covariance)), deviation, rtol=1e-3)
    assert np.abs((result.mean - mean) / deviation).max() < 1e-2
    assert np.abs(innovations).max() < 6.0


LAGS = 6


@pytest.mark.parametrize("seed", range(4))
def test_a_filter_solves_the_equations_of_yule_and_walker(seed):
    """The later weights are those of the prediction; the filtered residuals have unit variance."""
    rng = np.random.default_rng(seed)
    residuals = np.cumsum(rng.standard_normal((300, 2)), axis=0) % 3.0
    spectrum = spectrum_of(residuals, LAGS)
    for weights, c, own in zip(
        spectrum.filter().T, spectrum.covariance.T, residuals.T, strict=True
    ):
        toeplitz = scipy.linalg.toeplitz(c[:LAGS]) + 1e-4 * c[0] * np.eye(LAGS)
        expected = np.linalg.solve(toeplitz, c[1:])
        np.testing.assert_allclose(-weights[1:] / weights[0], expected, rtol=1e-9, atol=1e-11)
        assert np.convolve(own, weights, "valid").var() == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize("turn", [0.0, 0.3, np.pi])
def test_a_singular_spectrum_is_amplified_a_hundredfold(turn):
    """The autocovariances of a constant and of sinusoids are singular."""
    lags = np.cos(turn * np.arange(LAGS + 1))[:, None]
    weights = Spectrum(0 * lags, lags, 1000).filter()
    assert np.isfinite(weights).all()
    assert 20 < weights[0, 0] < 101


def test_the_variance_is_corrected_for_the_fit_to_few_residuals():
    """A filter fitted to 100 samples of white noise gives unit variance in the next ones."""
    rng, squares = np.random.default_rng(1), []
    for _ in range(60):
        spectrum = spectrum_of(rng.standard_normal((100, 1)), 10)
        new = rng.standard_normal(200)
        left = np.convolve(new, spectrum.filter()[:, 0], mode="valid")
        squares.append((left**2).mean())
    assert np.mean(squares) == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize("slow", [0.02, 0.05, 0.2])
def test_a_decoupled_filter_whitens_slow_inputs(slow):
    """Inputs of fifty times the noise get unit variance; the likelihood accounts for the gain."""
    noise = Spectrum(np.zeros((LAGS + 1, 1)), np.eye(LAGS + 1, 1), 10**6)
    lags = slow * np.arange(LAGS + 1)
    inputs = scipy.linalg.toeplitz(2500 * (1 + lags) * np.exp(-lags)) + np.eye(LAGS + 1)
    plain, decoupled = noise.filter()[:, 0], noise.filter(slow=slow)[:, 0]
    assert plain @ inputs @ plain > 1000
    assert 0.6 < decoupled @ inputs @ decoupled < 1.001
    assert decoupled[0] < plain[0] and (decoupled**2).sum() < (plain**2).sum()
    # Faster signals remain visible: at 30 times the corner with at least half the amplitude.
    fast = np.exp(1j * min(30 * slow, np.pi) * np.arange(LAGS + 1))
    assert abs(fast @ decoupled) > 0.5 * abs(fast @ plain)


TICK_S = 4e-3
dithers = pytest.mark.parametrize("dither_hz", [None, 20.0])


@pytest.mark.parametrize("seed", range(4))
@dithers
def test_an_alarm_is_the_shortest_sum_that_exceeds_its_quantile(seed, dither_hz):
    """The sums of the latest M residuals are plain and demodulated, and scaled by root M."""
    rng = np.random.default_rng(seed)
    test = ResidualTest(2, 0.2 * 3600 / PERIOD_S, PERIOD_S, dither_hz)
    result = []
    for _ in range(40):
        offset = rng.normal(size=2) * rng.uniform(0, 0.3)
        recent = rng.standard_normal((test.windows[-1], 2)) + offset
        exceeding = []
        for M in test.windows:
            latest = recent[-M:][::-1]
            chi2 = (latest.sum(axis=0) ** 2).sum() / M
            angle = 2 * np.pi * (dither_hz or 0.0) * PERIOD_S * np.arange(M)
            turned = np.exp(1j * angle) @ latest
            swinging = dither_hz is not None and M * PERIOD_S * dither_hz >= 0.5
            chi4 = 2 * (np.abs(turned) ** 2).sum() / M if swinging else 0.0
            if chi2 > test.threshold or chi4 > test.demodulated_threshold:
                exceeding.append(M)
        result.append(test.alarm(recent))
        assert result[-1] == min(exceeding, default=0)
    assert len(set(result)) > 3


@dithers
@pytest.mark.parametrize("outputs", [2, 8])
def test_the_rate_of_false_alarms_is_at_most_as_stated(outputs, dither_hz):
    """Independent records of white noise are in alarm at the stated rate, or down to half of it."""
    kalman = ResidualTest(outputs, 0.02 * 3600 / TICK_S, TICK_S, dither_hz)
    rng = np.random.default_rng(outputs)
    records, shape = 4000, kalman.start().shape
    result = sum(kalman.alarm(rng.standard_normal(shape)) > 0 for _ in range(records))
    assert result <= binom.ppf(0.999, records, 0.02)
    assert result >= binom.ppf(0.001, records, 0.02 / 2)
