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
from scipy.special import logsumexp

from argument_checks import Array, Indices, Mask
from ftc.fdi._evidence import advance, weigh
from ftc.fdi.fault_model import Fault, NominalModel, fault_model
from ftc.fdi.parameter_filter import Parameters
from ftc.fdi.uncertainty import (
    CERTAIN,
    FaultModels,
    UncertainModel,
    Uncertainty,
    perturbed,
    uncertain_model,
)

LOST = (0.25, 0.5, 0.75, 1.0)
"""Parts of an actuator's force that the models have lost. Within an eighth of each the part is one
more unknown parameter, of which the outputs are taken as linear."""

_PART_SPREAD = 0.25 / np.sqrt(12)
_ONSET_SPREAD = 1 / np.sqrt(12)
"""Standard deviations within a cell, of the part lost and of the onset, in samples."""

_LEAST = 0.02
"""A smaller loss is no failure."""

_CELLS = [-3, -1]
"""Places of onset and part lost among the parameters; between them is the displacement of a locked
actuator."""


@dataclass(frozen=True)
class Evidence:
    """For H hypotheses and K onsets: states, and sums of products of whitened residuals.

    Attributes:
        onsets: Samples, ascending, shape (K,).
        prior: Parameters when the first of them began.
        samples: Of evidence so far.
        X: States, shape (H, K, 3 + J, s): of the model, of its errors, and what an onset later, and
            a locked actuator further out, by a standard deviation each, would add.
        memory: Latest residuals and regressors before whitening, newest last, shape
            (H, K, q + 1, 4 + J, p).
        information: Sum of products of the regressors, shape (H, K, R, R).
        score: Of regressors and residuals, shape (H, K, R).
        energy: Of the residuals, shape (H, K).
    """

    onsets: Indices
    prior: Parameters
    samples: int
    X: Array
    memory: Array
    information: Array
    score: Array
    energy: Array

    def marginal(self) -> tuple[Array, Array, Array]:
        """With all parameters integrated out; the onset and the part lost stay in their cells.

        Returns:
            Energy of the residuals that is left, (H, K); log of the square root of the determinant
            of their covariance, (H, K); and the most likely parameters, less their prior mean,
            (H, K, R).
        """
        spread = np.zeros((self.score.shape[-1],) * 2)
        spread[:-3, :-3] = np.linalg.cholesky(self.prior.covariance)
        spread[-3:, -3:] = np.eye(3)
        inner = np.eye(len(spread)) + spread.T @ self.information @ spread
        score = self.score @ spread
        wanted = np.zeros((*score.shape, 3))
        wanted[..., 0], wanted[..., _CELLS, [1, 2]] = score, 1.0
        solved = np.linalg.solve(inner, wanted).astype(float)
        root = solved[..., 0]
        energy = self.energy - (score * root).sum(axis=-1)
        spreads = solved[..., _CELLS, 1:]
        moved = _into(root[..., _CELLS], spreads, *self.cells) - root[..., _CELLS]
        pull = np.linalg.solve(spreads, moved[..., None])
        energy = energy + (moved * pull[..., 0]).sum(axis=-1)
        root = root + (solved[..., 1:] @ pull)[..., 0]
        log_det = np.linalg.slogdet(inner)[1] / 2
        return energy, log_det, root @ spread.T

    @property
    def cells(self) -> tuple[Array, Array]:
        """Least and largest onset and part lost, about those of each hypothesis, (H, 1, 2) each."""
        high = np.full((len(self.energy), 1, 2), np.sqrt(3.0))
        low, m = -high, 1 + len(LOST)
        low[2::m, 0, 1] = (_LEAST - LOST[0]) / _PART_SPREAD
        high[m::m, 0, 1] = 0.0
        return low, high

    def only(self, kept: Mask) -> "Evidence":
        """The evidence of some onsets, bool (K,)."""
        parts = {}
        for name in ("X", "memory", "information", "score", "energy"):
            whole = getattr(self, name)
            parts[name] = whole[:, kept]
            parts[name][0, 0] = whole[0, 0]  # no failure, which has no onset
        return replace(self, onsets=self.onsets[kept], **parts)


@dataclass(frozen=True)
class Verdict:
    """Probabilities of the hypotheses.

    Attributes:
        fault: The most likely one.
        actuator_confidence: Probability that it is this actuator, whatever its kind; the rest is
            that of other actuators, and of no failure at all.
        kind_confidences: Probability of each of :data:`ftc.fdi.fault_model.KINDS`, given the
            actuator.
        fault_free_confidence: Probability that nothing has failed.
        inflation: Variance of the residuals that the most likely fault leaves, over that expected;
            at least 1. All log likelihoods are divided by it.
        unexplained: Part of the energy against no failure that this fault leaves, above noise.
        energy: Of the residuals that this fault leaves, parameters fitted.
        onset: Most likely sample.
        x: State of the plant now, if it is so, shape (s,).
        best: Log likelihood ratio of the best hypothesis with each onset, shape (K,).
    """

    fault: Fault
    actuator_confidence: float
    kind_confidences: tuple[float, ...]
    fault_free_confidence: float
    inflation: float
    unexplained: float
    energy: float
    onset: int
    x: Array
    best: Array


@dataclass(frozen=True)
class HypothesisBank:
    """Hypotheses about the actuators that still work: none failed, then locked and weak by turns.

    Attributes:
        faults: Of each hypothesis but the first, H - 1; weak ones that have lost all are free.
        effectiveness: That actuators 0..n-1 are believed to have, shape (n,).
        believed: The plant with the known faults.
        models: Of all H.
        A: Of the models, shape (H, s, s); and so on.
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
        self, state: Evidence, sample: int, v: Array, y: Array, whitening: Array, shaken: float
    ) -> Evidence:
        """One sample of evidence.

        Args:
            state: Before it.
            sample: Its number.
            v: Inputs of the models, shape (r,).
            y: Mean outputs in units of their noise, shape (p,).
            whitening: Weights (q + 1, p) of the newest to the oldest residual.
            shaken: By how much an actuator may lock off its place, as an output sees it, in
                standard deviations of noise.
        """
        X, memory, information, score, energy = (
            part.copy()
            for part in (state.X, state.memory, state.information, state.score, state.energy)
        )
        now, steps = state.onsets == sample, np.zeros(state.energy.shape, dtype=bool)
        steps[1:], steps[0, 0] = state.onsets <= sample, True
        later = np.zeros((len(X), X.shape[-1]))
        if now.any():  # until then each hypothesis is the first one
            for part in (X, memory, information, score, energy):
                part[1:, now] = part[0, 0]
            believed, sound = self.believed, X[0, 0, :-2]
            later = self.onset @ (believed.A @ sound[0] + believed.M[0] @ [*sound[0], *v])
            X[1:, now] = (X[0, 0] @ self.onset[1:].swapaxes(-1, -2))[:, None]
        outputs = np.zeros((*X.shape[:3], len(y)))
        advance(steps, X, outputs, self.A, self.M, self.C, self.N, v)
        if now.any():
            X[1:, now, -2] = _ONSET_SPREAD * (later[1:, None] - X[1:, now, 0])
            X[1:, now, -1] = shaken * self.further[1:, None]
        weigh(
            steps,
            memory,
            information,
            score,
            energy,
            outputs,
            self._part_slopes(outputs[:, :, 0]),
            y,
            state.prior.mean,
            whitening,
        )
        return replace(
            state,
            samples=state.samples + 1,
            X=X,
            memory=memory,
            information=information,
            score=score,
            energy=energy,
        )

    def _part_slopes(self, outputs: Array) -> Array:
        """What a standard deviation of the part lost within its cell adds to outputs (H, K, p)."""
        slopes = np.zeros_like(outputs)
        m = 1 + len(LOST)
        lost = outputs[1:].reshape(-1, m, *outputs.shape[1:])[:, 1:]
        sound = np.broadcast_to(outputs[0, 0], lost[:, :1].shape)
        edges = np.concatenate([sound, lost, 2 * lost[:, -1:] - lost[:, -2:-1]], axis=1)
        by_part = (edges[:, 2:] - edges[:, :-2]) / (2 * LOST[0]) * _PART_SPREAD
        slopes[1:].reshape(-1, m, *outputs.shape[1:])[:, 1:] = by_part
        return slopes

    def verdict(self, state: Evidence, sample: int) -> Verdict:
        """Probabilities of the hypotheses; a priori, failure and no failure are equally likely."""
        energy, log_det, parameters = state.marginal()
        plain = -energy / 2 - log_det
        ratios = plain[1:] - plain[0, 0]
        h, k = np.unravel_index(int(ratios.argmax()), ratios.shape)
        p = state.memory.shape[-1]
        after = max(sample - int(state.onsets[k]) + 1, 1)
        excess = max(float(energy[1 + h, k]) - state.samples * p, 0.0)
        inflation = 1 + excess / (after * p)
        ratios = ratios / inflation
        m = 1 + len(LOST)
        by_onset = logsumexp(ratios.reshape(-1, m, ratios.shape[-1]), axis=-1)
        by_kind = np.stack(
            [by_onset[:, 0], by_onset[:, -1], logsumexp(by_onset[:, 1:-1], axis=1)], axis=1
        )
        by_actuator = logsumexp(by_kind, axis=1)
        total = np.logaddexp(logsumexp(by_actuator), np.log(ratios.size))
        a = int(by_actuator.argmax())
        own = ratios.reshape(-1, m, ratios.shape[-1])[a]
        i, k = np.unravel_index(int(own.argmax()), own.shape)
        h = 1 + a * m + int(i)
        found = parameters[h, k]
        fault = self.faults[h - 1]
        if fault.kind == "weak":
            part = 1 - fault.effectiveness / self.effectiveness[fault.actuator]
            part = float(np.clip(part + _PART_SPREAD * found[-1], _LEAST, 1 - _LEAST))
            left = float(self.effectiveness[fault.actuator]) * (1 - part)
            fault = replace(fault, effectiveness=left)
        gained = float(energy[0, 0] - energy[h, k])
        noise = 4 * np.sqrt(2 * state.samples * p)
        X, J = state.X[h, k], len(state.X[h, k]) - 3
        return Verdict(
            fault=fault,
            actuator_confidence=float(np.exp(by_actuator[a] - total)),
            kind_confidences=tuple(np.exp(by_kind[a] - by_actuator[a]).tolist()),
            fault_free_confidence=float(np.exp(np.log(ratios.size) - total)),
            inflation=inflation,
            unexplained=max(excess - noise, 0.0) / max(gained + excess, 1e-12),
            energy=float(energy[h, k]),
            onset=int(state.onsets[k]),
            x=X[0] + (state.prior.mean[:J] + found[:J]) @ X[1:-2] + found[-3:-1] @ X[-2:],
            best=ratios.max(axis=0),
        )


def _into(best: Array, spreads: Array, low: Array, high: Array) -> Array:
    """The most likely pairs (..., 2) within a box, of Gaussians about `best`.

    At the optimum one of those beyond a bound is at this bound, and the other as likely as it gets.
    """
    candidates, distances = [], []
    for k in (0, 1):
        z = best.clip(low, high)
        along = spreads[..., k, 1 - k] / spreads[..., k, k] * (z - best)[..., k]
        z[..., 1 - k] = (best[..., 1 - k] + along).clip(low[..., 1 - k], high[..., 1 - k])
        candidates.append(z)
        off = (z - best)[..., None]
        distances.append((off * np.linalg.solve(spreads, off)).sum(axis=(-1, -2)))
    return np.where((distances[0] <= distances[1])[..., None], *candidates)


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
    known = [
        [*(each for each in faults if each.actuator != fault.actuator), fault] for fault in one_more
    ]
    models = [uncertain_model(plant, each, **options) for each in ([*faults], *known)]
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
    return HypothesisBank(tuple(one_more), left, models[0], A, M, C, N, onset, further)
