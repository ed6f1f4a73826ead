"""What the evidence says: which actuator has failed, how, since when; and how likely that is."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from argument_checks import Array
from argument_checks.ties import greatest
from ftc.fdi.fault_model import KINDS, Fault
from ftc.fdi.isolation.causes import Cause
from ftc.fdi.isolation.evidence import EXTRA, LEAST_LOST, PART_SPREAD, Evidence

_log_sum = np.logaddexp.reduce
"""Log of a sum of exponentials; scipy's takes twenty times as long, a dozen times a verdict."""

_ALIKE = 1e-6
"""Log likelihoods that differ by less are of hypotheses that nothing distinguishes."""


@dataclass(frozen=True)
class Verdict:
    """Probabilities of the hypotheses.

    Attributes:
        fault: The most likely one.
        actuator_confidence: Probability that it is this actuator, whatever its kind; the rest is
            that of other actuators, and of no failure at all.
        kind_confidences: Probability of each of :data:`ftc.fdi.fault_model.KINDS`, given the
            actuator.
        fault_free_confidence: Probability that nothing has failed, whatever else acts on the
            machine.
        cause: The most likely of what acts then; None is nothing, or something slow.
        inflation: Variance of the residuals that the most likely fault leaves, over that expected;
            at least 1. All log likelihoods are divided by it.
        unexplained: Part of the energy against no failure that this fault leaves, above noise.
        energy: Of the residuals that this fault leaves, parameters fitted.
        strain: Distance of these parameters of the plant from what is known of them, in standard
            deviations of the uncertain model.
        onset: Most likely sample.
        x: State of the plant now, if it is so, shape (s,).
        best: Log likelihood ratio of the best hypothesis with each onset, shape (K,).
    """

    fault: Fault
    actuator_confidence: float
    kind_confidences: tuple[float, ...]
    fault_free_confidence: float
    cause: Cause | None
    inflation: float
    unexplained: float
    energy: float
    strain: float
    onset: int
    x: Array
    best: Array


def verdict(
    state: Evidence,
    sample: int,
    faults: Sequence[Fault],
    causes: Sequence[Cause],
    effectiveness: Array,
    *,
    disturbed: bool = True,
) -> Verdict:
    """Probabilities of the hypotheses; a priori, failure and no failure are equally likely.

    So are, of no failure, nothing at all, each kind of cause, and something else that acts slowly.

    Args:
        state: The evidence.
        sample: The last one that it is of.
        faults: Of the hypotheses 1..F, in the order of a bank.
        causes: Of those from F + 1 to H - 2.
        effectiveness: That actuators are believed to have, shape (n,).
        disturbed: Whether something else, slow, may act on a sound machine.
    """
    energy, log_det, parameters = state.marginal()
    plain = -energy / 2 - log_det
    ratios = plain[1:-1] - plain[0, 0]
    h, k = _first_of_the_best(ratios)
    p = state.memory.shape[-1]
    after = max(sample - int(state.onsets[k]) + 1, 1)
    excess = max(float(energy[1 + h, k]) - state.samples * p, 0.0)
    inflation = 1 + excess / (after * p)
    by_hypothesis = _log_sum(ratios / inflation, axis=-1)
    by_fault, by_cause = np.split(by_hypothesis, [len(faults)])
    ratios = ratios[: len(faults)] / inflation
    numbers = np.array([fault.actuator for fault in faults])
    candidates = np.unique(numbers)
    actuators = np.array([_log_sum(by_fault[numbers == k]) for k in candidates])
    slow = (float(plain[-1, 0] - plain[0, 0]) + state.gain) / inflation if disturbed else None
    nothing, cause = _no_failure(by_cause - np.log(ratios.shape[1]), causes, slow)
    nothing += np.log(ratios.size)
    total = np.logaddexp(_log_sum(actuators), nothing)
    a = greatest(actuators, zero=_ALIKE)
    own = np.flatnonzero(numbers == candidates[a])
    i, k = _first_of_the_best(ratios[own])
    h = 1 + int(own[i])
    of_kind = np.array([faults[each].kind for each in own.tolist()])
    kinds = [np.exp(by_fault[own[of_kind == kind]] - actuators[a]).sum() for kind in KINDS]
    gained = float(energy[0, 0] - energy[h, k])
    noise = 4 * np.sqrt(2 * state.samples * p)
    return Verdict(
        fault=_with_part(faults[h - 1], effectiveness, float(parameters[h, k, -1])),
        actuator_confidence=float(np.exp(actuators[a] - total)),
        kind_confidences=tuple(float(each) for each in kinds),
        fault_free_confidence=float(np.exp(nothing - total)),
        cause=cause,
        inflation=inflation,
        unexplained=max(excess - noise, 0.0) / max(gained + excess, 1e-12),
        energy=float(energy[h, k]),
        strain=float(np.linalg.norm(parameters[h, k, : -EXTRA - p])),
        onset=int(state.onsets[k]),
        x=_state(state, h, k, parameters[h, k]),
        best=ratios.max(axis=0),
    )


def _no_failure(
    by_cause: Array, causes: Sequence[Cause], slow: float | None
) -> tuple[float, Cause | None]:
    """Log likelihood ratio that nothing has failed, over its cases; and the likeliest of causes.

    Args:
        by_cause: Of each cause, the same over its onsets.
        causes: They.
        slow: That of something else, slow; None: it is out of question.
    """
    cases = {"nothing": 0.0} if slow is None else {"nothing": 0.0, "slow": slow}
    for kind in {each.kind: None for each in causes}:
        own = [by_cause[k] for k, each in enumerate(causes) if each.kind == kind]
        cases[kind] = float(_log_sum(own) - np.log(len(own)))
    likeliest = list(cases)[greatest(list(cases.values()), zero=_ALIKE)]
    own = [k for k, each in enumerate(causes) if each.kind == likeliest]
    cause = causes[own[greatest(by_cause[own], zero=_ALIKE)]] if own else None
    return float(_log_sum(list(cases.values())) - np.log(len(cases))), cause


def _first_of_the_best(ratios: Array) -> tuple[int, int]:
    """Hypothesis and onset of the greatest log likelihood."""
    h, k = divmod(greatest(ratios.ravel(), zero=_ALIKE), ratios.shape[1])
    return h, k


def _with_part(fault: Fault, effectiveness: Array, deviation: float) -> Fault:
    """With what a weak one has left, by how many standard deviations more it lost than modelled."""
    if fault.kind != "weak" or fault.is_sound:
        return fault
    part = 1 - fault.effectiveness / effectiveness[fault.actuator]
    part = float(np.clip(part + PART_SPREAD * deviation, LEAST_LOST, 1 - LEAST_LOST))
    return replace(fault, effectiveness=float(effectiveness[fault.actuator]) * (1 - part))


def _state(state: Evidence, h: int, k: int, parameters: Array) -> Array:
    """Of the plant now (s,), by one hypothesis and onset with its parameters (R,)."""
    X, own = state.X[h, k], EXTRA - 1
    J = len(X) - 1 - own
    errors = state.prior.mean[:J] + parameters[:J]
    return X[0] + errors @ X[1:-own] + parameters[-EXTRA:-1] @ X[-own:]
