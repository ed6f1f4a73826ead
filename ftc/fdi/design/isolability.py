"""Distances between failures in the linear model, without simulated noise.

The distance d of a failure from another explanation is that of their outputs in standard deviations
of the noise, at the other's best time of onset, loss of force and errors of the model: d^2 / 2 is
the Kullback-Leibler divergence, and two explanations that far apart are mistaken for each other
with probability Phi(-d / 2) (Basseville and Nikiforov, Detection of Abrupt Changes, 1993, ch. 4).
"""

import numpy as np

from argument_checks import Array
from ftc.fdi.detection.parameter_filter import Parameters
from ftc.fdi.fault_model import KINDS, Fault, NominalModel, fault_model
from ftc.fdi.isolation.bank import HypothesisBank
from ftc.fdi.isolation.causes import Cause
from ftc.fdi.isolation.hypotheses import hypothesis_bank
from ftc.fdi.uncertainty import CERTAIN, Uncertainty

_NEAR, _BACK, _STEP = 4, 60, 5


def isolability(
    nominal: NominalModel,
    fault: Fault,
    onset: int,
    states: Array,
    commanded: Array,
    uncertainty: Uncertainty = CERTAIN,
    ticks: int = 4,
) -> tuple[Array, float]:
    """Distances d of one failure from all hypotheses, and from no failure.

    Onsets are tried at every sample around the true one, and at every fifth of the 60 before.

    Args:
        nominal: The plant without faults.
        fault: What happens.
        onset: At which tick, a multiple of `ticks`.
        states: Of the plant in which it happens, without noise, shape (N, s): N ticks of evidence.
        commanded: Displacements from each tick on, shape (N, n).
        uncertainty: Of the model; what the motion before the onset shows of it is made use of.
        ticks: Of a sample.

    Returns:
        Distances by actuator and kind as :data:`KINDS`, shape (n, 3); the failure itself has 0. And
        the distance from no failure.
    """
    bank = hypothesis_bank(nominal, (), uncertainty.of_model, ticks)
    outputs = states @ fault_model(nominal).C.T
    return distances(bank, fault, onset, outputs, commanded, uncertainty, ticks)


def distances(
    bank: HypothesisBank,
    truth: Fault | Cause,
    onset: int,
    outputs: Array,
    commanded: Array,
    uncertainty: Uncertainty = CERTAIN,
    ticks: int = 1,
) -> tuple[Array, float]:
    """The same of a plant of any kind, from rest, without known faults.

    Args:
        bank: Hypotheses about the plant, made with this uncertainty and for samples of these ticks.
        truth: What happens, a failure or a cause that the bank has.
        onset: Likewise.
        outputs: Of the plant in which it happens, in units of their noise, but without noise, shape
            (N, p).
        commanded: As of :func:`isolability`.
        uncertainty: Likewise.
        ticks: Likewise.

    Returns:
        Likewise, of the nearest failures.
    """
    rows, p, s = bank.believed.N.shape[0], *bank.believed.C.shape
    until, first = len(outputs) // ticks, onset // ticks
    near = np.arange(max(0, first - _NEAR), min(until, first + _NEAR))
    onsets = np.union1d(near, np.arange(max(0, first - _BACK), until, _STEP)).astype(int)
    prior = Parameters.prior(rows - 1, p, uncertainty)
    evidence = bank.start(onsets, prior, np.zeros((rows, s)), np.zeros((1, rows, p)))
    y, u = (
        part[: until * ticks].reshape(until, ticks, -1).mean(axis=1)
        for part in (outputs, commanded)
    )
    before = np.vstack([np.zeros_like(u[:1]), u[:-1]])
    for sample in range(until):
        v = np.concatenate([u[sample], before[sample], [1.0]])
        white = np.full((1, p), np.sqrt(ticks))
        evidence = bank.step(evidence, sample, v, y[sample], white, shaken=0.0)
    energy = evidence.marginal()[0]
    others = np.full((len(bank.effectiveness), len(KINDS)), np.inf)
    best = energy[1:-1].min(axis=1)
    for other, least in zip(bank.faults, best[: len(bank.faults)], strict=True):
        place = other.actuator, KINDS.index(other.kind)
        others[place] = min(others[place], least)
    if isinstance(truth, Cause):
        own = best[len(bank.faults) + bank.causes.index(truth)]
    else:
        own = others[truth.actuator, KINDS.index(truth.kind)]
    return np.sqrt(np.maximum(others - own, 0)), float(np.sqrt(max(energy[0, 0] - own, 0)))
