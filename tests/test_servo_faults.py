"""Faults of position servos: their models, and their diagnosis, against direct simulations."""

from dataclasses import dataclass

import control
import numpy as np
import pytest

from ftc.fdi.diagnosis import FdiConfig
from ftc.fdi.fault_model import KINDS, Fault, NominalModel, fault_model
from ftc.fdi.hypotheses import hypothesis_bank
from ftc.fdi.monitor import monitor
from sim import Failure
from tests.test_released import lifted, servos

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


def test_failures_of_servos_are_weighed_as_newton_has_them():
    """Log likelihood ratios against direct simulations: locked and free to rounding, weak nearly.

    A servo with 0.45 of its force left is in the middle between two models of the bank.
    """
    n, onset, truth = 3, 100, 0.45
    carts, rng = Carts.random(n, 1), np.random.default_rng(0)
    nominal, sent = carts.nominal(), commands(n, 300, rng)
    y = carts.run(Fault(2, "weak", truth), onset, sent) / 2e-5 + rng.standard_normal((300, n))
    bank = hypothesis_bank(nominal)
    evidence, x = bank.start(np.array([onset])), np.zeros(2 * n)
    for tick in range(300):
        u = sent[tick - 1] if tick else np.zeros(n)
        x = bank.believed.step(x, u)
        evidence = bank.step(evidence, tick, x, u, y[tick])
    sound = carts.run(Fault(0, "weak", 1.0), onset, sent)

    def ratio(fault: Fault) -> float:
        failed = carts.run(fault, onset, sent)
        return float((((y - sound / 2e-5) ** 2) - ((y - failed / 2e-5) ** 2)).sum() / 2)

    found = evidence.best_log_likelihood_ratios()[:, :, 0]
    for k in range(n):
        assert found[k, 0] == pytest.approx(ratio(Fault(k, "locked")), rel=1e-6)
        assert found[k, 1] == pytest.approx(ratio(Fault(k, "free")), rel=1e-6)
    assert evidence.likely_parts()[2, 0] == pytest.approx(1 - truth, abs=0.01)
    assert found[2, 2] == pytest.approx(ratio(Fault(2, "weak", truth)), rel=0.01)
    verdict = bank.verdict(evidence, 299, x)
    assert (verdict.fault.actuator, verdict.fault.kind) == (2, "weak")


@pytest.mark.long
@failures
def test_failed_servos_are_named(kind):
    """Actuator and kind in at least 7 of 8 random machines of two to five loaded servos.

    And the part that a weak one has left, to 5 %: the state between two models is interpolated,
    which may leave residuals for a further alarm that corrects it.
    """
    config, right = FdiConfig(look_back_s=0.3, confirmation_s=0.2), 0
    for seed in range(8):
        n = 2 + seed % 4
        carts, rng = Carts.random(n, seed), np.random.default_rng(seed)
        effectiveness = rng.uniform(0.2, 0.7) * (kind == "weak")
        fault = Fault(int(rng.integers(n)), kind, effectiveness)
        sent = commands(n, 400, rng)
        y = carts.run(fault, 150, sent) + 2e-5 * rng.standard_normal((400, n))
        watch = monitor(carts.nominal(), config=config)
        state = watch.start()
        for measured, u in zip(y, np.vstack([np.zeros(n), sent[:-1]]), strict=True):
            state = watch.step(state, measured, u)
            if state.diagnosis is not None and state.diagnosis.confirmed:
                watch, state = watch.believing(state)
        found = watch.faults
        right += (
            [(each.actuator, each.kind) for each in found] == [(fault.actuator, kind)]
            and abs(found[0].effectiveness - effectiveness) < 0.05
            and not state.unexplained
            and (kind == "weak" or len(state.alarm_ticks) == 1)
        )
    assert right >= 7


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


@pytest.mark.parametrize("kind", ["locked", "free"])
@pytest.mark.parametrize("actuator", [0, 3, 6])
def test_a_failed_servo_of_a_simulated_arm_is_named(actuator, kind):
    """From encoders of 10 urad while each joint wanders by some 0.1 mrad, within 60 ms."""
    plant, period_s, noise = servos("arm"), 1e-3, 1e-5
    linear, rng, onset = plant.linear(), np.random.default_rng(actuator), 100
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
    watch = monitor(nominal)
    state, before = watch.start(), np.zeros(7)
    for tick in range(onset + 60):
        if tick == onset:
            Failure(actuator, kind).strike(plant)
        y = plant.displacements() + noise * rng.standard_normal(7)
        state = watch.step(state, y, before)
        before = before + 2e-5 * rng.standard_normal(7)
        plant.step(before, period_s)
    assert state.alarm_ticks and state.alarm_ticks[0] > onset
    assert state.diagnosis is not None and not state.unexplained
    assert (state.diagnosis.fault.actuator, state.diagnosis.fault.kind) == (actuator, kind)
