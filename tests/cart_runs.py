"""Runs of carts on springs, as a bank of hypotheses sees them."""

from dataclasses import dataclass

import control
import numpy as np

from ftc.fdi import NominalModel, fault_model
from ftc.fdi.bank import Evidence, HypothesisBank

SAMPLES, ONSETS = 14, np.array([3, 6, 9])


def carts(seed: int, n: int = 2, noise: float = 1e-3) -> NominalModel:
    """Carts on springs of a few hertz, their positions mixed by as many sensors."""
    rng = np.random.default_rng(seed)
    mass, coupling = rng.uniform(1, 2, n), rng.normal(size=(n, n))
    stiffness = 900 * np.eye(n) + 50 * coupling @ coupling.T
    lower = -np.hstack([stiffness, 0.02 * stiffness]) / mass[:, None]
    B = np.vstack([np.zeros((n, n)), np.diag(900 / mass)])
    shown = np.eye(n, 2 * n)
    C = (np.eye(n) + 0.3 * rng.normal(size=(n, n))) @ shown
    plant = control.ss(np.vstack([np.eye(n, 2 * n, n), lower]), B, C, 0)
    return NominalModel(plant, shown, np.full(n, noise), period_s=5e-3, step_s=1e-3)


@dataclass(frozen=True)
class Record:
    """Commands (N, n) of samples and mean outputs (N, p) in units of their noise."""

    nominal: NominalModel
    ticks: int
    u: np.ndarray
    y: np.ndarray

    @classmethod
    def of(cls, nominal, ticks, seed, fault=None, onset=ONSETS[1], samples=SAMPLES, size=1e-2):
        """A run with that fault, from commands that wander."""
        rng = np.random.default_rng(seed)
        u = np.cumsum(size * rng.standard_normal((samples, nominal.actuators)), axis=0)
        y = outputs(nominal, ticks, u, fault, onset)
        return cls(nominal, ticks, u, y + rng.standard_normal(y.shape))


def outputs(nominal, ticks, u, fault=None, onset=0, nudged: np.ndarray | float = 0.0, late=0.0):
    """Means (N, p) over the samples of a plant from rest, tick by tick.

    `nudged` (s,) moves the state at the end of the sample of onset; `late` is the part of each
    sample in which the command before still holds.
    """
    model, x, seen = fault_model(nominal), np.zeros(nominal.plant.nstates), []
    before = np.vstack([np.zeros_like(u[:1]), u[:-1]])
    for sample, command in enumerate(u - late * (u - before)):
        if fault is not None and sample == onset:
            model = fault_model(nominal, [fault])
            x = model.onset @ x
        over = []
        for _ in range(ticks):
            over.append(model.C @ x)
            x = model.A @ x + model.B @ command + model.drift
        x = x + (nudged if sample == onset else 0.0)
        seen.append(np.mean(over, axis=0))
    return np.array(seen)


def gathered(
    bank: HypothesisBank, record: Record, prior, whitening, onsets=ONSETS, decoupled=None
) -> Evidence:
    """The evidence of a run; without another filter for it, the last hypothesis is the first."""
    rows, s = bank.believed.M.shape[:2]
    p = record.y.shape[1]
    memory = np.zeros((len(whitening), rows, p))
    memory[:, 0] -= prior.mean[-p:]  # what the offset has done before is known
    evidence = bank.start(np.asarray(onsets), prior, np.zeros((rows, s)), memory)
    before = np.zeros(record.u.shape[1])
    for sample, (u, y) in enumerate(zip(record.u, record.y, strict=True)):
        v = np.concatenate([u, before, [1.0]])
        evidence = bank.step(evidence, sample, v, y, whitening, 1.5, decoupled=decoupled)
        before = u
    return evidence
