"""Carts on springs and on servos: linear models and simulated runs for the diagnosis."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import control
import numpy as np

from ftc.fdi import Fault, NominalModel, fault_model
from ftc.fdi.bank import Evidence, HypothesisBank
from ftc.fdi.fault_model import FaultModel
from ftc.fdi.monitor import Monitor, MonitorState
from ftc.fdi.observer import Sample

SAMPLES, ONSETS = 14, np.array([3, 6, 9])


@cache
def carts(seed: int, n: int = 2, noise: float = 1e-3) -> NominalModel:
    """Return carts on springs of a few hertz, their positions mixed by as many sensors."""
    rng = np.random.default_rng(seed)
    mass, coupling = rng.uniform(1, 2, n), rng.normal(size=(n, n))
    stiffness = 900 * np.eye(n) + 50 * coupling @ coupling.T
    lower = -np.hstack([stiffness, 0.02 * stiffness]) / mass[:, None]
    B = np.vstack([np.zeros((n, n)), np.diag(900 / mass)])
    positions = np.eye(n, 2 * n)
    C = (np.eye(n) + 0.3 * rng.normal(size=(n, n))) @ positions
    plant = control.ss(np.vstack([np.eye(n, 2 * n, n), lower]), B, C, 0)
    return NominalModel(plant, positions, np.full(n, noise), period_s=5e-3, step_s=1e-3)


def outputs_of(model: FaultModel, commanded: np.ndarray) -> np.ndarray:
    """Return the whitened outputs (N, p) before each command (N, n) takes effect, from rest."""
    return np.array([model.C @ x for x in model.states(commanded)[:-1]])


def sample_of(number: int, v: np.ndarray, y: np.ndarray, *, is_complete: bool = True) -> Sample:
    """Return a sample without the state before it."""
    return Sample(number, v, y, is_complete, before=None)  # type: ignore[arg-type]


Signal = Callable[[int, np.ndarray], np.ndarray]
"""Function of a tick and a signal (3,) that returns the changed signal."""


def unchanged(tick: int, signal: np.ndarray) -> np.ndarray:
    """Return the signal unchanged."""
    return signal


def simulate(
    fdi_monitor: Monitor,
    seed: int,
    ticks: int,
    *,
    fault: Fault | None = None,
    fails: int | None = None,
    act: Signal = unchanged,
    read: Signal = unchanged,
) -> list[MonitorState]:
    """Return the states of a monitor of three carts at each tick, up to a confirmation.

    Commands are random motions of 4 to 8 mm plus the dither; the fault occurs at tick `fails`.
    `act` changes the applied commands, `read` the readings in units of noise.
    """
    nominal, rng = fdi_monitor.nominal, np.random.default_rng(seed)
    plant = fault_model(nominal)
    phase, size = rng.uniform(0, 2 * np.pi, 3), rng.uniform(4e-3, 8e-3, 3)
    x, u, states = np.zeros(6), np.zeros(3), [fdi_monitor.start()]
    for tick in range(ticks):
        if fault is not None and tick == fails:
            plant = fault_model(nominal, [fault])
            x = plant.onset @ x
        y = read(tick, plant.C @ x) + rng.standard_normal(3)
        states.append(fdi_monitor.step(states[-1], nominal.noise * y, u))
        if (diagnosis := states[-1].diagnosis) is not None and diagnosis.confirmed:
            break
        time_s = tick * nominal.period_s
        u = size * np.sin(2.2 * time_s * np.array([1.0, 0.8, 1.3]) + phase)
        u = u + 2e-3 * np.sin(2 * np.pi * (fdi_monitor.config.dither_hz or 0.0) * time_s)
        x = plant.step(x, act(tick, u))
    return states


@dataclass(frozen=True)
class Record:
    """Commands (N, n) of samples and mean outputs (N, p) in units of their noise."""

    nominal: Any
    ticks: int
    u: np.ndarray
    y: np.ndarray

    @classmethod
    def of(
        cls,
        nominal,
        ticks,
        seed,
        fault=None,
        onset=ONSETS[1],
        samples=SAMPLES,
        size=1e-2,
        before=(),
    ):
        """Simulate a run with a fault in addition to those `before`, with random-walk commands."""
        rng = np.random.default_rng(seed)
        u = np.cumsum(size * rng.standard_normal((samples, nominal.actuators)), axis=0)
        y = outputs(nominal, ticks, u, fault, onset, before=before)
        return cls(nominal, ticks, u, y + rng.standard_normal(y.shape))


def outputs(
    nominal, ticks, u, fault=None, onset=0, displaced: np.ndarray | float = 0.0, late=0.0, before=()
):
    """Simulate a plant from rest tick by tick; return its means (N, p) over the samples.

    `displaced` (s,) is added to the state after the onset; `late` is the fraction of each sample in
    which the previous command applies.
    """
    model, x, means = fault_model(nominal, before), np.zeros(nominal.plant.nstates), []
    last = np.vstack([np.zeros_like(u[:1]), u[:-1]])
    for sample, command in enumerate(u - late * (u - last)):
        if fault is not None and sample == onset:
            model = fault_model(nominal, [fault])
            x = model.onset @ x
        over = []
        for _ in range(ticks):
            over.append(model.C @ x)
            x = model.A @ x + model.B @ command + model.drift
        x = x + (displaced if sample == onset else 0.0)
        means.append(np.mean(over, axis=0))
    return np.array(means)


def gathered(
    bank: HypothesisBank, record: Record, prior, whitening, onsets=ONSETS, decoupled=None
) -> Evidence:
    """Return the evidence of a run; without `decoupled`, the last hypothesis equals the first."""
    rows, s = bank.base_model.M.shape[:2]
    p = record.y.shape[1]
    memory = np.zeros((len(whitening), rows, p))
    memory[:, 0] -= prior.mean[-p:]  # the effect of the offset before is known
    evidence = bank.start(np.asarray(onsets), prior, np.zeros((rows, s)), memory)
    before = np.zeros(record.u.shape[1])
    for sample, (u, y) in enumerate(zip(record.u, record.y, strict=True)):
        v = np.concatenate([u, before, [1.0]])
        evidence = bank.step(evidence, sample_of(sample, v, y), 1.5, whitening, decoupled)
        before = u
    return evidence


@dataclass(frozen=True)
class Struts:
    """Body on n struts in a structure, each with spring, damper, and a coil or a loaded servo.

    The force of strut k at displacement d is
    gain (command_gain u - kp d - kv d') - spring d - damper d'; a coil has no kp and kv. All are
    (n,), except the mass, the strut directions `along` and the stiffness of the structure, (n, n).
    """

    mass: np.ndarray
    along: np.ndarray
    structure: np.ndarray
    command_gain: np.ndarray
    kp: np.ndarray
    kv: np.ndarray
    spring: np.ndarray
    damper: np.ndarray
    load: np.ndarray
    gain: np.ndarray | float = 1.0

    def nominal(self) -> NominalModel:
        """Return the linear model with positions measured to 20 um."""
        n, c, servo = len(self.mass), self.along, self.kp.any()
        push = np.linalg.solve(self.mass, c.T)
        K, D = self.spring + self.gain * self.kp, self.damper + self.gain * self.kv
        stiffness = push * K @ c + np.linalg.solve(self.mass, self.structure)
        A = np.block([[np.eye(n, 2 * n, n)], [-stiffness, -push * D @ c]])
        B = np.vstack([np.zeros((n, n)), push * (self.gain * self.command_gain)])
        fed_back = np.hstack([self.kp[:, None] * c, self.kv[:, None] * c])
        return NominalModel(
            control.ss(A, B, np.eye(n, 2 * n), 0),
            np.hstack([c, np.zeros((n, n))]),
            np.full(n, 2e-5),
            period_s=2e-3,
            step_s=1e-3,
            feedback=fed_back / self.command_gain[:, None] if servo else None,
            holding=self.load / (self.gain * self.command_gain) if servo else None,
        )

    def run(self, fault: Fault, onset: int, sent: np.ndarray) -> np.ndarray:
        """Simulate carts by Newton's law; return their positions (N, n) at each tick."""
        n, step_s, mass = len(self.mass), 1e-3, np.diag(self.mass)
        q, v, positions = np.zeros(n), np.zeros(n), []
        strength, moving = np.ones(n), np.ones(n)
        for tick, u in enumerate(sent):
            if tick == onset:
                if fault.kind == "locked":
                    moving[fault.actuator] = 0.0
                else:
                    strength[fault.actuator] = fault.effectiveness
                v = v * moving
            positions.append(q)
            for _ in range(2):
                servo = strength * (self.kp * (u - q) - self.kv * v + self.load)
                v = v + step_s * moving * (servo - self.load - self.structure @ q) / mass
                q = q + step_s * v
        return np.array(positions)


def servo_carts(n: int, seed: int) -> Struts:
    """Return loaded carts on servos of 3 to 6 Hz, between springs a fifth as stiff."""
    rng = np.random.default_rng(seed)
    mass, coupling = rng.uniform(1, 2, n), rng.normal(size=(n, n))
    kp, none = rng.uniform(400, 1500, n), np.zeros(n)
    springs, load = 40 * np.eye(n) + 30 * coupling @ coupling.T, rng.uniform(0.5, 2, n)
    return Struts(np.diag(mass), np.eye(n), springs, kp, kp, 0.03 * kp, none, none, load)


def carts_with_friction(seed: int, limit: float | list[float] = 0.05, n: int = 3) -> NominalModel:
    """Return carts on servos with dry friction on their rails and between neighbours."""
    plant, rows = servo_carts(n, seed), np.eye(n) - 0.3 * np.roll(np.eye(n), 1, axis=1)
    push, limits = np.linalg.solve(plant.mass, rows.T), np.broadcast_to(limit, n).astype(float)
    friction = push, rows, limits, np.diag(rows @ push) / 9, np.full(n, 105.0)
    return replace(plant.nominal(), friction=friction)


def random_walk(n: int, ticks: int, rng: np.random.Generator) -> np.ndarray:
    """Return random-walk commands (ticks, n) of some millimetres."""
    return np.cumsum(2e-4 * rng.standard_normal((ticks, n)), axis=0)
