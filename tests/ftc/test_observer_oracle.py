"""What is compiled of the watch, against the same written in covariances and sums of numpy."""

from dataclasses import replace

import numpy as np
import pytest

from ftc.fdi import CERTAIN, observer
from ftc.fdi.bank import hypothesis_bank
from ftc.fdi.diagnosis import FdiConfig
from ftc.fdi.observer import ORDER, Observer, ObserverState, Parameters, ResidualTest
from tests.cart_runs import Record, carts
from tests.spectra import spectrum_of

NOMINAL, PERIOD_S, MEMORY_S, LEARNING_S = carts(1), 10e-3, 0.5, 0.3
WRONG = replace(
    CERTAIN, gain=0.05, damping=0.2, offset=3.0, offset_rate=0.8, drift_rate=0.3, delay_s=1e-3
)
CONFIG = FdiConfig(uncertainty=WRONG)
LARGEST = 9.0
seeds = pytest.mark.parametrize("seed", range(4))


def by_hand(model, state: ObserverState, v: np.ndarray, y: np.ndarray | None) -> dict:
    """The sample by the Kalman filter in Joseph's form, a Riccati step, and a mean of products."""
    p, J = len(model.C), len(model.M) - 1
    moving = np.concatenate([state.X[0], v])
    X = np.array([model.A @ x + M @ moving for x, M in zip(state.X, model.M, strict=True)])
    Y = np.array([model.C @ x + N @ moving for x, N in zip(state.X, model.N, strict=True)])
    rates = np.repeat([WRONG.drift_rate, WRONG.offset_rate], [J, p])
    walk = np.diag(rates**2 * PERIOD_S)
    mean, P = state.parameters.mean, state.parameters.covariance
    spectrum, found = state.spectrum.covariance, {"X": X, "residual": np.zeros(p)}
    if y is None:
        memory = np.stack([*state.memory[1:], np.zeros_like(Y)])
        return found | {"memory": memory, "mean": mean, "P": P + walk, "spectrum": spectrum}
    Y[0] = y - Y[0]
    memory = np.stack([*state.memory[1:], Y])
    white = np.einsum("qp,qcp->cp", state.whitening, memory[::-1])
    G = np.vstack([white[1:], np.diag(state.whitening.sum(axis=0))])
    S = np.eye(p) + G.T @ P @ G
    e = white[0] - G.T @ mean
    residual = np.linalg.solve(np.linalg.cholesky(S), e)
    found |= {"memory": memory, "residual": residual}
    known = state.spectrum.samples * PERIOD_S >= LEARNING_S
    if state.measured + 1 <= ORDER or (known and residual @ residual > LARGEST):
        return found | {"mean": mean, "P": P, "spectrum": spectrum}
    K = np.linalg.solve(S, G.T @ P).T
    without = np.eye(J + p) - K @ G.T
    mean, P = mean + K @ e, without @ P @ without.T + K @ K.T
    left = Y[0] - np.einsum("j,jp->p", mean[:J], Y[1:]) - mean[J:]
    recent = np.stack([*state.spectrum.recent[1:], left])
    share = 1 / min(state.spectrum.samples + 1, MEMORY_S / PERIOD_S)
    spectrum = (1 - share) * spectrum + share * recent[::-1] * left
    return found | {"mean": mean, "P": P + walk, "spectrum": spectrum}


@seeds
def test_each_sample_is_that_of_a_kalman_filter_in_covariances(seed, monkeypatch):
    """Also one that is not measured, one too large to learn from, and those after either."""
    monkeypatch.setattr(observer, "MEMORY_S", MEMORY_S)  # so that 150 samples forget
    monkeypatch.setattr(observer, "LEARNING_S", LEARNING_S)
    record = Record.of(NOMINAL, 2, seed, samples=150, size=5e-2)
    watch = Observer(hypothesis_bank(NOMINAL, (), WRONG, 2).believed, CONFIG, PERIOD_S, LARGEST)
    state, before, gated = watch.start(), np.zeros(2), 0
    for sample, (u, y) in enumerate(zip(record.u, record.y, strict=True)):
        v = np.concatenate([u, before, [1.0]])
        given = None if sample in (60, 61, 90) else y + 30.0 * (sample == 120)
        expected = by_hand(watch.model, state, v, given)
        samples, before = state.spectrum.samples, u
        state, _ = watch.step(state, v, given)
        gated += given is not None and state.spectrum.samples == samples
        found = {
            "X": state.X,
            "residual": state.residual,
            "memory": state.memory,
            "mean": state.parameters.mean,
            "P": state.parameters.covariance,
            "spectrum": state.spectrum.covariance,
        }
        for name, value in expected.items():
            tiny = 1e-9 * np.abs(value).max()
            np.testing.assert_allclose(found[name], value, rtol=1e-9, atol=tiny, err_msg=name)
        if sample % 40 == 30:
            state = watch.with_spectrum(state)
    assert gated > 2 * ORDER


@seeds
def test_a_random_step_adds_its_variance_and_leaves_the_root_triangular(seed):
    """Of some parameters, known or not: a step of zero, and a root with empty columns."""
    rng = np.random.default_rng(seed)
    root = np.tril(rng.normal(size=(6, 6))) * np.sign(rng.integers(0, 3, 6))
    deviations = 10.0 ** rng.uniform(-3, 1, 6) * rng.integers(0, 2, 6)
    after = Parameters(np.zeros(6), root).spread(deviations)
    expected = root @ root.T + np.diag(deviations**2)
    np.testing.assert_allclose(after.covariance, expected, rtol=1e-9, atol=1e-12)
    np.testing.assert_array_equal(np.triu(after.root, 1), 0.0)


@seeds
def test_a_filter_solves_the_equations_of_yule_and_walker(seed):
    """Its weights, but for the first, predict: they satisfy Toeplitz equations of the products."""
    rng = np.random.default_rng(seed)
    residuals = np.cumsum(rng.standard_normal((300, 2)), axis=0) % 3.0
    spectrum = spectrum_of(residuals, 6)
    for weights, c in zip(spectrum.filter().T, spectrum.covariance.T, strict=True):
        lags = np.abs(np.subtract.outer(np.arange(6), np.arange(6)))
        toeplitz = c[lags] + 1e-4 * c[0] * np.eye(6)  # the ridge
        expected = np.linalg.solve(toeplitz, c[1:])
        np.testing.assert_allclose(-weights[1:] / weights[0], expected, rtol=1e-9, atol=1e-11)


@seeds
@pytest.mark.parametrize("dither_hz", [None, 20.0])
def test_an_alarm_is_the_shortest_sum_that_exceeds_its_quantile(seed, dither_hz):
    """Sums of the latest M residuals, plain and turned by the dither, over the deviation of M."""
    rng = np.random.default_rng(seed)
    test = ResidualTest(2, 0.2 * 3600 / PERIOD_S, PERIOD_S, dither_hz)
    found = []
    for _ in range(40):
        recent = rng.standard_normal((test.windows[-1], 2)) + rng.normal(size=2) * rng.uniform(
            0, 0.3
        )
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
        found.append(test.alarm(recent))
        assert found[-1] == min(exceeding, default=0)
    assert len(set(found)) > 3
