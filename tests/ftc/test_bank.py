"""Evidence of each hypothesis of the bank, against Gaussians written out in full."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg
import scipy.optimize
from scipy.stats import multivariate_normal

from ftc.fdi import Cause, Fault, Uncertainty
from ftc.fdi.bank import Evidence, base_model_of, hypothesis_bank
from ftc.fdi.observer import Parameters
from ftc.fdi.uncertainty import perturbed
from kernels import lib, pointer
from tests.ftc.carts import ONSETS, SAMPLES, Record, carts, gathered, outputs, sample_of
from tests.ftc.spectra import whitened

WRONG = Uncertainty(0.1, 0.1, 0.2, 0.05, delay_s=2e-3, command=30.0, supply=0.2, scale=0.4)
SPREAD = 1 / np.sqrt(12)  # standard deviation of a uniform variable over a cell of one
seeds = pytest.mark.parametrize("seed", range(3))


def caused(record: Record, cause: Cause, onset: int, uncertainty) -> list[np.ndarray]:
    """Return the effects (N, p) of one standard deviation of a cause's constant and growth."""
    nominal, ticks, u = record.nominal, record.ticks, record.u
    plain, since = outputs(nominal, ticks, u), np.arange(len(u)) - onset
    on = (since >= 0)[:, None]
    if cause.kind == "scale":
        return [uncertainty.scale * on * plain, np.zeros_like(plain)]
    if cause.kind == "supply":
        return [outputs(nominal, ticks, u * (1 + uncertainty.supply * on)) - plain, 0 * plain]
    own = np.eye(nominal.actuators)[cause.actuator]
    resting = np.linalg.solve(-nominal.plant.A, nominal.plant.B @ own)
    own = own * uncertainty.command / np.linalg.norm(nominal.plant.C @ resting / nominal.noise)
    drift = since[:, None] * ticks * nominal.period_s
    return [outputs(nominal, ticks, u + each * own) - plain for each in (on, on * drift)]


def sensitivities(record: Record, fault: Fault | Cause | None, onset: int) -> np.ndarray:
    """Simulate the effects (R - p, N, p) of all parameters except the offsets."""
    nominal, ticks, u = record.nominal, record.ticks, record.u
    cause, fault = (fault, None) if isinstance(fault, Cause) else (None, fault)
    plain = outputs(nominal, ticks, u, fault, onset)
    tiny = 1e-4
    small = replace(WRONG, **{k: tiny * v for k, v in vars(WRONG).items()})
    step = 1e-3 * tiny  # perturbed() steps by a thousandth of a deviation
    result = [
        (outputs(each, ticks, u, fault, onset) - plain) / step for each in perturbed(nominal, small)
    ]
    late = WRONG.delay_s / nominal.period_s / ticks
    result.append(outputs(nominal, ticks, u, fault, onset, late=late) - plain)
    if fault is None:
        own = [plain * 0] * 2 if cause is None else caused(record, cause, onset, WRONG)
        return np.array([*result, plain * 0, *own, plain * 0])
    later = outputs(nominal, ticks, u, fault, onset + 1) - plain
    later[onset] = 0.0
    push = nominal.plant.B[:, fault.actuator]
    direction = np.roll(push, -len(push) // 2)
    direction = direction / np.linalg.norm(nominal.plant.C @ direction / nominal.noise)
    further, lost = np.zeros_like(plain), np.zeros_like(plain)
    if fault.kind == "locked":
        further = outputs(nominal, ticks, u, fault, onset, displaced=1.5 * direction) - plain
    else:
        remaining, parts = fault.effectiveness, []  # 25 % more and less loss
        for other in (min(remaining + 0.25, 1.0), max(remaining - 0.25, 0.0)):
            about = replace(fault, kind="weak", effectiveness=other)
            parts.append(outputs(nominal, ticks, u, about, onset))
        lost = (parts[1] - parts[0]) / (2 if remaining else 1)
    return np.array([*result, SPREAD * later, further, plain * 0, SPREAD * lost])


def random_prior(errors: int, seed: int) -> Parameters:
    rng = np.random.default_rng(seed)
    half = rng.normal(size=(errors + 2,) * 2)
    covariance = 0.2 * half @ half.T / len(half) + 0.1 * np.eye(len(half))
    return Parameters(
        0.5 * rng.standard_normal(len(half)), np.linalg.cholesky(covariance).astype(float)
    )


def random_whitening(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.vstack([rng.uniform(0.5, 1.5, (1, 2)), 0.3 * rng.normal(size=(2, 2))])


def regression(record: Record, fault: Fault | Cause | None, onset: int, prior, whitening):
    """Return H, P and e: residuals e = H theta + noise, with theta of covariance P."""
    failed = None if isinstance(fault, Cause) else fault
    seen = outputs(record.nominal, record.ticks, record.u, failed, onset)
    rows = [whitened(whitening, each).ravel() for each in sensitivities(record, fault, onset)]
    always = [np.tile(each * whitening.sum(axis=0), (SAMPLES, 1)).ravel() for each in np.eye(2)]
    H = np.array([*rows[:-4], *always, *rows[-4:]]).T
    P = scipy.linalg.block_diag(prior.covariance, np.eye(4))
    return H, P, whitened(whitening, record.y - seen).ravel() - H[:, :-4] @ prior.mean


def written_out(record: Record, fault: Fault | Cause | None, onset: int, prior, whitening):
    """Return energy, log root determinant and parameters of a hypothesis, and where it is cut."""
    H, P, e = regression(record, fault, onset, prior, whitening)
    S = np.eye(len(e)) + H @ P @ H.T
    low, high = np.full(len(P), -np.inf), np.full(len(P), np.inf)
    low[[-4, -1]], high[[-4, -1]] = -np.sqrt(3), np.sqrt(3)
    if isinstance(fault, Fault) and fault.kind == "free":
        high[-1] = 0.0
    if isinstance(fault, Fault) and fault.effectiveness == 0.75:
        low[-1] = -0.23 / (0.25 * SPREAD)
    best = P @ H.T @ np.linalg.solve(S, e)
    energy = e @ np.linalg.solve(S, e)
    beyond = int(((best < low) | (best > high)).sum())
    if beyond:
        whitened_rows = np.vstack([H, np.linalg.inv(np.linalg.cholesky(P))])
        aim = np.append(e, np.zeros(len(P)))
        within = scipy.optimize.lsq_linear(whitened_rows, aim, (low, high), tol=1e-12)
        energy, best = 2 * within.cost, within.x
    return energy, np.linalg.slogdet(S)[1] / 2, best, beyond


@pytest.mark.parametrize("ticks", [1, pytest.param(3, marks=pytest.mark.long)])
@pytest.mark.parametrize("seed", [0, *(pytest.param(k, marks=pytest.mark.long) for k in (1, 2, 3))])
def test_a_hypothesis_is_weighed_by_its_gaussian_without_the_unknowns(seed, ticks):
    """The reference simulates hypotheses, errors and causes (offset, supply, scale) in full."""
    nominal = carts(seed)
    record = Record.of(nominal, ticks, seed, Fault(1, "weak", 0.4))
    bank = hypothesis_bank(nominal, (), WRONG, ticks)
    prior, whitening = random_prior(len(bank.base_model.M) - 1, seed), random_whitening(seed)
    energy, log_det, parameters = gathered(bank, record, prior, whitening).marginal()
    counted = np.zeros(3, dtype=int)
    for h, fault in enumerate([None, *bank.faults, *bank.causes, None]):
        for k, onset in enumerate(ONSETS[: 1 if fault is None else None]):
            expected, root, best, beyond = written_out(record, fault, onset, prior, whitening)
            counted[beyond] += 1
            assert log_det[h, k] == pytest.approx(root, rel=1e-3, abs=1e-4)
            assert energy[h, k] == pytest.approx(expected, rel=1e-3)
            np.testing.assert_allclose(parameters[h, k], best, atol=5e-3 * np.abs(best).max())
    assert counted[0] > 3 and counted[1] > 0


@pytest.mark.parametrize("gain", [0.1, 1.0, 7.0])
@pytest.mark.parametrize("seed", range(2))
def test_the_last_hypothesis_is_a_density_of_the_outputs_as_the_first(seed, gain):
    """The log ratio is that of the Gaussians of the measurements, for filters of any gain."""
    record = Record.of(carts(seed), 2, seed)
    bank = hypothesis_bank(record.nominal, (), WRONG, 2)
    prior = random_prior(len(bank.base_model.M) - 1, seed)
    filters = random_whitening(seed), gain * random_whitening(seed + 10)
    evidence = gathered(bank, record, prior, filters[0], decoupled=filters[1])
    energy, log_det, _ = evidence.marginal()
    plain = (-energy / 2 - log_det)[[0, -1], 0]
    densities = []
    for weights in filters:
        H, P, e = regression(record, None, 0, prior, weights)
        columns = (whitened(weights, unit) for unit in np.eye(e.size).reshape(-1, SAMPLES, 2))
        L = np.array([column.ravel() for column in columns]).T  # e = L y minus the known part
        inverse = np.linalg.inv(L)
        cov = inverse @ (np.eye(e.size) + H @ P @ H.T) @ inverse.T
        densities.append(multivariate_normal(cov=cov).logpdf(inverse @ e))
    result = plain[1] - plain[0] + evidence.gain
    assert result == pytest.approx(densities[1] - densities[0], rel=1e-3, abs=1e-2)


@pytest.mark.parametrize("faults", [(), (Fault(0, "locked"),), (Fault(1, "weak", 0.4),)])
def test_the_base_model_alone_is_that_of_all_hypotheses(faults):
    alone = base_model_of(carts(0, n=3), faults, WRONG, 2)
    together = hypothesis_bank(carts(0, n=3), faults, WRONG, 2).base_model
    for name in ("A", "M", "C", "N", "onset"):
        np.testing.assert_array_equal(getattr(alone, name), getattr(together, name))


def test_a_weak_actuator_loses_a_fraction_of_its_remaining_force():
    bank = hypothesis_bank(carts(0), [Fault(0, "weak", 0.5), Fault(1, "free")])
    remaining = [fault.effectiveness for fault in bank.faults[:5] if fault.kind == "weak"]
    assert {fault.actuator for fault in bank.faults[:5]} == {0}
    np.testing.assert_allclose(remaining, [0.375, 0.25, 0.125])
    again = [Fault(0, "weak", 1.0), Fault(1, "weak", 1.0), Fault(1, "locked")]
    assert list(bank.faults[5:]) == again
    with pytest.raises(ValueError, match="faults must leave a working actuator"):
        hypothesis_bank(carts(0), [Fault(k, "locked") for k in range(2)])


ARRAYS = ("X", "memory", "information", "score", "energy")


@seeds
def test_a_step_does_not_change_its_argument_and_equals_one_in_place(seed):
    """A step leaves its argument unchanged; an unmeasured sample adds no evidence."""
    rng = np.random.default_rng(seed)
    record, filters = Record.of(carts(seed), 2, seed), rng.uniform(0.1, 1.0, (2, 4, 2))
    bank = hypothesis_bank(record.nominal, (), WRONG, 2)
    prior = Parameters.prior(len(bank.base_model.M) - 1, 2, WRONG)
    now = int(ONSETS[1])
    state = gathered(bank, replace(record, u=record.u[:now], y=record.y[:now]), prior, filters[0])

    def arrays(evidence: Evidence) -> list[np.ndarray]:
        return [getattr(evidence, name).copy() for name in ARRAYS]

    v, y = rng.normal(size=5), rng.normal(size=2)
    then, sample = arrays(state), sample_of(now, v, y)
    after = bank.step(state, sample, 1.5, *filters)
    expected, unmeasured = arrays(after), sample_of(now + 1, v, y, is_complete=False)
    np.testing.assert_equal(arrays(state), then)
    in_place = arrays(bank.step(state, sample, 1.5, *filters, copy=False))
    after_unmeasured = arrays(bank.step(after, unmeasured, 1.5, *filters))
    np.testing.assert_equal(in_place, expected)
    np.testing.assert_equal(after_unmeasured[2:], expected[2:])


@seeds
def test_information_made_indefinite_by_rounding_gives_finite_numbers(seed):
    """Regressors are a trillion times the noise: 1 is lost in round-off; pivots stay positive."""
    rows = 1e12 * np.random.default_rng(seed).normal(size=(9, 2))
    information = rows @ rows.T
    assert np.linalg.eigvalsh(np.eye(9) + information)[0] < 0
    solved, log_det = np.eye(9)[None, None, :, :3].copy(), np.empty((1, 1))
    arguments = pointer(information[np.tril_indices(9)]), pointer(np.eye(9))
    workspace = pointer(np.empty(9 * 19))
    lib.integrate_out(1, 9, *arguments, workspace, pointer(solved), pointer(log_det))
    assert np.isfinite(solved).all() and log_det[0, 0] > 0
