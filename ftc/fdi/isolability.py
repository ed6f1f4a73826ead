"""Distances between failures in the linear model, without simulated noise.

The distance d of a failure from another explanation is that of their outputs in standard deviations
of the noise, at the other's best time of onset and loss of force: d^2 / 2 is the Kullback-Leibler
divergence, and two explanations that far apart are mistaken for each other with probability
Phi(-d / 2) (Basseville and Nikiforov, Detection of Abrupt Changes, 1993, chapter 4).
"""

import numpy as np

from argument_checks import Array
from ftc.fdi.fault_model import KINDS, Fault
from ftc.fdi.hypotheses import HypothesisBank

_NEAR, _BACK, _STEP = 16, 1000, 8


def isolability(
    bank: HypothesisBank, fault: Fault, onset: int, states: Array, commanded: Array
) -> tuple[Array, float]:
    """Distances d of one failure from all hypotheses, and from no failure.

    Onsets are tried at every tick around the true one, and at every eighth of the 1000 before.

    Args:
        bank: Of the fault-free plant, with all n actuators.
        fault: What happens.
        onset: At which tick.
        states: Of the plant in which it happens, without noise, shape (N, s): N ticks of evidence.
        commanded: Displacements from each tick on, shape (N, n).

    Returns:
        Distances by actuator and kind as :data:`KINDS`, shape (n, 3); the failure itself has 0. And
        the distance from no failure.
    """
    until = len(states)
    near = np.arange(max(0, onset - _NEAR), min(until, onset + _NEAR))
    evidence = bank.start(np.union1d(near, np.arange(max(0, onset - _BACK), until, _STEP)))
    expected = bank.believed.states(commanded)
    for tick in range(evidence.onsets[0], until):
        before = commanded[tick - 1] if tick else np.zeros(commanded.shape[1])
        y = bank.believed.C @ states[tick]
        evidence = bank.step(evidence, tick, expected[tick], before, y)
    ratios = evidence.best_log_likelihood_ratios().max(axis=-1)
    own = ratios[fault.actuator, KINDS.index(fault.kind)]
    return np.sqrt(2 * np.maximum(own - ratios, 0)), float(np.sqrt(2 * max(own, 0)))
