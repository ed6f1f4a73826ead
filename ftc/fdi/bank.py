"""Bank of hypotheses: what may have happened, and what each sample says of each possibility.

Multiple-model estimation (Magill, IEEE Trans. Automatic Control 10, 1965) over the time of onset
(Willsky and Jones, IEEE Trans. Automatic Control 21, 1976), with nuisance parameters.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal

import numpy as np

from argument_checks import Array, Indices, Mask
from argument_checks.records import changed
from ftc.fdi.fault_model import Fault, NominalModel, at_rest, fault_model, of_actuators
from ftc.fdi.observer import Parameters, Sample
from ftc.fdi.uncertainty import (
    CERTAIN,
    UncertainModel,
    Uncertainty,
    perturbed,
    side_by_side,
    uncertain_model,
)
from kernels import ffi, lib, pointer

LOST = (0.25, 0.5, 0.75, 1.0)
"""Parts of an actuator's force that the models have lost. Within an eighth of each the part is one
more unknown parameter, of which the outputs are taken as linear."""

PART_SPREAD = LOST[0] / np.sqrt(12)
ONSET_SPREAD = 1 / np.sqrt(12)
"""Standard deviations of a uniform variable within a cell: of the part lost, which is a quarter
wide, and of the onset, which is one sample, the resolution of the means that are compared."""

LEAST_LOST = 0.02
"""A smaller loss is no failure: it is one standard deviation of the gain of a healthy actuator."""

EXTRA = 4
"""Parameters of a hypothesis beside errors of the model and offsets: its onset; two more of its
own, such as the place of a locked actuator, or the constant and the growth of an offset; and the
part lost."""

_SUMS = ("memory", "information", "score", "energy")
"""Arrays of evidence that each sample adds to."""

_CELLS = [-EXTRA, -1]
"""Places of onset and part lost among the parameters."""

_UNSEEN = 1e-12
"""What moves no output: less than that is round-off, and not divided by."""


Models = Callable[[Sequence[Fault]], UncertainModel]
"""Uncertain model of a plant with any faults."""


@dataclass(frozen=True)
class Cause:
    """Sudden change of the outputs that is no failure and asks for no other mapping.

    An actuator works from another zero, which may move; all commands do more or less than before;
    all sensors show more or less.
    """

    kind: Literal["offset", "supply", "scale"]
    actuator: int = -1


@dataclass(frozen=True)
class Evidence:
    """Evidence of H hypotheses and K onsets: states, and sums of products of whitened residuals.

    These are the normal equations of a linear regression on what each parameter would add.

    Attributes:
        onsets: Samples, ascending, shape (K,).
        prior: Parameters when the first of them began.
        samples: Number of them.
        X: States, shape (H, K, 4 + J, s): of the model, of its errors, and what an onset later, and
            both parameters of its own, by a standard deviation each, would add.
        memory: Latest residuals and regressors before whitening, newest last, shape
            (H, K, q + 1, 5 + J, p).
        information: Of the regressors, the lower triangle by rows, shape (H, K, R (R + 1) / 2).
        score: Of regressors and residuals, shape (H, K, R).
        energy: Of the residuals, shape (H, K).
        gain: Log of how much less the filter of the last hypothesis amplifies than that of the
            others, so far.
    """

    onsets: Indices
    prior: Parameters
    samples: int
    X: Array
    memory: Array
    information: Array
    score: Array
    energy: Array
    gain: float = 0.0

    def marginal(self) -> tuple[Array, Array, Array]:
        """Integrate out all parameters; the onset and the part lost stay in their cells.

        Returns:
            Energy of the residuals that is left, (H, K); log of the square root of the determinant
            of their covariance, (H, K); and the most likely parameters, less their prior mean,
            (H, K, R).
        """
        R = self.score.shape[-1]
        spread, workspace = np.zeros((R, R)), np.empty(R * (2 * R + 1))
        spread[:-EXTRA, :-EXTRA] = self.prior.root
        spread[-EXTRA:, -EXTRA:] = np.eye(EXTRA)
        score = self.score @ spread
        solved = np.zeros((*score.shape, 3))
        solved[..., 0], solved[..., _CELLS, [1, 2]] = score, 1.0
        log_det = np.empty(self.energy.shape)
        arguments = pointer(self.information), pointer(spread), pointer(workspace)
        lib.integrate_out(log_det.size, R, *arguments, pointer(solved), pointer(log_det))
        root = solved[..., 0]
        energy = self.energy - (score * root).sum(axis=-1)
        high = np.full((len(energy), 1, 2), np.sqrt(3.0))  # of cells about those of hypotheses
        low, m = -high, 1 + len(LOST)
        low[2::m, 0, 1], high[m::m, 0, 1] = (LEAST_LOST - LOST[0]) / PART_SPREAD, 0.0
        spreads = solved[..., _CELLS, 1:]
        moved = _into(root[..., _CELLS], spreads, low, high) - root[..., _CELLS]
        pull = np.linalg.solve(spreads, moved[..., None])
        energy = energy + (moved * pull[..., 0]).sum(axis=-1)
        root = root + (solved[..., 1:] @ pull)[..., 0]
        return energy, log_det, root @ spread.T

    def only(self, mask: Mask) -> "Evidence":
        """The evidence of some onsets, bool (K,)."""
        parts = {}
        for name in ("X", *_SUMS):
            array = getattr(self, name)
            parts[name] = np.compress(mask, array, axis=1)
            for h in (0, -1):  # no failure, which has no onset
                parts[name][h, 0] = array[h, 0]
        return replace(self, onsets=self.onsets[mask], **parts)


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


@dataclass(frozen=True)
class HypothesisBank:
    """Hypotheses about a machine with known failures.

    Each is a linear model of its own that runs beside the plant, driven by the same commands, and
    may be wrong in the same unknown parameters, offsets of the sensors included. Given these its
    residuals, whitened by the spectrum measured before the alarm, are white noise in which they are
    linear, so that its likelihood with all parameters integrated out is Gaussian.

    The first one: no more has failed. Then one more failure each. Then causes, null models of what
    is as sudden and asks for no other mapping. The last one is that something else, slow, acts on
    the machine: the model of the first with another filter of its residuals, decoupled from slow
    unknown inputs (Chen and Patton, Robust Model-Based Fault Diagnosis, 1999, chapter 3).

    Attributes:
        faults: Of the hypotheses 1..F; weak ones that have lost all are free.
        causes: Of those from F + 1 to H - 2, which are no failures.
        effectiveness: That actuators 0..n-1 are believed to have, shape (n,).
        believed: The plant with the known faults.
        models: Of all H, with the parameters of their own after the errors.
        placed: State at the onset per standard deviation of a hypothesis' first own parameter, as
            an output sees it, shape (H, s).
        scaled: The same per state at the onset, shape (H,).
    """

    faults: tuple[Fault, ...]
    causes: tuple[Cause, ...]
    effectiveness: Array
    base_model: UncertainModel
    models: UncertainModel
    placed: Array
    scaled: Array

    def start(self, onsets: Indices, prior: Parameters, X: Array, memory: Array) -> Evidence:
        """No evidence yet, before the first of these onsets, samples (K,), ascending.

        With the parameters and the believed model's state X (1 + J, s) then, and residuals and
        regressors of the samples before, before whitening, in `memory` (q + 1, 1 + J, p).
        """
        H, K, R = len(self.scaled), len(onsets), prior.mean.size + EXTRA
        q, rows, p = memory.shape
        memories = np.zeros((H, K, q, rows + EXTRA, p))
        states = np.zeros((H, K, rows + EXTRA - 1, X.shape[1]))
        for h in (0, -1):  # until its onset each of the others is the first one
            memories[h, 0, :, :-EXTRA] = memory
            states[h, 0, :rows] = X
        information, score = np.zeros((H, K, R * (R + 1) // 2)), np.zeros((H, K, R))
        return Evidence(onsets, prior, 0, states, memories, information, score, np.zeros((H, K)))

    def step(
        self,
        state: Evidence,
        sample: Sample,
        shaken: float,
        whitening: Array,
        decoupled: Array | None = None,
        *,
        copy: bool = True,
    ) -> Evidence:
        """Add one sample of evidence; what was not measured goes on as each hypothesis predicts.

        Args:
            state: Before it.
            sample: To be added; it is evidence if it is whole.
            shaken: By how much an actuator may lock off its place, as an output sees it, in
                standard deviations of noise.
            whitening: Weights (q + 1, p) of the newest to the oldest residual.
            decoupled: Weights of the last hypothesis; None: the same.
            copy: Leave the arrays of `state` unchanged; otherwise they are overwritten.
        """
        y, weighs = sample.y, sample.is_complete
        last = whitening if decoupled is None else decoupled
        steps = np.zeros(state.energy.shape, dtype=bool)
        steps[1:-1], steps[[0, -1], 0] = state.onsets <= sample.number, True
        X, outputs = self._advanced(state, sample, shaken, steps, copy)
        sums = [getattr(state, name) for name in _SUMS]
        after = [np.empty_like(array) for array in sums] if copy else sums
        H, K, rows, p = outputs.shape
        J, now = rows - EXTRA, state.onsets == sample.number
        lib.weigh_sample(
            *(H, K, J, p, len(whitening), pointer(steps), pointer(now), weighs),
            ffi.new("evidence *", [pointer(array) for array in sums]),
            pointer(outputs),
            pointer(self._part_slopes(outputs[:, :, 0])),
            pointer(whitening[0] if y is None else y),
            pointer(state.prior.mean),
            pointer(np.tile(np.stack([whitening, last])[:, ::-1], rows + 1)),
            pointer(np.empty(p * (2 * J + p + 12))),
            ffi.new("evidence *", [pointer(array) for array in after]),
        )
        if y is None:
            after[0][steps, -1] = 0.0
        gain = state.gain + weighs * float(np.log(last[0] / whitening[0]).sum())
        sums = dict(zip(_SUMS, after, strict=True))
        return changed(state, samples=state.samples + 1, X=X, gain=gain, **sums)

    def _advanced(
        self, state: Evidence, sample: Sample, shaken: float, steps: Mask, copy: bool
    ) -> tuple[Array, Array]:
        """States after a sample and outputs during it, of the hypotheses that `steps` (H, K)."""
        X, now = state.X.copy() if copy else state.X, state.onsets == sample.number
        onset = self.models.onset
        later = np.zeros((len(X), X.shape[-1]))
        if now.any():  # until then each hypothesis is the first one
            healthy = X[0, 0, : 1 - EXTRA].copy()
            later = onset @ self.base_model.step(healthy, sample.v)[1][0]
            X[1:-1, now] = (X[0, 0] @ onset[1:-1].swapaxes(-1, -2))[:, None]
            X[1:-1, now, -2] = self.scaled[1:-1, None, None] * healthy[0]
        age = np.maximum(sample.number - state.onsets, 0).astype(float)
        outputs = self.models.advance(X, sample.v, steps, age)
        if now.any():
            X[1:-1, now, -3] = ONSET_SPREAD * (later[1:-1, None] - X[1:-1, now, 0])
            X[1:-1, now, -2] += shaken * self.placed[1:-1, None]
        return X, outputs

    def _part_slopes(self, outputs: Array) -> Array:
        """Slopes of outputs (H, K, p) per standard deviation of the part lost within its cell."""
        slopes = np.zeros_like(outputs)
        m = 1 + len(LOST)
        working = slice(1, 1 + m * np.count_nonzero(self.effectiveness))
        lost = outputs[working].reshape(-1, m, *outputs.shape[1:])[:, 1:]
        healthy = np.broadcast_to(outputs[0, 0], lost[:, :1].shape)
        edges = np.concatenate([healthy, lost, 2 * lost[:, -1:] - lost[:, -2:-1]], axis=1)
        by_part = (edges[:, 2:] - edges[:, :-2]) / (2 * LOST[0]) * PART_SPREAD
        slopes[working].reshape(-1, m, *outputs.shape[1:])[:, 1:] = by_part
        return slopes


def hypothesis_bank(
    nominal: NominalModel,
    faults: Sequence[Fault] = (),
    uncertainty: Uncertainty = CERTAIN,
    ticks: int = 1,
) -> HypothesisBank:
    """Make the hypotheses of a mechanism with these known faults, in samples of so many ticks.

    Weak actuators may get weaker, lock or lose all.

    Raises:
        ValueError: No actuator is left that could fail.
    """
    k = nominal.plant.nstates // 2
    push, rows = nominal.plant.B[k:], nominal.displacement[:, :k]
    directions = push / np.einsum("nk,kn->n", rows, push)
    visible = np.linalg.norm(nominal.plant.C[:, :k] @ directions / nominal.noise[:, None], axis=0)
    directions = directions / np.maximum(visible, _UNSEEN * np.linalg.norm(directions, axis=0))
    return bank_of(
        _models(nominal, uncertainty, ticks),
        nominal.actuators,
        faults,
        lock_displacement=np.vstack([directions, np.zeros_like(directions)]).T,
        disturbances=uncertainty,
        sample_s=ticks * nominal.period_s,
    )


def base_model_of(
    nominal: NominalModel, faults: Sequence[Fault], uncertainty: Uncertainty, ticks: int
) -> UncertainModel:
    """Make the first model of :func:`hypothesis_bank` without the others, which take most time."""
    _remaining_effectiveness(faults, nominal.actuators)
    return _models(nominal, uncertainty, ticks)(faults)


def _models(nominal: NominalModel, uncertainty: Uncertainty, ticks: int) -> Models:
    return partial(
        uncertain_model,
        partial(fault_model, nominal),
        others=[partial(fault_model, model) for model in perturbed(nominal, uncertainty)],
        delay_ticks=uncertainty.delay_s / nominal.period_s,
        friction=uncertainty.friction,
        ticks=ticks,
    )


def _remaining_effectiveness(faults: Sequence[Fault], n: int) -> Array:
    """Effectiveness (n,) that actuators with these faults have left."""
    remaining = np.ones(n)
    for fault in of_actuators(faults, n):
        remaining[fault.actuator] = fault.effectiveness if fault.kind == "weak" else 0.0
    if not remaining.any():
        raise ValueError("faults must leave a working actuator, got failures of all of them")
    return remaining


def bank_of(
    models: Models,
    n: int,
    faults: Sequence[Fault] = (),
    *,
    lock_displacement: Array | None = None,
    disturbances: Uncertainty = CERTAIN,
    sample_s: float = 1.0,
) -> HypothesisBank:
    """Make the hypotheses of one more failure of a plant of any kind, with n actuators.

    By how much its state differs with each actuator locked further out, by what an output sees as
    one standard deviation, is `lock_displacement` (n, s). Beside failures `command`, `supply` and
    `scale` of an uncertainty may happen.

    Raises:
        ValueError: No actuator is left that could fail.
    """
    remaining = _remaining_effectiveness(faults, n)
    next_faults, causes = _next_faults(faults, remaining), _causes(remaining, disturbances)
    base_model = models(faults)
    built = [base_model]
    for fault in next_faults:
        others = [known for known in faults if known.actuator != fault.actuator]
        built.append(models([*others, fault]))
    built += [base_model] * (len(causes) + 1)
    stacked, s = side_by_side(built), len(base_model.A)
    drives = np.zeros((len(built), EXTRA - 1, sum(base_model.C.shape), stacked.M.shape[-1]))
    placed, scaled = np.zeros((len(built), s)), np.zeros(len(built))
    for h, fault in enumerate(next_faults, 1):
        if fault.kind == "locked" and lock_displacement is not None:
            placed[h] = lock_displacement[fault.actuator]
    for h, cause in enumerate(causes, 1 + len(next_faults)):
        drives[h, 1:] = _cause_drives(base_model, cause, disturbances, sample_s)
        scaled[h] = disturbances.scale if cause.kind == "scale" else 0.0
    M, N = np.split(drives, [s], axis=2)
    M, N = np.concatenate([stacked.M, M], axis=1), np.concatenate([stacked.N, N], axis=1)
    stacked = replace(stacked, M=M, N=N)
    return HypothesisBank(
        tuple(next_faults), tuple(causes), remaining, base_model, stacked, placed, scaled
    )


def _next_faults(faults: Sequence[Fault], remaining: Array) -> list[Fault]:
    """List what may fail next, in groups of one actuator; then what is known, otherwise.

    A failed actuator may work again, or be locked instead of free, or free instead of locked; a
    weak one counts as working.
    """
    next_faults = []
    for k in np.flatnonzero(remaining).tolist():
        weak = [Fault(k, "weak", float(remaining[k] * (1 - part))) for part in LOST[:-1]]
        next_faults += [Fault(k, "locked"), *weak, Fault(k, "free")]
    for fault in faults:
        next_faults.append(Fault(fault.actuator, "weak", 1.0))
        if fault.kind != "weak":
            other = "free" if fault.kind == "locked" else "locked"
            next_faults.append(Fault(fault.actuator, other))
    return next_faults


def _causes(remaining: Array, disturbances: Uncertainty) -> list[Cause]:
    """List what may happen that is no failure; what all actuators share needs two of them."""
    working = np.flatnonzero(remaining).tolist()
    causes = [Cause("offset", k) for k in working if disturbances.command > 0]
    causes += [Cause("supply")] if disturbances.supply > 0 and len(working) > 1 else []
    return causes + ([Cause("scale")] if disturbances.scale > 0 else [])


def _cause_drives(
    base_model: UncertainModel, cause: Cause, disturbances: Uncertainty, sample_s: float
) -> Array:
    """[M; N] of the two parameters of its own, one standard deviation each, (2, s + p, s + r)."""
    driven, s = np.vstack([base_model.M[0], base_model.N[0]]), len(base_model.A)
    drives, k = np.zeros((2, *driven.shape)), s + cause.actuator
    if cause.kind == "offset":  # as large as moves an output by `command` in the end
        states = at_rest(base_model.A, base_model.M[0, :, k : k + 1], sample_s)
        visible = np.linalg.norm(base_model.C @ states + base_model.N[0, :, k : k + 1])
        drives[0, :, -1] = disturbances.command / max(visible, _UNSEEN) * driven[:, k]
        drives[1, :, -1] = sample_s * drives[0, :, -1]
    if cause.kind == "supply":
        drives[0, :, s:-1] = disturbances.supply * driven[:, s:-1]
    if cause.kind == "scale":
        drives[0] = disturbances.scale * driven
    return drives
