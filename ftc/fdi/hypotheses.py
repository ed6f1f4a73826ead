"""A bank of hypotheses: which actuator has failed, how, since when; and how likely each is.

Every hypothesis is a linear model of its own that runs beside the plant, driven by the same
commands. With no unknown input but white sensor noise its Kalman filter has gain zero, so the
likelihood is that of its output errors: the generalized likelihood ratio of Willsky and Jones, IEEE
Trans. Automatic Control 21 (1976), over the time of onset, and the multiple-model probabilities of
Magill, IEEE Trans. Automatic Control 10 (1965), over the rest.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import log_ndtr, logsumexp
from scipy.stats import chi2

from argument_checks import Array, Indices
from ftc.fdi.fault_model import KINDS, Fault, FaultModel, NominalModel, fault_model

LOST = (0.01, 0.95)
"""A weak actuator has lost between these parts of the force that it had, all equally likely."""

_NO_EVIDENCE = 1e-12  # curvature of a flat likelihood, whose ratios are 1


@dataclass(frozen=True)
class Evidence:
    """For S actuators and J times of onset: states of the hypotheses' models, and likelihoods.

    Attributes:
        onsets: Ticks, ascending, shape (J,).
        locked: State of the model with the actuator locked, shape (S, J, s).
        lost: What the state has lost where the actuator is free; where it is weak, a part of this.
        energy: Sum of squares of the believed model's residuals from each onset on, shape (J,).
        locked_gain: Log likelihood ratio of the lock against the believed model, shape (S, J).
        lost_slope: That of an actuator that has lost a part p of its force is p slope - p^2
            curvature / 2; shape (S, J).
        lost_curvature: See there.
    """

    onsets: Indices
    locked: Array
    lost: Array
    energy: Array
    locked_gain: Array
    lost_slope: Array
    lost_curvature: Array

    def log_likelihood_ratios(self) -> Array:
        """Of each hypothesis against the believed model, shape (S, 3, J) as :data:`KINDS`."""
        weak = _log_mean_over_parts(self.lost_slope, self.lost_curvature)
        return np.stack([self.locked_gain, self._with_lost(1.0), weak], axis=1)

    def best_log_likelihood_ratios(self) -> Array:
        """The same, of a weak actuator at its most likely loss."""
        weak = self._with_lost(self.likely_parts())
        return np.stack([self.locked_gain, self._with_lost(1.0), weak], axis=1)

    def likely_parts(self) -> Array:
        """Most likely part of its force that each actuator has lost, shape (S, J)."""
        curvature = np.maximum(self.lost_curvature, _NO_EVIDENCE)
        return np.clip(self.lost_slope / curvature, *LOST)

    def _with_lost(self, part: Array | float) -> Array:
        return part * self.lost_slope - part**2 * self.lost_curvature / 2


@dataclass(frozen=True)
class Verdict:
    """Probabilities of the hypotheses.

    Attributes:
        fault: The most likely one.
        actuator_confidence: Probability that it is this actuator, whatever its kind; the rest is
            that of other actuators, and of no failure at all.
        kind_confidence: Probability of the kind, given the actuator.
        fault_free_confidence: Probability that nothing has failed.
        p_value: Probability that mere noise leaves residuals as large as the fault's, or larger.
        onset: Most likely tick.
        x: State of the plant now, if it is so, shape (s,).
    """

    fault: Fault
    actuator_confidence: float
    kind_confidence: float
    fault_free_confidence: float
    p_value: float
    onset: int
    x: Array


@dataclass(frozen=True)
class HypothesisBank:
    """Hypotheses about the S actuators that still work.

    Attributes:
        actuators: Which, 0..n-1, shape (S,).
        effectiveness: Parts of their force that they are believed to have, shape (S,).
        believed: The plant with the known faults.
        A: With each of them locked besides, shape (S, s, s).
        B: As A, shape (S, s, n).
        onset: As A, shape (S, s, s).
    """

    actuators: Indices
    effectiveness: Array
    believed: FaultModel
    A: Array
    B: Array
    onset: Array

    def start(self, onsets: Indices) -> Evidence:
        """No evidence yet; `onsets` are ticks, ascending, shape (J,)."""
        S, J, s = len(self.actuators), len(onsets), len(self.believed.A)
        still, nothing = np.zeros((S, J, s)), np.zeros((S, J))
        return Evidence(onsets, still, still, np.zeros(J), nothing, nothing, nothing)

    def step(self, state: Evidence, tick: int, x: Array, commanded: Array, y: Array) -> Evidence:
        """One tick of evidence.

        Args:
            state: From the tick before.
            tick: Now.
            x: State of the believed model now, shape (s,).
            commanded: Displacements since the tick before, shape (n,).
            y: Whitened outputs measured now, shape (p,).
        """
        C = self.believed.C
        locked = state.locked @ self.A.swapaxes(1, 2) + (self.B @ commanded)[:, None]
        missing = self.believed.B[:, self.actuators] * commanded[self.actuators]
        lost = state.lost @ self.believed.A.T - missing.T[:, None]
        locked[:, state.onsets == tick] = (self.onset @ x)[:, None]
        lost[:, state.onsets >= tick] = 0.0

        residual = y - C @ x
        error = y - locked @ C.T
        energy = (residual**2).sum()
        gain = (energy - (error**2).sum(axis=-1)) / 2
        signature = lost @ C.T
        return Evidence(
            state.onsets,
            locked,
            lost,
            state.energy + np.where(state.onsets <= tick, energy, 0.0),
            state.locked_gain + np.where(state.onsets <= tick, gain, 0.0),
            state.lost_slope + signature @ residual,
            state.lost_curvature + (signature**2).sum(axis=-1),
        )

    def verdict(self, state: Evidence, tick: int, x: Array) -> Verdict:
        """Probabilities of the hypotheses; a priori, failure and no failure are equally likely.

        Args:
            state: The evidence.
            tick: Now.
            x: State of the believed model now, shape (s,).
        """
        ratios = state.log_likelihood_ratios()
        by_kind = logsumexp(ratios, axis=-1)
        by_actuator = logsumexp(by_kind, axis=-1)
        total = np.logaddexp(logsumexp(by_actuator), np.log(ratios.size))
        s = int(by_actuator.argmax())
        column = int(by_kind[s].argmax())
        j, kind = int(ratios[s, column].argmax()), KINDS[column]
        left = state.energy[j] - 2 * state.best_log_likelihood_ratios()[s, column, j]
        samples = (tick - state.onsets[j] + 1) * len(self.believed.C)
        part = 1.0 if kind == "free" else float(state.likely_parts()[s, j])
        effectiveness = float(self.effectiveness[s] * (1 - part)) if kind == "weak" else 0.0
        return Verdict(
            fault=Fault(int(self.actuators[s]), kind, effectiveness),
            actuator_confidence=float(np.exp(by_actuator[s] - total)),
            kind_confidence=float(np.exp(by_kind[s, column] - by_actuator[s])),
            fault_free_confidence=float(np.exp(np.log(ratios.size) - total)),
            p_value=float(chi2.sf(left, samples)),
            onset=int(state.onsets[j]),
            x=state.locked[s, j] if kind == "locked" else x + part * state.lost[s, j],
        )


def hypothesis_bank(nominal: NominalModel, faults: Sequence[Fault] = ()) -> HypothesisBank:
    """Hypotheses of one more failure beside those that are known.

    Args:
        nominal: The plant without any.
        faults: Those known; a weak actuator may still fail.

    Raises:
        ValueError: No actuator is left that could fail.
    """
    dead = {fault.actuator for fault in faults if fault.kind != "weak"}
    actuators = np.array([k for k in range(nominal.actuators) if k not in dead], dtype=int)
    if not actuators.size:
        raise ValueError("faults must leave a working actuator, got failures of all of them")
    weak = {fault.actuator: fault.effectiveness for fault in faults if fault.kind == "weak"}
    models = [fault_model(nominal, [*faults, Fault(int(k), "locked")]) for k in actuators]
    return HypothesisBank(
        actuators,
        np.array([weak.get(int(k), 1.0) for k in actuators]),
        fault_model(nominal, faults),
        np.stack([model.A for model in models]),
        np.stack([model.B for model in models]),
        np.stack([model.onset for model in models]),
    )


def _log_mean_over_parts(slope: Array, curvature: Array) -> Array:
    """Log of the mean of exp(p slope - p^2 curvature / 2) over p, uniform in :data:`LOST`."""
    low, high = LOST
    d = np.maximum(curvature, _NO_EVIDENCE)
    mean, root = slope / d, np.sqrt(d)
    a, b = (low - mean) * root, (high - mean) * root
    a, b = np.where(a > 0, -b, a), np.where(a > 0, -a, b)  # the tail in which digits survive
    log_area = log_ndtr(b) + np.log1p(-np.exp(np.minimum(log_ndtr(a) - log_ndtr(b), -1e-15)))
    return slope * mean / 2 + 0.5 * np.log(2 * np.pi / d) + log_area - np.log(high - low)
