"""A bank of hypotheses: which strut, how, since when; and how likely each is.

Every hypothesis is a linear machine of its own that runs beside the real one, driven by the same
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

from ftc.fdi.fault_model import KINDS, Fault, Machine, SoundMachine, failed_machine
from sim import Array

LOST = (0.01, 0.95)
"""A weak coil has lost between these parts of the force that it had, all equally likely."""

_NO_EVIDENCE = 1e-12  # curvature of a flat likelihood, whose ratios are 1


@dataclass(frozen=True)
class BankState:
    """The hypotheses' machines, and the evidence for them, in S struts and J times of onset.

    Attributes:
        onsets: Ticks, ascending, shape (J,).
        locked: State of the machine with the strut locked, shape (S, J, s).
        lost: What the state has lost where the strut is free; where it is weak, a part of this.
        energy: Sum of squares of the believed machine's residuals from each onset on, shape (J,).
        locked_gain: Log likelihood ratio of the lock against the believed machine, shape (S, J).
        lost_slope: That of a coil that has lost a part p of its force is p slope - p^2 curvature /
            2; shape (S, J).
        lost_curvature: See there.
    """

    onsets: Array
    locked: Array
    lost: Array
    energy: Array
    locked_gain: Array
    lost_slope: Array
    lost_curvature: Array

    def log_likelihood_ratios(self) -> Array:
        """Of each hypothesis against the believed machine, shape (S, 3, J) as :data:`KINDS`."""
        weak = _log_mean_over_parts(self.lost_slope, self.lost_curvature)
        return np.stack([self.locked_gain, self._with_lost(1.0), weak], axis=1)

    def best_log_likelihood_ratios(self) -> Array:
        """The same, of a weak coil at its most likely loss."""
        weak = self._with_lost(self.likely_parts())
        return np.stack([self.locked_gain, self._with_lost(1.0), weak], axis=1)

    def likely_parts(self) -> Array:
        """Most likely part of its force that each coil has lost, shape (S, J)."""
        curvature = np.maximum(self.lost_curvature, _NO_EVIDENCE)
        return np.clip(self.lost_slope / curvature, *LOST)

    def _with_lost(self, part: Array | float) -> Array:
        return part * self.lost_slope - part**2 * self.lost_curvature / 2


@dataclass(frozen=True)
class Verdict:
    """What the evidence says.

    Attributes:
        fault: The most likely one.
        strut_confidence: Probability that it is this strut, whatever its kind; the rest is that of
            other struts, and of no failure at all.
        kind_confidence: Probability of the kind, given the strut.
        sound_confidence: Probability that nothing has failed.
        misfit: Probability that mere noise leaves residuals as large as the fault's, or larger.
        onset: Most likely tick.
        x: State of the machine now, if it is so, shape (s,).
    """

    fault: Fault
    strut_confidence: float
    kind_confidence: float
    sound_confidence: float
    misfit: float
    onset: int
    x: Array


@dataclass(frozen=True)
class Bank:
    """Hypotheses about the struts that still work.

    Attributes:
        struts: Which, 0..5, shape (S,).
        strength: Parts of their coils' force that they are believed to have, shape (S,).
        believed: The machine as it is believed to be.
        A: Of the machine with each of them locked besides, shape (S, s, s).
        B: As A, shape (S, s, 6).
        onset: As A, shape (S, s, s).
        C: Whitened outputs per state, shape (p, s).
    """

    struts: Array
    strength: Array
    believed: Machine
    A: Array
    B: Array
    onset: Array
    C: Array

    def start(self, onsets: Array) -> BankState:
        """No evidence yet; `onsets` are ticks, ascending, shape (J,)."""
        S, J, s = len(self.struts), len(onsets), len(self.believed.A)
        still, nothing = np.zeros((S, J, s)), np.zeros((S, J))
        return BankState(onsets, still, still, np.zeros(J), nothing, nothing, nothing)

    def step(self, state: BankState, tick: int, x: Array, sent_m: Array, y: Array) -> BankState:
        """One tick of evidence.

        Args:
            state: From the tick before.
            tick: Now.
            x: State of the believed machine now, shape (s,).
            sent_m: Strut displacements commanded since the tick before, shape (6,).
            y: Whitened outputs measured now, shape (p,).
        """
        locked = state.locked @ self.A.swapaxes(1, 2) + (self.B @ sent_m)[:, None]
        missing = self.believed.B[:, self.struts] * sent_m[self.struts]
        lost = state.lost @ self.believed.A.T - missing.T[:, None]
        locked[:, state.onsets == tick] = (self.onset @ x)[:, None]
        lost[:, state.onsets >= tick] = 0.0

        residual = y - self.C @ x
        error = y - locked @ self.C.T
        energy = (residual**2).sum()
        gain = (energy - (error**2).sum(axis=-1)) / 2
        signature = lost @ self.C.T
        return BankState(
            state.onsets,
            locked,
            lost,
            state.energy + np.where(state.onsets <= tick, energy, 0.0),
            state.locked_gain + np.where(state.onsets <= tick, gain, 0.0),
            state.lost_slope + signature @ residual,
            state.lost_curvature + (signature**2).sum(axis=-1),
        )

    def verdict(self, state: BankState, tick: int, x: Array) -> Verdict:
        """Weigh the hypotheses; beforehand, failure is as likely as none, and all are alike.

        Args:
            state: The evidence.
            tick: Now.
            x: State of the believed machine now, shape (s,).
        """
        ratios = state.log_likelihood_ratios()
        by_kind = logsumexp(ratios, axis=-1)
        by_strut = logsumexp(by_kind, axis=-1)
        total = np.logaddexp(logsumexp(by_strut), np.log(ratios.size))
        s = int(by_strut.argmax())
        kind = int(by_kind[s].argmax())
        j = int(ratios[s, kind].argmax())
        left = state.energy[j] - 2 * state.best_log_likelihood_ratios()[s, kind, j]
        samples = (tick - state.onsets[j] + 1) * len(self.C)
        part = 1.0 if KINDS[kind] == "free" else float(state.likely_parts()[s, j])
        left_over = float(self.strength[s] * (1 - part)) if KINDS[kind] == "weak" else 0.0
        fault = Fault(int(self.struts[s]), KINDS[kind], left_over)
        return Verdict(
            fault=fault,
            strut_confidence=float(np.exp(by_strut[s] - total)),
            kind_confidence=float(np.exp(by_kind[s, kind] - by_strut[s])),
            sound_confidence=float(np.exp(np.log(ratios.size) - total)),
            misfit=float(chi2.sf(left, samples)),
            onset=int(state.onsets[j]),
            x=state.locked[s, j] if KINDS[kind] == "locked" else x + part * state.lost[s, j],
        )


def bank(sound: SoundMachine, faults: Sequence[Fault], C: Array) -> Bank:
    """Hypotheses of one more failure beside those that are known.

    Args:
        sound: The machine without any.
        faults: Those known; a weak strut may still fail.
        C: Whitened outputs per state, shape (p, s).

    Raises:
        ValueError: No strut is left that could fail.
    """
    dead = {fault.strut for fault in faults if fault.kind != "weak"}
    struts = np.array([k for k in range(sound.struts) if k not in dead], dtype=int)
    if not struts.size:
        raise ValueError("faults must leave a strut that could fail, got all of them dead")
    weak = {fault.strut: fault.strength for fault in faults if fault.kind == "weak"}
    machines = [failed_machine(sound, [*faults, Fault(k, "locked")]) for k in struts]
    return Bank(
        struts,
        np.array([weak.get(int(k), 1.0) for k in struts]),
        failed_machine(sound, faults),
        np.stack([machine.A for machine in machines]),
        np.stack([machine.B for machine in machines]),
        np.stack([machine.onset for machine in machines]),
        C,
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
