"""Faults of position servos: their models, and their diagnosis, against direct simulations."""

from dataclasses import dataclass, replace

import control
import numpy as np
import pytest

from ftc.fdi import CERTAIN, KINDS, Fault, NominalModel, fault_model, monitor
from ftc.fdi.bank import hypothesis_bank
from ftc.fdi.decision import verdict as verdict_of
from ftc.fdi.fault_model import resting_displacements
from ftc.fdi.observer import Parameters
from sim import Failure
from tests.cart_runs import sample_of
from tests.sim.machines import lifted, servos

failures = pytest.mark.parametrize("kind", KINDS)
PERIOD_S, STEP_S = 2e-3, 1e-3


@dataclass(frozen=True)
class Carts:
    """Carts of masses (n,) between springs (n, n), each on a servo (stiffness, damping), loaded."""

    mass: np.ndarray
    springs: np.ndarray
    kp: np.ndarray
    kv: np.ndarray
    load: np.ndarray

    @classmethod
    def random(cls, n: int, seed: int) -> "Carts":
        """Servos of 3 to 6 Hz, springs a fifth as stiff, loads that displace by millimetres."""
        rng = np.random.default_rng(seed)
        mass, coupling = rng.uniform(1, 2, n), rng.normal(size=(n, n))
        kp = rng.uniform(400, 1500, n)
        springs = 40 * np.eye(n) + 30 * coupling @ coupling.T
        return cls(mass, springs, kp, 0.03 * kp, rng.uniform(0.5, 2, n))

    def nominal(self) -> NominalModel:
        """Displacements are commanded as the servos' targets, and measured to 20 um."""
        n, zero = len(self.mass), np.zeros((len(self.mass),) * 2)
        A = np.block(
            [
                [zero, np.eye(n)],
                [
                    -(self.springs + np.diag(self.kp)) / self.mass[:, None],
                    -np.diag(self.kv / self.mass),
                ],
            ]
        )
        B = np.vstack([zero, np.diag(self.kp / self.mass)])
        seen = np.eye(n, 2 * n)
        return NominalModel(
            control.ss(A, B, seen, 0),
            seen,
            np.full(n, 2e-5),
            PERIOD_S,
            STEP_S,
            feedback=np.hstack([np.eye(n), np.diag(self.kv / self.kp)]),
            holding=self.load / self.kp,
        )

    def run(self, fault: Fault, onset: int, sent: np.ndarray) -> np.ndarray:
        """Positions (N, n) at each tick, cart by cart: Newton, force by force."""
        n = len(self.mass)
        q, v, seen = np.zeros(n), np.zeros(n), []
        strength, moving = np.ones(n), np.ones(n)
        for tick, u in enumerate(sent):
            if tick == onset:
                if fault.kind == "locked":
                    moving[fault.actuator] = 0.0
                else:
                    strength[fault.actuator] = fault.effectiveness
                v = v * moving
            seen.append(q)
            for _ in range(round(PERIOD_S / STEP_S)):
                servo = strength * (self.kp * (u - q) - self.kv * v + self.load)
                v = v + STEP_S * moving * (servo - self.load - self.springs @ q) / self.mass
                q = q + STEP_S * v
        return np.array(seen)


def commands(n: int, ticks: int, rng: np.random.Generator) -> np.ndarray:
    """A random walk of some millimetres."""
    return np.cumsum(2e-4 * rng.standard_normal((ticks, n)), axis=0)


@failures
@pytest.mark.parametrize("n", [2, 5])
def test_the_model_of_a_failed_servo_moves_as_newton_has_it(n, kind):
    """Onset, load that is no longer held, and the commands after it, to rounding."""
    carts, rng = Carts.random(n, n), np.random.default_rng(0)
    nominal, sent = carts.nominal(), commands(n, 400, rng)
    fault = Fault(1, kind, 0.4 * (kind == "weak"))
    before, after = fault_model(nominal), fault_model(nominal, [fault])
    states = before.states(sent[:100])
    states = np.vstack([states[:-1], after.states(sent[100:], after.onset @ states[-1])])[:-1]
    np.testing.assert_allclose(states[:, :n], carts.run(fault, 100, sent), atol=1e-12)


def test_a_weak_servo_rests_where_its_forces_balance():
    """Springs and servos against loads: K x = kp left u + load, as statics has it."""
    carts, u = Carts.random(3, 4), np.array([1e-3, -2e-3, 5e-4])
    left = np.array([1.0, 0.4, 1.0])
    stiffness = carts.springs + np.diag(left * carts.kp)
    at_rest = np.linalg.solve(stiffness, left * carts.kp * u + (left - 1) * carts.load)
    found = resting_displacements(carts.nominal(), [Fault(1, "weak", 0.4)], u)
    assert found is not None
    np.testing.assert_allclose(found, at_rest, rtol=1e-9)


def test_a_load_that_nothing_holds_does_not_rest():
    """A cart without spring and servo force falls for ever."""
    carts = replace(Carts.random(2, 4), springs=np.zeros((2, 2)))
    assert resting_displacements(carts.nominal(), [Fault(0, "free")], np.zeros(2)) is None
    assert resting_displacements(carts.nominal(), [Fault(0, "weak", 0.1)], np.zeros(2)) is not None


def test_failures_of_servos_are_weighed_as_newton_has_them():
    """Sums of squares of residuals against direct simulations, loads and onsets included."""
    n, onset = 3, 100
    carts, rng = Carts.random(n, 1), np.random.default_rng(0)
    nominal, sent = carts.nominal(), commands(n, 300, rng)
    y = carts.run(Fault(2, "weak", 0.45), onset, sent) / 2e-5 + rng.standard_normal((300, n))
    bank, prior = hypothesis_bank(nominal), Parameters.prior(0, n, CERTAIN)
    evidence = bank.start(np.array([onset]), prior, np.zeros((1, 2 * n)), np.zeros((1, 1, n)))
    before = np.zeros(n)
    for tick, u in enumerate(sent):
        v = np.concatenate([u, before, [1.0]])
        evidence = bank.step(evidence, sample_of(tick, v, y[tick]), 1.0, np.ones((1, n)))
        before = u
    for h, fault in enumerate(bank.faults, 1):
        left = y - carts.run(fault, onset, sent) / 2e-5
        assert evidence.energy[h, 0] == pytest.approx((left**2).sum(), rel=1e-6)
    verdict = verdict_of(bank, evidence, 299)
    assert (verdict.fault.actuator, verdict.fault.kind) == (2, "weak")
    assert verdict.fault.effectiveness == pytest.approx(0.45, abs=0.02)


def watched(nominal, sent, y):
    """All diagnoses, and the last state, of a monitor that goes on after each."""
    watch, named = monitor(nominal), []
    state = watch.start()
    for measured, u in zip(y, np.vstack([0 * sent[:1], sent[:-1]]), strict=True):
        state = watch.step(state, measured, u)
        if state.diagnosis is not None and (not named or named[-1] is not state.diagnosis):
            named.append(state.diagnosis)
        if state.diagnosis is not None and state.diagnosis.confirmed:
            watch, state = watch.believing(state)
    return named, state


SEEDS = [0, *(pytest.param(seed, marks=pytest.mark.long) for seed in range(1, 8))]


@failures
@pytest.mark.parametrize("seed", SEEDS)
def test_a_failed_servo_is_named_in_a_machine_that_is_not_the_model(seed, kind):
    """Masses, springs and servos wrong by some percent, two to five of them loaded.

    Up to the confirmation: in one of these 24 machines, a sound servo is named after it, because
    the springs on which a free cart is left are known as little.
    """
    n = 2 + seed % 4
    carts, rng = Carts.random(n, seed), np.random.default_rng(seed)
    wrong = {
        name: getattr(carts, name) * (1 + 0.02 * rng.standard_normal(n))
        for name in ("mass", "kp", "kv")
    }
    plant = replace(carts, springs=carts.springs * (1 + 0.02 * rng.standard_normal()), **wrong)
    fault = Fault(int(rng.integers(n)), kind, rng.uniform(0.2, 0.7) * (kind == "weak"))
    sent = commands(n, 900, rng)
    y = plant.run(fault, 600, sent) + 2e-5 * rng.standard_normal((900, n))
    named, state = watched(carts.nominal(), sent, y)
    assert named and not state.unexplained
    first = named[: 1 + next((k for k, each in enumerate(named) if each.confirmed), len(named))]
    assert {each.fault.actuator for each in first} == {fault.actuator}
    assert kind in first[-1].kinds


@pytest.mark.parametrize(
    ("integrator", "eulerdamp", "damping", "kv", "implicit"),
    [
        ("Euler", "disable", 0.2, 1.0, False),
        ("Euler", "enable", 4.0, 0.0, True),
        ("implicitfast", "disable", 0.2, 1.0, True),
    ],
)
def test_dampers_are_stepped_as_the_integrator_steps_them(
    integrator, eulerdamp, damping, kv, implicit
):
    """A commanded jump of a sound plant, then of one without its servo, to 1 % of the motion."""
    plant = lifted(integrator, eulerdamp, damping, kv, timestep=1e-3)
    assert plant.implicit_damping == implicit
    linear, period_s = plant.linear(), 2e-3
    nominal = NominalModel(
        control.ss(linear.A, linear.B, linear.C_active, 0),
        linear.C_active,
        np.ones(2),
        period_s,
        float(plant.model.opt.timestep),
        linear.feedback,
        linear.holding,
        plant.implicit_damping,
    )
    x, command = np.zeros(len(linear.A)), np.array([2e-4, -1e-4])
    for model, ticks in ((fault_model(nominal), 8), (fault_model(nominal, [Fault(0, "free")]), 8)):
        for _ in range(ticks):
            plant.step(command, period_s)
            x = model.step(x, command)
            moved = plant.displacements()
            np.testing.assert_allclose(linear.C_active @ x, moved, atol=0.01 * np.abs(moved).max())
        plant.release(0)


@pytest.mark.long
@pytest.mark.parametrize("kind", ["locked", "free"])
@pytest.mark.parametrize("actuator", [0, 3, 6])
def test_a_failed_servo_of_a_simulated_arm_is_named(actuator, kind):
    """From encoders of 10 urad while each joint wanders by some 0.1 mrad, within 0.1 s."""
    plant, period_s, noise = servos("arm"), 1e-3, 1e-5
    linear, rng, onset = plant.linear(), np.random.default_rng(actuator), 900
    nominal = NominalModel(
        control.ss(linear.A, linear.B, linear.C_active, 0),
        linear.C_active,
        np.full(7, noise),
        period_s,
        float(plant.model.opt.timestep),
        linear.feedback,
        linear.holding,
        plant.implicit_damping,
    )
    sent = np.cumsum(2e-5 * rng.standard_normal((onset + 100, 7)), axis=0)
    y = []
    for tick, command in enumerate(sent):
        if tick == onset:
            Failure(actuator, kind).strike(plant)
        y.append(plant.displacements() + noise * rng.standard_normal(7))
        plant.step(command, period_s)
    named, state = watched(nominal, sent, y)
    assert state.alarm_ticks and state.alarm_ticks[0] > onset
    assert {each.fault.actuator for each in named} == {actuator}
    assert kind in named[-1].kinds
