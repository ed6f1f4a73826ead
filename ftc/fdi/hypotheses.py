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
from scipy.special import chdtrc, log_ndtr, logsumexp

from argument_checks import Array, Indices
from ftc.fdi.fault_model import KINDS, Fault, FaultModel, NominalModel, fault_model

LOST = (0.01, 0.95)
"""A weak actuator has lost between these parts of the force that it had, all equally likely."""

SERVO_PARTS = (0.2, 0.35, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 1.0)
"""Parts lost of a servo's force for which there is a model each: what a loss does is not in
proportion to the part lost, since the force depends on the motion. In between, the states are
interpolated. Where forces depend on commands alone, all is linear in the part, and 1 suffices."""

_NO_EVIDENCE = 1e-12  # curvature of a flat likelihood, whose ratios are 1


@dataclass(frozen=True)
class Evidence:
    """For S actuators and J times of onset: states of the hypotheses' models, and likelihoods.

    Attributes:
        onsets: Ticks, ascending, shape (J,).
        parts: Parts of its force that an actuator has lost, ascending to 1, shape (M,).
        failed: State of the model with the actuator locked, and with each of these parts lost,
            shape (S, 1 + M, J, s).
        energy: Sum of squares of the believed model's residuals from each onset on, shape (J,).
        gain: Log likelihood ratio of each of those models against the believed one, shape
            (S, 1 + M, J).
        lost_slope: An actuator that has lost d more than the part before one of `parts`, or than
            nothing, gains d slope - d^2 curvature / 2 on that; shape (S, M, J).
        lost_curvature: See there.
    """

    onsets: Indices
    parts: Array
    failed: Array
    energy: Array
    gain: Array
    lost_slope: Array
    lost_curvature: Array

    def log_likelihood_ratios(self) -> Array:
        """Of each hypothesis against the believed model, shape (S, 3, J) as :data:`KINDS`."""
        before, low, high = self._intervals()
        m = len(low)
        area = _log_integral(self.lost_slope[:, :m], self.lost_curvature[:, :m], low, high)
        weak = logsumexp(before + area, axis=1) - np.log(LOST[1] - LOST[0])
        return np.stack([self.gain[:, 0], self.gain[:, -1], weak], axis=1)

    def best_log_likelihood_ratios(self) -> Array:
        """The same, of a weak actuator at its most likely loss."""
        _, weak = self._most_likely()
        return np.stack([self.gain[:, 0], self.gain[:, -1], weak.max(axis=1)], axis=1)

    def likely_parts(self) -> Array:
        """Most likely part of its force that each weak actuator has lost, shape (S, J)."""
        further, weak = self._most_likely()
        parts = further + _before(self.parts)[: further.shape[1], None]
        return np.take_along_axis(parts, weak.argmax(axis=1, keepdims=True), axis=1)[:, 0]

    def weak_state(self, s: int, j: int, x: Array) -> Array:
        """State (s,) with actuator s weak since onset j, if the believed model's is x."""
        part = self.likely_parts()[s, j]
        states = np.vstack([x, self.failed[s, 1:, j]])
        m = int(np.searchsorted(self.parts, part))
        low, high = np.concatenate([[0.0], self.parts])[m : m + 2]
        return states[m] + (part - low) / (high - low) * (states[m + 1] - states[m])

    def _most_likely(self) -> tuple[Array, Array]:
        """By interval: the loss beyond its lower end, and its log likelihood ratio, (S, m, J)."""
        before, low, high = self._intervals()
        slope, curvature = self.lost_slope[:, : len(low)], self.lost_curvature[:, : len(low)]
        d = np.clip(slope / np.maximum(curvature, _NO_EVIDENCE), low, high)
        return d, before + d * slope - d**2 * curvature / 2

    def _intervals(self) -> tuple[Array, Array, Array]:
        """Of those within :data:`LOST`: ratios (S, m, J) at their lower ends, and limits (m, 1)."""
        ends = _before(self.parts)
        m = int((ends < LOST[1]).sum())
        before = np.concatenate([np.zeros_like(self.gain[:, :1]), self.gain[:, 1:m]], axis=1)
        low, high = np.maximum(ends, LOST[0]) - ends, np.minimum(self.parts, LOST[1]) - ends
        return before, low[:m, None], high[:m, None]


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
        parts: As of :class:`Evidence`.
        A: Of each with the actuator locked besides, and with these parts lost, shape
            (S, 1 + M, s, s).
        B: As A, shape (S, 1 + M, s, n).
        onset: As A, shape (S, 1 + M, s, s).
        drift: As A, shape (S, 1 + M, s).
    """

    actuators: Indices
    effectiveness: Array
    believed: FaultModel
    parts: Array
    A: Array
    B: Array
    onset: Array
    drift: Array

    def start(self, onsets: Indices) -> Evidence:
        """No evidence yet; `onsets` are ticks, ascending, shape (J,)."""
        S, models, s = self.drift.shape
        J = len(onsets)
        none = np.zeros((S, models - 1, J))
        states, gain = np.zeros((S, models, J, s)), np.zeros((S, models, J))
        return Evidence(onsets, self.parts, states, np.zeros(J), gain, none, none)

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
        failed = state.failed @ self.A.swapaxes(-1, -2)
        failed += (self.B @ commanded + self.drift)[:, :, None]
        failed[:, :, state.onsets == tick] = (self.onset @ x)[:, :, None]

        begun = state.onsets <= tick
        residual = y - C @ x
        signature = np.where(begun[:, None], (failed - x) @ C.T, 0.0)
        gain = signature @ residual - (signature**2).sum(axis=-1) / 2
        width = np.diff(self.parts, prepend=0.0)[:, None, None]
        before = np.concatenate([np.zeros_like(signature[:, :1]), signature[:, 1:-1]], axis=1)
        more = (signature[:, 1:] - before) / width
        return Evidence(
            state.onsets,
            state.parts,
            failed,
            state.energy + np.where(begun, (residual**2).sum(), 0.0),
            state.gain + gain,
            state.lost_slope + (more * (residual - before)).sum(axis=-1),
            state.lost_curvature + (more**2).sum(axis=-1),
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
        effectiveness = 0.0
        if kind == "weak":
            effectiveness = float(self.effectiveness[s] * (1 - state.likely_parts()[s, j]))
            now = state.weak_state(s, j, x)
        else:
            now = state.failed[s, 0 if kind == "locked" else -1, j]
        return Verdict(
            fault=Fault(int(self.actuators[s]), kind, effectiveness),
            actuator_confidence=float(np.exp(by_actuator[s] - total)),
            kind_confidence=float(np.exp(by_kind[s, column] - by_actuator[s])),
            fault_free_confidence=float(np.exp(np.log(ratios.size) - total)),
            p_value=float(chdtrc(samples, left)),
            onset=int(state.onsets[j]),
            x=now,
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
    parts = np.array([1.0] if nominal.loses_only_commands else SERVO_PARTS)
    models = [
        [
            fault_model(nominal, [*faults, Fault(int(k), "locked")]),
            *(fault_model(nominal, [*faults, Fault(int(k), "weak", 1 - part)]) for part in parts),
        ]
        for k in actuators
    ]
    return HypothesisBank(
        actuators,
        np.array([weak.get(int(k), 1.0) for k in actuators]),
        fault_model(nominal, faults),
        parts,
        np.array([[model.A for model in each] for each in models]),
        np.array([[model.B for model in each] for each in models]),
        np.array([[model.onset for model in each] for each in models]),
        np.array([[model.drift for model in each] for each in models]),
    )


def _before(parts: Array) -> Array:
    """The part before each, the first after none."""
    return np.concatenate([[0.0], parts[:-1]])


def _log_integral(slope: Array, curvature: Array, low: Array, high: Array) -> Array:
    """Log of the integral of exp(d slope - d^2 curvature / 2) over d, from low to high."""
    d = np.maximum(curvature, _NO_EVIDENCE)
    mean, root = slope / d, np.sqrt(d)
    a, b = (low - mean) * root, (high - mean) * root
    a, b = np.where(a > 0, -b, a), np.where(a > 0, -a, b)  # the tail in which digits survive
    log_area = log_ndtr(b) + np.log1p(-np.exp(np.minimum(log_ndtr(a) - log_ndtr(b), -1e-15)))
    return slope * mean / 2 + 0.5 * np.log(2 * np.pi / d) + log_area
