"""Dry friction beside a linear plant, against Coulomb's law and an independent optimizer."""

from dataclasses import replace

import control
import numpy as np
import pytest
from scipy.optimize import lsq_linear

from ftc import Stage, steps
from ftc.fdi import CERTAIN, Fault, NominalModel, fault_model, monitor
from ftc.fdi.bank import hypothesis_bank
from ftc.fdi.uncertainty import TYPICAL, uncertain_model
from tests.ftc.test_servo_faults import Carts

MASS, LIMIT, SOFTNESS, RATE = 2.0, 0.5, 0.05, 100.0
STEP_S = 1e-3


def block(ticks: int = 1) -> NominalModel:
    """A block on a dry floor, pushed by a force [N]."""
    plant = control.ss([[0, 1], [0, 0]], [[0], [1 / MASS]], [[1, 0]], 0)
    one = np.ones(1)
    friction = np.eye(1) / MASS, np.eye(1), LIMIT * one, SOFTNESS * one, RATE * one
    seen = np.array([[1.0, 0.0]])
    return NominalModel(plant, seen, np.ones(1), ticks * STEP_S, STEP_S, friction=friction)


@pytest.mark.parametrize("force", [0.1, 0.4, 0.9, -2.0])
def test_a_block_sticks_below_the_limit_and_slips_above_it(force):
    """Stuck it creeps at force times softness over rate; slipping it loses the limit."""
    model, time_s = fault_model(block()), 1.0
    x = np.zeros(2)
    for _ in range(round(time_s / STEP_S)):
        x = model.step(x, np.array([force]))
    slips = np.sign(force) * (abs(force) - LIMIT) / MASS * time_s
    creeps = force * SOFTNESS / RATE
    assert x[1] == pytest.approx(slips if abs(force) > LIMIT else creeps, rel=0.02)


def test_a_sliding_block_stops_after_its_energy_over_the_limit():
    """No force: m v^2 / 2 = limit times distance."""
    model, x, v = fault_model(block(10)), np.array([0.0, 0.3]), 0.3
    for _ in range(200):
        x = model.step(x, np.zeros(1))
    assert x[0] == pytest.approx(MASS * v**2 / 2 / LIMIT, rel=0.02)
    assert abs(x[1]) < 1e-6


def rubbing_carts(seed: int, limit: float = 0.05, n: int = 3) -> NominalModel:
    """Carts on servos, each with dry friction."""
    carts = Carts.random(n, seed)
    push = np.diag(1 / carts.mass)
    friction = push, np.eye(n), np.full(n, limit), np.diag(push) / 9, np.full(n, 105.0)
    return replace(carts.nominal(), friction=friction)


def with_limits(nominal: NominalModel, limit: np.ndarray) -> NominalModel:
    assert nominal.friction is not None
    push, rows, _, softness, rate = nominal.friction
    return replace(nominal, friction=(push, rows, limit, softness, rate))


@pytest.mark.parametrize("seed", range(5))
def test_forces_are_those_of_least_energy_within_the_limits(seed):
    """Forces f minimize f'K f / 2 + f'c: bounded least squares, of a coupled random K."""
    rng, n = np.random.default_rng(seed), 4
    root = rng.normal(size=(n, n))
    nominal = rubbing_carts(seed, n=n)
    M = root @ root.T + np.eye(n)
    limit = rng.uniform(0.01, 0.1, n)
    rubs = M, np.eye(n), limit, rng.uniform(0.1, 1, n), np.ones(n)
    model = fault_model(replace(nominal, period_s=STEP_S, friction=rubs))
    x, u = 1e-3 * rng.normal(size=2 * n), 1e-3 * rng.normal(size=n)
    free = fault_model(replace(nominal, period_s=STEP_S, friction=None)).step(x, u)
    rub = model.rubbing
    assert rub is not None
    c = rub.E @ x + rub.D @ [*u, 1.0]
    L = np.linalg.cholesky(rub.K)
    best = lsq_linear(L.T, -np.linalg.solve(L, c), (-limit, limit), tol=1e-14)
    np.testing.assert_allclose(model.step(x, u), free + rub.G @ best.x, atol=1e-9)
    assert (np.abs(best.x) > 0.99 * limit).any()


def test_a_loop_steps_the_same_friction_for_all_settings():
    """A batch of settings is each of them."""
    nominal = rubbing_carts(0)
    model = fault_model(nominal)
    loops = [control.ss([], [], [], [[0.2]], nominal.period_s)] * 3
    reference = 1e-3 * np.random.default_rng(1).normal(size=(2, 20, 3)).cumsum(axis=1)
    stage = Stage(model)
    both = np.array([one.x for one in steps([stage], nominal.plant.C, loops, reference)])
    for k in range(2):
        alone = np.array([one.x for one in steps([stage], nominal.plant.C, loops, reference[k])])
        np.testing.assert_allclose(both[:, k], alone, atol=1e-15)
    x = model.step(both[7, 1], 0.2 * (reference[1, 7] - nominal.plant.C @ both[7, 1]))
    np.testing.assert_allclose(x, both[8, 1], atol=1e-12)


@pytest.mark.parametrize("faults", [[], [Fault(1, "locked")]])
def test_a_sample_is_its_ticks_and_its_deviations_are_differences(faults):
    """Of the model to rounding; of a smaller limit exactly, of the state to first order."""
    ticks, spread, n = 4, 0.5, 3
    nominal = rubbing_carts(2)
    smaller = with_limits(nominal, np.array([0.025, 0.05, 0.05]))
    model = uncertain_model(
        lambda some: fault_model(nominal, some), faults, friction=spread, ticks=ticks
    )
    assert len(model.M) - model.first_limit == n
    X, x, y = np.zeros((1 + n, 2 * n)), np.zeros(2 * n), np.zeros(2 * n)
    truth, other = fault_model(nominal, faults), fault_model(smaller, faults)
    for sample in range(60):
        u = 5e-4 * np.array([np.sin(0.2 * sample), np.cos(0.1 * sample), 1.0])
        Y, X = model.step(X, np.array([*u, *u, 1.0]))
        seen = []
        for _ in range(ticks):
            seen.append([truth.C @ x, other.C @ y])
            x, y = truth.step(x, u), other.step(y, u)
        mean = np.mean(seen, axis=0)
        np.testing.assert_allclose(Y[:2], [mean[0], mean[0] - mean[1]], atol=1e-6)
    np.testing.assert_allclose(X[:2], [x, x - y], atol=1e-12)
    assert np.abs(X[1]).max() > 1e-6


def watched(nominal: NominalModel, fault: Fault | None, seed: int, actual: float = 1.0):
    """The monitor's last state on carts that follow slow commands; the fault strikes at 2 s.

    The friction of the carts is `actual` times that of the model.
    """
    rng, n = np.random.default_rng(seed), nominal.actuators
    assert nominal.friction is not None
    plant = with_limits(nominal, actual * nominal.friction[2])
    before, after = fault_model(plant), fault_model(plant, [fault] if fault else [])
    watch = monitor(nominal)
    state, x, u = watch.start(), np.zeros(2 * n), np.zeros(n)
    for tick in range(1600):
        if tick == 1000:
            x = after.onset @ x
        y = nominal.plant.C @ x + nominal.noise * rng.normal(size=n)
        state = watch.step(state, y, u)
        if state.diagnosis is not None:
            break
        time_s = tick * nominal.period_s
        u = 2e-3 * np.sin(2 * np.pi * np.array([0.5, 0.7, 0.3]) * time_s)
        x = (before if tick < 1000 else after).step(x, u)
    return state


@pytest.mark.long
@pytest.mark.parametrize("actual", [0.5, 0.8, 1.0])
@pytest.mark.parametrize("seed", range(2))
def test_friction_of_at_most_the_stated_size_is_no_failure(seed, actual):
    """Sound carts whose friction is smaller than stated are not suspected for long."""
    assert watched(rubbing_carts(seed), None, seed, actual).diagnosis is None


@pytest.mark.long
@pytest.mark.parametrize("seed", range(2))
def test_a_lock_is_named_in_spite_of_friction(seed):
    """A locked cart no longer follows, and friction of the stated size does not hold one so."""
    found = watched(rubbing_carts(seed), Fault(0, "locked"), seed).diagnosis
    assert found is not None
    assert found.fault.actuator == 0


def test_without_friction_there_is_nothing_of_it():
    """Models, banks and parameters are as they were."""
    nominal = Carts.random(3, 0).nominal()
    assert fault_model(nominal).rubbing is None
    bank = hypothesis_bank(nominal, uncertainty=TYPICAL)
    assert bank.models.rubbing is None
    for each in (bank.believed, hypothesis_bank(rubbing_carts(0), uncertainty=CERTAIN).believed):
        assert each.first_limit == len(each.M)
