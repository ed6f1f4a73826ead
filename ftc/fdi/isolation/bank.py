"""A bank of hypotheses beside the plant, and the evidence that each sample adds to each of them."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from argument_checks import Array, Indices
from ftc._records import Pointers, changed
from ftc.fdi.detection.parameter_filter import Parameters
from ftc.fdi.fault_model import Fault
from ftc.fdi.friction import SampledFriction
from ftc.fdi.isolation.causes import Cause
from ftc.fdi.isolation.evidence import EXTRA, LOST, ONSET_SPREAD, PART_SPREAD, Evidence
from ftc.fdi.isolation.verdict import Verdict, verdict
from ftc.fdi.uncertainty import UncertainModel, stacked
from kernels import ffi, lib, pointer


@dataclass(frozen=True)
class HypothesisBank:
    """Hypotheses about a machine with known failures.

    The first: no more has failed. Then one more failure each; then what is no failure, but as
    sudden, of the machine of the first; the last one is that something else, slow, acts on the
    machine: the model of the first with another filter of its residuals, decoupled from slow
    unknown inputs (Chen and Patton, Robust Model-Based Fault Diagnosis, 1999, chapter 3).

    Attributes:
        faults: Of the hypotheses 1..F; weak ones that have lost all are free.
        causes: Of those from F + 1 to H - 2, which are no failures.
        effectiveness: That actuators 0..n-1 are believed to have, shape (n,).
        believed: The plant with the known faults.
        A: Of the models of all H, shape (H, s, s); and so on.
        placed: State at the onset per standard deviation of a hypothesis' first own parameter, as
            an output sees it, shape (H, s).
        scaled: The same per state at the onset, shape (H,).
        friction: Of all of them; None: nothing rubs.
    """

    faults: tuple[Fault, ...]
    causes: tuple[Cause, ...]
    effectiveness: Array
    believed: UncertainModel
    A: Array
    M: Array
    C: Array
    N: Array
    onset: Array
    placed: Array
    scaled: Array
    friction: SampledFriction | None

    def start(self, onsets: Indices, prior: Parameters, X: Array, memory: Array) -> Evidence:
        """No evidence yet, before the first onset.

        Args:
            onsets: Samples, ascending, shape (K,).
            prior: Parameters then.
            X: State of the believed model then, shape (1 + J, s).
            memory: Residuals of the samples before it and the regressors, before whitening, shape
                (q + 1, 1 + J, p).
        """
        H, K, R = len(self.A), len(onsets), prior.mean.size + EXTRA
        q, rows, p = memory.shape
        kept = np.zeros((H, K, q, rows + EXTRA, p))
        states = np.zeros((H, K, rows + EXTRA - 1, X.shape[1]))
        for h in (0, -1):  # until its onset each of the others is the first one
            kept[h, 0, :, :-EXTRA] = memory
            states[h, 0, :rows] = X
        return Evidence(
            onsets,
            prior,
            0,
            states,
            kept,
            np.zeros((H, K, R * (R + 1) // 2)),
            np.zeros((H, K, R)),
            np.zeros((H, K)),
        )

    def step(
        self,
        state: Evidence,
        sample: int,
        v: Array,
        y: Array | None,
        whitening: Array,
        shaken: float,
        *,
        decoupled: Array | None = None,
        weighs: bool = True,
        keeps: bool = True,
    ) -> Evidence:
        """One sample of evidence.

        Args:
            state: Before it.
            sample: Its number.
            v: Inputs of the models, shape (r,).
            y: Mean outputs in units of their noise, shape (p,); None: nothing was measured, and
                each hypothesis goes on as it predicts.
            whitening: Weights (q + 1, p) of the newest to the oldest residual.
            shaken: By how much an actuator may lock off its place, as an output sees it, in
                standard deviations of noise.
            decoupled: Weights of the last hypothesis; None: the same.
            weighs: Whether the sample is evidence: all that its whitening needs was measured.
            keeps: Whether the arrays of `state` stay as they are; else they are overwritten.
        """
        X = state.X.copy() if keeps else state.X
        last = whitening if decoupled is None else decoupled
        now, steps = state.onsets == sample, np.zeros(state.energy.shape, dtype=bool)
        steps[1:-1], steps[[0, -1], 0] = state.onsets <= sample, True
        later = np.zeros((len(X), X.shape[-1]))
        if now.any():  # until then each hypothesis is the first one
            believed, sound = self.believed, X[0, 0, : 1 - EXTRA].copy()
            later = self.onset @ _later(believed, sound, v)
            X[1:-1, now] = (X[0, 0] @ self.onset[1:-1].swapaxes(-1, -2))[:, None]
            X[1:-1, now, -2] = self.scaled[1:-1, None, None] * sound[0]
        H, K, rows, s = X.shape
        p, which = state.memory.shape[-1], pointer(steps)
        outputs, room = np.empty((H, K, rows, p)), np.empty(2 * rows * (p + s))
        outputs[:, :, 0] = 0.0
        before = None if self.friction is None else X.copy()
        age = np.maximum(sample - state.onsets, 0).astype(float)
        given = which, *self._stacked, pointer(v), pointer(age)
        changing = pointer(room), pointer(X), pointer(outputs)
        lib.advance_models(H, K, rows, s, p, len(v), *given, *changing)
        if self.friction is not None and before is not None:
            self.friction.apply(steps, before, X, outputs, v)
        if now.any():
            X[1:-1, now, -3] = ONSET_SPREAD * (later[1:-1, None] - X[1:-1, now, 0])
            X[1:-1, now, -2] += shaken * self.placed[1:-1, None]
        sums = state.information, state.score, state.energy
        given = state.memory, *sums
        after = tuple(np.empty_like(each) for each in given) if keeps else given
        J = rows - EXTRA
        lib.weigh_sample(
            *(H, K, J, p, len(whitening), which, pointer(now), weighs),
            ffi.new("evidence *", [pointer(each) for each in given]),
            pointer(outputs),
            pointer(self._part_slopes(outputs[:, :, 0])),
            pointer(whitening[0] if y is None else y),
            pointer(state.prior.mean),
            pointer(np.tile(np.stack([whitening, last])[:, ::-1], rows + 1)),
            pointer(np.empty(p * (2 * J + p + 12))),
            ffi.new("evidence *", [pointer(each) for each in after]),
        )
        memory, information, score, energy = after
        if y is None:
            memory[steps, -1] = 0.0
        return changed(
            state,
            samples=state.samples + 1,
            X=X,
            memory=memory,
            information=information,
            score=score,
            energy=energy,
            gain=state.gain + weighs * float(np.log(last[0] / whitening[0]).sum()),
        )

    @cached_property
    def _stacked(self) -> Pointers:
        return stacked(self.A, self.M, self.C, self.N)

    def _part_slopes(self, outputs: Array) -> Array:
        """What a standard deviation of the part lost within its cell adds to outputs (H, K, p)."""
        slopes = np.zeros_like(outputs)
        m = 1 + len(LOST)
        working = slice(1, 1 + m * np.count_nonzero(self.effectiveness))
        lost = outputs[working].reshape(-1, m, *outputs.shape[1:])[:, 1:]
        sound = np.broadcast_to(outputs[0, 0], lost[:, :1].shape)
        edges = np.concatenate([sound, lost, 2 * lost[:, -1:] - lost[:, -2:-1]], axis=1)
        by_part = (edges[:, 2:] - edges[:, :-2]) / (2 * LOST[0]) * PART_SPREAD
        slopes[working].reshape(-1, m, *outputs.shape[1:])[:, 1:] = by_part
        return slopes

    def verdict(self, state: Evidence, sample: int, *, disturbed: bool = True) -> Verdict:
        """What the evidence up to a sample says, by :func:`ftc.fdi.isolation.verdict.verdict`."""
        own = self.faults, self.causes, self.effectiveness
        return verdict(state, sample, *own, disturbed=disturbed)


def _later(believed: UncertainModel, X: Array, v: Array) -> Array:
    """State (s,) of the believed model after a sample."""
    if believed.friction is not None:
        return believed.step(X, v)[1][0]
    return believed.A @ X[0] + believed.M[0] @ [*X[0], *v]
