"""A bank of hypotheses: which actuator has failed, how, since when; and how likely each is.

Every hypothesis is a linear model of its own that runs beside the plant, driven by the same
commands, and every one may be wrong in the same unknown parameters. Given the parameters its
residuals, whitened by the spectrum measured before the alarm, are white noise, so that its
likelihood with all parameters integrated out is Gaussian: multiple-model estimation (Magill, IEEE
Trans. Automatic Control 10, 1965) with nuisance parameters, over the time of onset (Willsky and
Jones, IEEE Trans. Automatic Control 21, 1976). Offsets of the sensors, which drift, are parameters
as the others: the decision is decoupled from them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from argument_checks import Array, Indices
from ftc.fdi.detection.parameter_filter import Parameters
from ftc.fdi.fault_model import Fault, FaultKind, NominalModel, fault_model
from ftc.fdi.friction import SampledFriction, together
from ftc.fdi.isolation._evidence import advance, weigh
from ftc.fdi.isolation.evidence import LOST, ONSET_SPREAD, PART_SPREAD, Evidence
from ftc.fdi.isolation.verdict import Verdict, verdict
from ftc.fdi.uncertainty import (
    CERTAIN,
    FaultModels,
    UncertainModel,
    Uncertainty,
    perturbed,
    uncertain_model,
)

_OTHERWISE: dict[FaultKind, tuple[FaultKind, ...]] = {
    "locked": ("free",),
    "free": ("locked",),
    "loose": ("locked",),
}
"""What a failed actuator may be instead, besides sound again; a weak one counts as working."""


@dataclass(frozen=True)
class HypothesisBank:
    """Hypotheses about a machine with known failures.

    The first: no more has failed. Then of each actuator that still works, locked and weak by turns;
    then of each that is known to have failed, that it works again or is otherwise. The last one is
    that none has failed and something else, slow, acts on the machine: the model of the first with
    another filter of its residuals, decoupled from slow unknown inputs (Chen and Patton, Robust
    Model-Based Fault Diagnosis, 1999, chapter 3).

    Attributes:
        faults: Of each hypothesis but the first and the last, H - 2; weak ones that have lost all
            are free.
        effectiveness: That actuators 0..n-1 are believed to have, shape (n,).
        believed: The plant with the known faults.
        models: Of all H.
        A: Of the models, shape (H, s, s); and so on.
        friction: Of all of them; None: nothing rubs.
    """

    faults: tuple[Fault, ...]
    effectiveness: Array
    believed: UncertainModel
    A: Array
    M: Array
    C: Array
    N: Array
    onset: Array
    further: Array
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
        H, K, R = len(self.A), len(onsets), prior.mean.size + 3
        q, rows, p = memory.shape
        kept = np.zeros((H, K, q, rows + 3, p))
        kept[..., :-3, :] = memory
        states = np.zeros((H, K, rows + 2, X.shape[1]))
        states[:, :, :-2] = X
        return Evidence(
            onsets,
            prior,
            0,
            states,
            kept,
            np.zeros((H, K, R, R)),
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
        """
        X, memory, information, score, energy = (
            part.copy()
            for part in (state.X, state.memory, state.information, state.score, state.energy)
        )
        last = whitening if decoupled is None else decoupled
        now, steps = state.onsets == sample, np.zeros(state.energy.shape, dtype=bool)
        steps[1:-1], steps[[0, -1], 0] = state.onsets <= sample, True
        later = np.zeros((len(X), X.shape[-1]))
        if now.any():  # until then each hypothesis is the first one
            for part in (X, memory, information, score, energy):
                part[1:-1, now] = part[0, 0]
            believed, sound = self.believed, X[0, 0, :-2]
            later = self.onset @ _later(believed, sound, v)
            X[1:-1, now] = (X[0, 0] @ self.onset[1:-1].swapaxes(-1, -2))[:, None]
        outputs = np.zeros((*X.shape[:3], memory.shape[-1]))
        before = None if self.friction is None else X.copy()
        advance(steps, X, outputs, self.A, self.M, self.C, self.N, v)
        if self.friction is not None and before is not None:
            self.friction.apply(steps, before, X, outputs, v)
        if now.any():
            X[1:-1, now, -2] = ONSET_SPREAD * (later[1:-1, None] - X[1:-1, now, 0])
            X[1:-1, now, -1] = shaken * self.further[1:-1, None]
        sums = information, score, energy
        weigh(
            steps,
            memory,
            *(sums if weighs else (each.copy() for each in sums)),
            outputs,
            self._part_slopes(outputs[:, :, 0]),
            whitening[0] if y is None else y,
            state.prior.mean,
            np.concatenate([np.tile(whitening, (len(X) - 1, 1, 1)), last[None]]),
        )
        if y is None:
            memory[steps, -1] = 0.0
        return replace(
            state,
            samples=state.samples + 1,
            X=X,
            memory=memory,
            information=information,
            score=score,
            energy=energy,
            gain=state.gain + weighs * float(np.log(last[0] / whitening[0]).sum()),
        )

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
        return verdict(state, sample, self.faults, self.effectiveness, disturbed=disturbed)


def hypothesis_bank(
    nominal: NominalModel,
    faults: Sequence[Fault] = (),
    uncertainty: Uncertainty = CERTAIN,
    ticks: int = 1,
) -> HypothesisBank:
    """Of a mechanism with these known faults, one more.

    Args:
        nominal: The plant without any.
        faults: Those known; weak actuators may get weaker, lock or lose all.
        uncertainty: Of the model.
        ticks: Of a sample.

    Raises:
        ValueError: No actuator is left that could fail.
    """
    k = nominal.plant.nstates // 2
    push, rows = nominal.plant.B[k:], nominal.displacement[:, :k]
    ways = push / np.einsum("nk,kn->n", rows, push)
    seen = np.linalg.norm(nominal.plant.C[:, :k] @ ways / nominal.noise[:, None], axis=0)
    ways = ways / np.maximum(seen, 1e-12 * np.linalg.norm(ways, axis=0))
    return bank_of(
        partial(fault_model, nominal),
        nominal.actuators,
        faults,
        others=[partial(fault_model, each) for each in perturbed(nominal, uncertainty)],
        delay_ticks=uncertainty.delay_s / nominal.period_s,
        friction=uncertainty.friction,
        ticks=ticks,
        lock_displacement=np.vstack([ways, np.zeros_like(ways)]).T,
    )


def bank_of(
    plant: FaultModels,
    n: int,
    faults: Sequence[Fault] = (),
    *,
    lock_displacement: Array | None = None,
    **options: Any,
) -> HypothesisBank:
    """Hypotheses of one more failure of a plant of any kind.

    Args:
        plant: The plant with any faults.
        n: Number of actuators.
        faults: Those known.
        lock_displacement: By how much the state of a plant differs with each actuator locked
            further out, by what an output sees as one standard deviation, shape (n, s).
        options: Of :func:`ftc.fdi.uncertainty.uncertain_model`.

    Raises:
        ValueError: No actuator is left that could fail.
    """
    left = np.ones(n)
    for fault in faults:
        left[fault.actuator] = fault.effectiveness if fault.kind == "weak" else 0.0
    if not left.any():
        raise ValueError("faults must leave a working actuator, got failures of all of them")
    one_more = [
        each
        for k in np.flatnonzero(left).tolist()
        for each in (
            Fault(k, "locked"),
            *(Fault(k, "weak", float(left[k] * (1 - part))) for part in LOST[:-1]),
            Fault(k, "free"),
        )
    ]
    one_more += [
        other
        for fault in faults
        for other in (
            Fault(fault.actuator, "weak", 1.0),
            *(Fault(fault.actuator, kind) for kind in _OTHERWISE.get(fault.kind, ())),
        )
    ]
    known = [
        [*(each for each in faults if each.actuator != fault.actuator), fault] for fault in one_more
    ]
    models = [uncertain_model(plant, each, **options) for each in ([*faults], *known)]
    models.append(models[0])
    A, M, C, N, onset = (
        np.array([getattr(model, name) for model in models])
        for name in ("A", "M", "C", "N", "onset")
    )
    M, N = (np.concatenate([part, np.zeros_like(part[:, :2])], axis=1) for part in (M, N))
    further = np.zeros((len(models), A.shape[-1]))
    if lock_displacement is not None:
        for h, fault in enumerate(one_more, 1):
            if fault.kind == "locked":
                further[h] = lock_displacement[fault.actuator]
    rubbed = [model.friction for model in models if model.friction is not None]
    friction = together(rubbed) if rubbed else None
    return HypothesisBank(tuple(one_more), left, models[0], A, M, C, N, onset, further, friction)


def _later(believed: UncertainModel, X: Array, v: Array) -> Array:
    """State (s,) of the believed model after a sample."""
    if believed.friction is not None:
        return believed.step(X, v)[1][0]
    return believed.A @ X[0] + believed.M[0] @ [*X[0], *v]
