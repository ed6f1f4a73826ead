"""Decision among the hypotheses by their evidence, and the thresholds of its certainty."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from argument_checks import Array
from argument_checks.ties import greatest
from ftc.fdi.bank import EXTRA, LEAST_LOST, PART_SPREAD, Cause, Evidence, HypothesisBank
from ftc.fdi.fault_model import KINDS, Fault

LARGEST_INFLATION = 30.0
"""Largest ratio of residual variances after and before the onset for which a failure fits, since it
alters the path from disturbances to sensors. On the hexapod the ratio is up to 15, and 25 with
three times all mismatches."""

MODEL_ERROR = 0.01
"""Largest unexplained fraction of the residual energy, above noise, for which a failure fits even
if its variance is larger: squared relative error of a linear model of the largest failures, a
tenth."""

LARGEST_PARAMETER_DEVIATION = 20.0
"""Largest deviation of the plant parameters from their prior for which a failure fits [standard
deviations]: other disturbances of a servo could be explained by a damper of a hundred times its
uncertainty."""

LARGEST_UNEXPLAINED = 0.3
"""Largest unexplained fraction of the energy with which an actuator is first isolated: squared
relative model error while onset and lost fraction are hardly known."""

WITHDRAWAL_UNEXPLAINED = 0.8
"""Unexplained fraction of the energy above which a diagnosis is withdrawn."""

RESTART_S = 0.2
"""Time without a fitting failure after which the evidence is restarted [s]: it discards an event
such as a bump, so that a lock 0.4 s later is detected."""

EFFECTIVENESS_STEP = 0.1
"""Smallest change of a diagnosed effectiveness that revises it: less than the quarters between the
models of the bank, more than the fluctuation of its estimate."""

CONFIDENCE = 0.999
"""Probability at which an actuator is isolated, or an alarm dismissed: one of a thousand isolations
may be wrong."""

LOOK_BACK_S = 1.0
"""Range of onsets before an alarm, and longest time without an explanation [s]: twice the longest
mean of the residual test, so that the onset lies within."""

CONFIRMATION_S = 1.0
"""Time in which a diagnosis may be revised, and for which an actuator has to work before it is put
back in use [s]; equal to `LOOK_BACK_S`."""

_NOISE = 4.0
"""Number of standard deviations (of chi-square) by which an energy must exceed that of noise."""

_TIE = 1e-6
"""Difference of log likelihoods below which hypotheses are tied: round-off."""

_log_sum = np.logaddexp.reduce


@dataclass(frozen=True)
class Decision:
    """Probabilities of the hypotheses and properties of the most likely fault.

    Attributes:
        fault: Most likely fault.
        actuator_confidence: Probability that this actuator has failed, with any kind.
        kind_confidences: Probability of each of :data:`ftc.fdi.fault_model.KINDS`, given the
            actuator.
        fault_free_confidence: Probability that no actuator has failed.
        cause: Most likely cause in that case; None is no cause, or a slow disturbance.
        inflation: Variance of the residuals of this fault over its expected value, at least 1. All
            log likelihoods are divided by it.
        unexplained: Fraction of the energy under no failure that this fault does not explain, above
            noise.
        energy: Energy of the residuals of this fault with fitted parameters.
        parameter_deviation: Distance of the fitted plant parameters from their prior [standard
            deviations].
        onset: Most likely sample of the onset.
        x: Present state of the plant under this fault, shape (s,).
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
        """Return whether the residuals of the most likely fault are noise of a plausible plant."""
        small = self.inflation <= LARGEST_INFLATION or self.unexplained <= MODEL_ERROR
        return small and self.parameter_deviation <= LARGEST_PARAMETER_DEVIATION

    def revises(self, diagnosed: Fault) -> bool:
        """Return whether another actuator, kind or effectiveness than `diagnosed` is certain."""
        if self.fault.actuator != diagnosed.actuator:
            return True
        if self.fault.kind != diagnosed.kind:
            return max(self.kind_confidences) >= CONFIDENCE
        return abs(self.fault.effectiveness - diagnosed.effectiveness) > EFFECTIVENESS_STEP


def decide(
    bank: HypothesisBank, evidence: Evidence, sample: int, *, disturbed: bool = True
) -> Decision:
    """Compute the probabilities of the hypotheses after a sample.

    The prior probabilities of failure and no failure are equal; within no failure, so are those of
    no cause, each kind of cause and, if `disturbed`, a slow disturbance.
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
    """Return the log likelihood ratio of no failure, averaged over its cases, and the best cause.

    The arguments are the ratios of each cause, averaged over its onsets, and that of a slow
    disturbance; None excludes it.
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
    """Return the fault; a weak one gets its effectiveness by the deviation within the cell."""
    if fault.kind != "weak" or fault.is_healthy:
        return fault
    part = 1 - fault.effectiveness / effectiveness[fault.actuator]
    part = float(np.clip(part + PART_SPREAD * deviation, LEAST_LOST, 1 - LEAST_LOST))
    return replace(fault, effectiveness=float(effectiveness[fault.actuator]) * (1 - part))


def _state(evidence: Evidence, h: int, k: int, parameters: Array) -> Array:
    """Return the present plant state (s,) under one hypothesis and onset, with parameters (R,)."""
    X, extra = evidence.X[h, k], EXTRA - 1
    J = len(X) - 1 - extra
    errors = evidence.prior.mean[:J] + parameters[:J]
    return X[0] + errors @ X[1:-extra] + parameters[-EXTRA:-1] @ X[-extra:]
