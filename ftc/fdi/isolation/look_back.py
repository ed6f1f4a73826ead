"""The evidence of what has been seen before an alarm."""

from collections.abc import Sequence

import numpy as np

from ftc.fdi.detection.watch import Moment, Watch, WatchState
from ftc.fdi.isolation.bank import HypothesisBank
from ftc.fdi.isolation.evidence import Evidence


def looked_back(
    bank: HypothesisBank, watch: Watch, state: WatchState, history: Sequence[Moment], reach: int
) -> Evidence:
    """The evidence in the history, for onsets at growing distances before the last sample.

    Args:
        bank: The hypotheses.
        watch: Of the machine as it is believed to be.
        state: Of it now.
        history: What was seen, the newest last.
        reach: So many samples back, at most.
    """
    now, config = history[-1].sample, watch.config
    distances, distance = [0], 1
    while distance <= min(now - history[0].sample, reach):
        distances.append(distance)
        distance = max(distance + 1, round(distance * config.onset_growth))
    onsets = now - np.array(distances[::-1])
    past = [each for each in history if each.sample >= onsets[0]]
    first, p = past[0], len(state.residual)
    prior = first.parameters.drifted(config.look_back_s, p, config.uncertainty, watch.model.limits)
    memory = first.memory.copy()
    memory[:, 0] -= np.einsum("j,qjp->qp", prior.mean[:-p], memory[:, 1:]) + prior.mean[-p:]
    evidence = bank.start(onsets, prior, first.X, memory)
    for each in past:  # of arrays that nobody else has
        evidence = weighed(bank, evidence, each, state, keeps=False)
    return evidence


def weighed(
    bank: HypothesisBank,
    evidence: Evidence,
    moment: Moment,
    state: WatchState,
    *,
    keeps: bool = True,
) -> Evidence:
    """The evidence with one more sample, by the filters of the watch now; `keeps` as in a step."""
    return bank.step(
        evidence,
        moment.sample,
        moment.v,
        moment.y,
        state.whitening,
        state.shaken,
        decoupled=state.decoupled,
        weighs=moment.is_whole,
        keeps=keeps,
    )
