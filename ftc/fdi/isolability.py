"""Which failures look alike, before any noise is drawn.

The separation d of a failure from another explanation is the distance of their outputs in standard
deviations of the noise, at the other's best time of onset and loss of force: d^2 / 2 is the
Kullback-Leibler divergence, and two explanations that far apart are mistaken for each other with
probability Phi(-d / 2) (Basseville and Nikiforov, Detection of Abrupt Changes, 1993, chapter 4).
"""

import numpy as np

from ftc.fdi.fault_model import KINDS, Fault
from ftc.fdi.hypotheses import Bank
from ftc.linear_loop import LinearLoop, flown
from sim import Array

_NEAR, _BACK, _STEP = 16, 1000, 8


def separations(
    loop: LinearLoop, bank: Bank, fault: Fault, onset: int, until: int
) -> tuple[Array, float]:
    """Distances d of one failure from all that the bank can think of, and from none.

    Onsets are tried at every tick around the true one, and at every eighth for a second before.

    Args:
        loop: What flies; its mapping is not told.
        bank: Of the sound machine, with the outputs that are measured.
        fault: What happens.
        onset: At which tick.
        until: Evidence is collected up to this tick.

    Returns:
        (6, 3) by strut and kind as :data:`KINDS`; the failure itself has 0. And the distance from
        soundness.
    """
    states, sent = flown(loop, [fault], onset)
    near = np.arange(max(0, onset - _NEAR), min(until, onset + _NEAR))
    evidence = bank.start(np.union1d(near, np.arange(max(0, onset - _BACK), until, _STEP)))
    x = np.zeros(len(bank.believed.A))
    last = np.zeros(sent.shape[1])
    for tick in range(until):
        x = bank.believed.step(x, last)
        if tick >= evidence.onsets[0]:
            evidence = bank.step(evidence, tick, x, last, bank.C @ states[tick])
        last = sent[tick]
    ratios = evidence.best_log_likelihood_ratios().max(axis=-1)
    own = ratios[fault.strut, KINDS.index(fault.kind)]
    return np.sqrt(2 * np.maximum(own - ratios, 0)), float(np.sqrt(2 * max(own, 0)))
