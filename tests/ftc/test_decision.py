"""Decisions from the evidence: probabilities, lost fractions, states."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binom

from ftc.fdi import CERTAIN, Fault, NominalModel, Uncertainty, fault_model
from ftc.fdi.bank import LOST, hypothesis_bank
from ftc.fdi.decision import decide
from ftc.fdi.observer import Parameters
from tests.ftc.carts import ONSETS, Record, carts, gathered, outputs

WRONG = Uncertainty(0.1, 0.1, 0.2, 0.05, delay_s=2e-3)
WIDER = replace(WRONG, command=10.0, supply=0.3, scale=0.3)


def decision_of(record: Record, onsets=ONSETS, uncertainty=CERTAIN, bank=None, **how):
    """Return the evidence and the decision at the end of a record."""
    bank, p = bank or hypothesis_bank(record.nominal, (), uncertainty, 2), record.y.shape[1]
    prior = Parameters.prior(len(bank.base_model.M) - 1, p, uncertainty)
    evidence = gathered(bank, record, prior, np.ones((1, p)), onsets)
    return evidence, decide(bank, evidence, len(record.y) - 1, **how)


def failed_state(
    nominal: NominalModel, fault: Fault, record: Record, onset: int, nudge: np.ndarray | float = 0.0
):
    """Return the state of the failed plant after all samples, and that at the onset."""
    sent, cut = np.repeat(record.u, record.ticks, axis=0), onset * record.ticks
    after = fault_model(nominal, [fault])
    at_onset = after.onset @ fault_model(nominal).states(sent[:cut])[-1] + nudge
    return after.states(sent[cut:], at_onset)[-1], at_onset


def random_fault(rng: np.random.Generator, n: int) -> Fault:
    """Sample a failure from the prior of the bank."""
    actuator, kind_index = int(rng.integers(n)), int(rng.integers(1 + len(LOST)))
    if kind_index == 0:
        return Fault(actuator, "locked")
    if kind_index == len(LOST):
        return Fault(actuator, "free")
    lost = LOST[kind_index - 1] + rng.uniform(-0.125, 0.125)
    return Fault(actuator, "weak", min(1 - lost, 1.0))


@pytest.mark.parametrize("noise", [2e-3, pytest.param(6e-3, marks=pytest.mark.long)])
def test_confidence_is_the_rate_of_correct_decisions(noise):
    """Failures (any actuator and kind) and health are sampled from the prior of the decision."""
    rng, claimed, correct = np.random.default_rng(5), [], []
    bank = hypothesis_bank(carts(1, 3, noise), (), CERTAIN, 2)
    for seed in range(250):
        fault = random_fault(rng, 3) if rng.random() < 0.5 else None
        onset = int(rng.choice(ONSETS))
        record = Record.of(carts(1, 3, noise), 2, [seed, 1], fault, onset)
        _, decision = decision_of(record, bank=bank)
        healthy = decision.fault_free_confidence > decision.actuator_confidence
        claimed.append(max(decision.fault_free_confidence, decision.actuator_confidence))
        isolated = None if healthy else decision.fault.actuator
        correct.append(isolated == (None if fault is None else fault.actuator))
    assert 0.5 < np.mean(claimed) < 0.95  # the decisions are not trivial
    low, high = binom.interval(0.998, len(claimed), np.mean(claimed))
    assert low <= np.sum(correct) <= high


@pytest.mark.parametrize("uncertainty", [WRONG, WIDER])
@pytest.mark.parametrize("disturbed", [True, False])
def test_without_evidence_the_probabilities_are_the_priors(disturbed, uncertainty):
    """Causes and disturbances count as no failure."""
    silent = Record(carts(1, 4), 2, np.zeros((0, 4)), np.zeros((0, 4)))
    _, decision = decision_of(silent, uncertainty=uncertainty, disturbed=disturbed)
    assert decision.fault_free_confidence == pytest.approx(1 / 2)
    assert decision.actuator_confidence == pytest.approx(1 / 2 / 4)
    # Locked, free, and three weak models are equally likely.
    assert decision.kind_confidences == pytest.approx((1 / 5, 1 / 5, 3 / 5))


@pytest.mark.parametrize(
    ("remaining", "lost"), [*((1, x) for x in (0.05, 0.3, 0.45, 0.8, 0.86)), (0.6, 0.3)]
)
def test_a_loss_between_the_models_is_estimated(remaining, lost):
    """The loss is relative to the remaining force, of a healthy or a known weak actuator."""
    before = [Fault(1, "weak", remaining)] if remaining < 1 else []
    fault = Fault(1, "weak", remaining * (1 - lost))
    record = Record.of(carts(2, 3), 2, 3, fault, 20, 60, size=5e-2, before=before)
    bank = hypothesis_bank(record.nominal, before, CERTAIN, 2)
    _, decision = decision_of(record, np.arange(18, 23), bank=bank)
    assert (decision.fault.actuator, decision.fault.kind) == (1, "weak")
    assert decision.fault.effectiveness == pytest.approx(fault.effectiveness, abs=0.03)
    assert decision.unexplained < 0.1


@pytest.mark.parametrize("kind", ["locked", "free"])
def test_the_state_of_a_decision_is_that_of_the_failed_plant(kind):
    nominal, fault = carts(4), Fault(0, kind)
    record = Record.of(nominal, 2, 4, fault, onset=20, samples=40, size=5e-2)
    _, decision = decision_of(record, np.arange(19, 22))
    assert (decision.fault, decision.onset) == (fault, 20)
    expected, _ = failed_state(nominal, fault, record, 20)
    C = fault_model(nominal).C
    np.testing.assert_allclose(C @ decision.x, C @ expected, atol=0.5)
    np.testing.assert_allclose(decision.x, expected, atol=0.02 * np.abs(expected).max())


@pytest.mark.parametrize("seed", range(3))
def test_a_lock_off_the_models_position_is_estimated(seed):
    """Friction moved the plant by three standard deviations of an output's noise."""
    nominal, fault = carts(4), Fault(0, "locked")
    record = Record.of(nominal, 2, seed, fault, 20, 60)
    push = nominal.plant.B[2:, 0]
    direction = push / np.linalg.norm(nominal.plant.C[:, :2] @ push)
    nudge = 3e-3 * np.concatenate([direction, [0.0, 0.0]])
    moved = outputs(nominal, 2, record.u, fault, 20, displaced=nudge)
    more = moved - outputs(nominal, 2, record.u, fault, 20)
    _, decision = decision_of(replace(record, y=record.y + more), np.arange(19, 22))
    _, at_lock = failed_state(nominal, fault, record, 20, nudge)
    assert decision.fault == fault
    off = nominal.displacement[0] @ (decision.x - at_lock)
    assert abs(off) < 0.3 * abs(nominal.displacement[0] @ nudge)


def locked(y_more: np.ndarray, seed: int = 0):
    """Return evidence and decision of a lock at sample 20 of 60, with an added signal."""
    record = Record.of(carts(3), 2, seed, Fault(0, "locked"), 20, 60, size=5e-2)
    return decision_of(replace(record, y=record.y + y_more), np.arange(18, 23))


@pytest.mark.parametrize("seed", range(4))
def test_the_inflation_divides_the_log_likelihoods(seed):
    """Added noise of nine times the variance after the onset gives an inflation of ten."""
    _, decision = locked(np.zeros((60, 2)), seed)
    assert decision.unexplained == 0.0
    assert decision.inflation == pytest.approx(1.0, abs=0.3)
    rng = np.random.default_rng([seed, 2])
    more = 3 * rng.standard_normal((60, 2)) * (np.arange(60) >= 20)[:, None]
    evidence, decision = locked(more, seed)
    assert decision.inflation == pytest.approx(10.0, rel=0.5)
    energy, log_det, _ = evidence.marginal()
    plain = (-energy / 2 - log_det)[1:-1].max(axis=0) + energy[0, 0] / 2 + log_det[0, 0]
    np.testing.assert_allclose(decision.best, plain / decision.inflation)


def test_the_unexplained_fraction_is_that_of_the_energy():
    """The fraction is a half if a square wave adds as much energy as the lock."""
    energy = locked(np.zeros((60, 2)))[0].marginal()[0]
    gained = energy[0, 0] - energy[1:-1].min()
    wave = np.where(np.arange(60) % 2, 1.0, -1.0) * (np.arange(60) >= 20)
    _, decision = locked(np.column_stack([wave, -wave]) * np.sqrt(gained / 80))
    assert decision.fault.actuator == 0
    assert decision.unexplained == pytest.approx(0.5, abs=0.12)


def test_the_parameter_deviation_does_not_depend_on_sensor_offsets():
    """Offsets of fifty standard deviations of noise do not change the plant parameters."""
    record = Record.of(carts(3, 3), 2, 4, Fault(1, "weak", 0.4), onset=6)
    sure, unsure = (
        decision_of(replace(record, y=record.y + off), uncertainty=replace(WRONG, offset=100.0))[1]
        for off in (0.0, 50.0)
    )
    assert 0 < sure.parameter_deviation < 10
    assert unsure.parameter_deviation == pytest.approx(sure.parameter_deviation, abs=1)
