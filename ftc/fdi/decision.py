"""Verdict: what the evidence says, and from when on that is certain enough."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from argument_checks import Array
from argument_checks.ties import greatest
from ftc.fdi.bank import EXTRA, LEAST_LOST, PART_SPREAD, Cause, Evidence, HypothesisBank
from ftc.fdi.fault_model import KINDS, Fault

LARGEST_INFLATION = 30.0
"""A failure fits if the variance of the residuals since its onset is at most so many times that of
before: what shakes a machine reaches its sensors another way after a failure. Measured on the
hexapod: up to 15, and 25 with all mismatches three times as large."""

MODEL_ERROR = 0.01
"""It also fits if it leaves at most this part of the energy that the residuals have without it,
above noise: a tenth of their size, squared, which a linear model misses of the largest failures."""

LARGEST_PARAMETER_DEVIATION = 20.0
"""It never fits if the parameters of the plant must be further than this, in standard deviations,
from what is known of them: what moves a servo by some other cause is explained by a damper of a
hundred times its uncertainty, too."""

LARGEST_UNEXPLAINED = 0.3
"""An actuator is first named only if its failure leaves at most this part of the energy: the square
of the relative error of a model that is expected while onset and part lost are hardly known."""

WITHDRAWAL_UNEXPLAINED = 0.8
"""A name is withdrawn once its failure leaves four times the energy that it explains."""

RESTART_S = 0.2
"""So long no failure fits the residuals before evidence begins anew: what has happened before, such
as a bump, is left behind, and a lock 0.4 s after it is found."""

EFFECTIVENESS_STEP = 0.1
"""A diagnosed effectiveness is revised when it has changed by this much: less than the quarters
between the models of the bank, more than its estimate wanders."""

CONFIDENCE = 0.999
"""An actuator is named when it is this likely; an alarm dismissed when it is this likely that
nothing has failed: one of a thousand names may be wrong."""

LOOK_BACK_S = 1.0
"""How far onsets are looked for, and how long an alarm may stay unexplained: twice the longest mean
that is tested, so that what has raised an alarm began within."""

CONFIRMATION_S = 1.0
"""How long a diagnosis may be revised, and one that is given back must have worked: as long as is
looked back."""

_NOISE = 4.0
"""Energy counts as above noise from so many standard deviations of its chi-square on."""

_TIE = 1e-6
"""Log likelihoods that differ by less are of hypotheses that nothing distinguishes: round-off."""

_log_sum = np.logaddexp.reduce


@dataclass(frozen=True)
class Decision:
    """Probabilities of the hypotheses.

    Attributes:
        fault: The most likely one.
        actuator_confidence: Probability that it is this actuator, whatever its kind; the rest is
            that of other actuators, and of no failure at all.
        kind_confidences: Of each of :data:`ftc.fdi.fault_model.KINDS`, given the actuator.
        fault_free_confidence: Probability that nothing has failed, whatever else acts.
        cause: The most likely of what acts then; None is nothing, or something slow.
        inflation: Variance of the residuals that this fault leaves, over that expected; at least 1.
            All log likelihoods are divided by it.
        unexplained: Part of the energy against no failure that this fault leaves, above noise.
        energy: Of the residuals that this fault leaves, parameters fitted.
        strain: Distance of these parameters of the plant from what is known of them, in standard
            deviations.
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
    parameter_deviation: float
    onset: int
    x: Array
    best: Array

    @property
    def fits(self) -> bool:
        """Whether what the most likely failure leaves is noise, of a plant that there may be."""
        small = self.inflation <= LARGEST_INFLATION or self.unexplained <= MODEL_ERROR
        return small and self.parameter_deviation <= LARGEST_PARAMETER_DEVIATION

    def revises(self, diagnosed: Fault) -> bool:
        """Whether another actuator or kind is certain by now, or another effectiveness."""
        if self.fault.actuator != diagnosed.actuator:
            return True
        if self.fault.kind != diagnosed.kind:
            return max(self.kind_confidences) >= CONFIDENCE
        return abs(self.fault.effectiveness - diagnosed.effectiveness) > EFFECTIVENESS_STEP


def decide(
    bank: HypothesisBank, evidence: Evidence, sample: int, *, disturbed: bool = True
) -> Decision:
    """Weigh the hypotheses after this sample; a priori, failure and no failure are equally likely.

    So are, of no failure, nothing at all, each kind of cause, and, if `disturbed`, something else
    that acts slowly.
    """
    faults = bank.faults
    energy, log_det, parameters = evidence.marginal()
    plain = -energy / 2 - log_det
    ratios = plain[1:-1] - plain[0, 0]
    h, k = divmod(greatest(ratios.ravel(), zero=_TIE), ratios.shape[1])
    p = evidence.memory.shape[-1]
    after = max(sample - int(evidence.onsets[k]) + 1, 1)
    excess = max(float(energy[1 + h, k]) - evidence.samples * p, 0.0)
    inflation = 1 + excess / (after * p)
    by_fault, by_cause = np.split(_log_sum(ratios / inflation, axis=-1), [len(faults)])
    ratios = ratios[: len(faults)] / inflation
    numbers = np.array([fault.actuator for fault in faults])
    candidates = np.unique(numbers)
    actuators = np.array([_log_sum(by_fault[numbers == k]) for k in candidates])
    slow = (float(plain[-1, 0] - plain[0, 0]) + evidence.gain) / inflation if disturbed else None
    no_failure, cause = _no_failure(by_cause - np.log(ratios.shape[1]), bank.causes, slow)
    no_failure += np.log(ratios.size)
    total = np.logaddexp(_log_sum(actuators), no_failure)
    a = greatest(actuators, zero=_TIE)
    members = np.flatnonzero(numbers == candidates[a])
    i, k = divmod(greatest(ratios[members].ravel(), zero=_TIE), ratios.shape[1])
    h = 1 + int(members[i])
    of_kind = np.array([faults[item].kind for item in members.tolist()])
    kinds = [np.exp(by_fault[members[of_kind == kind]] - actuators[a]).sum() for kind in KINDS]
    gained = float(energy[0, 0] - energy[h, k])
    noise = _NOISE * np.sqrt(2 * evidence.samples * p)
    return Decision(
        fault=_with_part(faults[h - 1], bank.effectiveness, float(parameters[h, k, -1])),
        actuator_confidence=float(np.exp(actuators[a] - total)),
        kind_confidences=tuple(float(item) for item in kinds),
        fault_free_confidence=float(np.exp(no_failure - total)),
        cause=cause,
        inflation=inflation,
        unexplained=max(excess - noise, 0.0) / max(gained + excess, 1e-12),
        energy=float(energy[h, k]),
        parameter_deviation=float(np.linalg.norm(parameters[h, k, : -EXTRA - p])),
        onset=int(evidence.onsets[k]),
        x=_state(evidence, h, k, parameters[h, k]),
        best=ratios.max(axis=0),
    )


def _no_failure(
    by_cause: Array, causes: Sequence[Cause], slow: float | None
) -> tuple[float, Cause | None]:
    """Log likelihood ratio that nothing has failed, over its cases; and the likeliest of causes.

    By that of each cause over its onsets, and that of something slow, unless it is out of question.
    """
    cases = {"nothing": 0.0} if slow is None else {"nothing": 0.0, "slow": slow}
    for kind in {item.kind: None for item in causes}:
        members = [by_cause[k] for k, item in enumerate(causes) if item.kind == kind]
        cases[kind] = float(_log_sum(members) - np.log(len(members)))
    likeliest = list(cases)[greatest(list(cases.values()), zero=_TIE)]
    members = [k for k, item in enumerate(causes) if item.kind == likeliest]
    cause = causes[members[greatest(by_cause[members], zero=_TIE)]] if members else None
    return float(_log_sum(list(cases.values())) - np.log(len(cases))), cause


def _with_part(fault: Fault, effectiveness: Array, deviation: float) -> Fault:
    """The fault with the effectiveness of a weak actuator, by its deviation within the cell."""
    if fault.kind != "weak" or fault.is_healthy:
        return fault
    part = 1 - fault.effectiveness / effectiveness[fault.actuator]
    part = float(np.clip(part + PART_SPREAD * deviation, LEAST_LOST, 1 - LEAST_LOST))
    return replace(fault, effectiveness=float(effectiveness[fault.actuator]) * (1 - part))


def _state(evidence: Evidence, h: int, k: int, parameters: Array) -> Array:
    """State of the plant now (s,), by one hypothesis and onset with its parameters (R,)."""
    X, extra = evidence.X[h, k], EXTRA - 1
    J = len(X) - 1 - extra
    errors = evidence.prior.mean[:J] + parameters[:J]
    return X[0] + errors @ X[1:-extra] + parameters[-EXTRA:-1] @ X[-extra:]
