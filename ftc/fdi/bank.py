"""Bank of failure hypotheses and the evidence for each of them.

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
"""Lost fractions of an actuator's force in the models. Within an eighth of each the fraction is a
further unknown parameter, in which the outputs are linearized."""

PART_SPREAD = LOST[0] / np.sqrt(12)
ONSET_SPREAD = 1 / np.sqrt(12)
"""Standard deviation of a uniform variable in a cell, in cell widths. A cell of the lost fraction
is a quarter wide, one of the onset a sample, the resolution of the averaged outputs."""

LEAST_LOST = 0.02
"""Smallest lost fraction of a failure: standard deviation of a healthy actuator's gain."""

EXTRA = 4
"""Number of parameters of a hypothesis in addition to model errors and offsets: its onset; two
specific ones, such as the displacement of a locked actuator, or the constant and the growth of an
offset; and the lost fraction."""

_SUMS = ("memory", "information", "score", "energy")
"""Arrays of evidence that accumulate over the samples."""

_CELLS = [-EXTRA, -1]
"""Indices of onset and lost fraction among the parameters."""

_UNSEEN = 1e-12
"""Relative effect on the outputs below which it is round-off and not divided by."""


Models = Callable[[Sequence[Fault]], UncertainModel]
"""Function that returns the uncertain model of a plant with given faults."""


@dataclass(frozen=True)
class Cause:
    """Sudden change of the outputs that is not a failure and needs no other mapping.

    It is an offset of one actuator's command, constant or growing, or a common change of the gain
    of all commands (supply) or of all sensors (scale).
    """

    kind: Literal["offset", "supply", "scale"]
    actuator: int = -1


@dataclass(frozen=True)
class Evidence:
    """Evidence of H hypotheses and K onsets: states, and sums of products of whitened residuals.

    The sums are the normal equations of a linear regression on the R parameters.

    Attributes:
        onsets: Candidate onsets, sample numbers in ascending order, shape (K,).
        prior: Prior of the parameters at the first onset.
        samples: Number of samples so far.
        X: States, shape (H, K, 4 + J, s): of the model, and their sensitivities to the J model
            errors, the onset and both specific parameters, by a standard deviation each.
        memory: Latest residuals and regressors before whitening, newest last, shape
            (H, K, q + 1, 5 + J, p).
        information: Information matrix, its lower triangle by rows, shape (H, K, R (R + 1) / 2).
        score: Products of regressors and residuals, shape (H, K, R).
        energy: Sums of squares of the residuals, shape (H, K).
        gain: Log of the determinant of the last hypothesis' whitening filter over that of the
            others, summed over the samples.
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
        """Integrate out all parameters; onset and lost fraction stay within their cells.

        Returns:
            Remaining energy of the residuals, (H, K); log of the square root of the determinant of
            their covariance, (H, K); and the most likely parameters minus their prior mean,
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
        high = np.full((len(energy), 1, 2), np.sqrt(3.0))  # of the cells about the hypotheses
        low, m = -high, 1 + len(LOST)
        low[2::m, 0, 1], high[m::m, 0, 1] = (LEAST_LOST - LOST[0]) / PART_SPREAD, 0.0
        spreads = solved[..., _CELLS, 1:]
        moved = _into(root[..., _CELLS], spreads, low, high) - root[..., _CELLS]
        pull = np.linalg.solve(spreads, moved[..., None])
        energy = energy + (moved * pull[..., 0]).sum(axis=-1)
        root = root + (solved[..., 1:] @ pull)[..., 0]
        return energy, log_det, root @ spread.T

    def only(self, mask: Mask) -> "Evidence":
        """Return the evidence of the onsets in a mask (K,)."""
        parts = {}
        for name in ("X", *_SUMS):
            array = getattr(self, name)
            parts[name] = np.compress(mask, array, axis=1)
            for h in (0, -1):  # hypotheses without an onset
                parts[name][h, 0] = array[h, 0]
        return replace(self, onsets=self.onsets[mask], **parts)


def _into(best: Array, spreads: Array, low: Array, high: Array) -> Array:
    """Return the most likely pairs (..., 2) within a box, for Gaussians about `best`.

    At the optimum outside the box, one component is at its bound and the other is conditionally
    optimal.
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

    Each hypothesis is a linear model driven by the commands of the plant, with the same unknown
    parameters, offsets of the sensors included. Its residuals, whitened by the spectrum measured
    before the alarm, are linear in the parameters plus white noise, so that the likelihood with all
    parameters integrated out is Gaussian.

    Hypothesis 0 is no further failure, 1..F are one further failure each, and F + 1..H - 2 are
    causes, sudden changes that need no other mapping. The last one is a slow disturbance: the first
    model with a filter of the residuals that is decoupled from slow unknown inputs (Chen and
    Patton, Robust Model-Based Fault Diagnosis, 1999, chapter 3).

    Attributes:
        faults: Faults of the hypotheses 1..F; total loss of force is `free`.
        causes: Causes of the hypotheses F + 1..H - 2.
        effectiveness: Assumed effectiveness of the actuators 0..n-1, shape (n,).
        base_model: Model of the plant with the known faults.
        models: All H models, with their specific parameters after the model errors.
        placed: Change of the state at the onset per standard deviation of the first specific
            parameter, in units of output noise, shape (H, s).
        scaled: Relative change of the state at the onset per standard deviation of the first
            specific parameter, shape (H,).
    """

    faults: tuple[Fault, ...]
    causes: tuple[Cause, ...]
    effectiveness: Array
    base_model: UncertainModel
    models: UncertainModel
    placed: Array
    scaled: Array

    def start(self, onsets: Indices, prior: Parameters, X: Array, memory: Array) -> Evidence:
        """Return empty evidence before the first of these ascending onsets, samples (K,).

        `prior` and the base model's state X (1 + J, s) are those at the first onset; `memory`
        (q + 1, 1 + J, p) has the residuals and regressors of the samples before, not whitened.
        """
        H, K, R = len(self.scaled), len(onsets), prior.mean.size + EXTRA
        q, rows, p = memory.shape
        memories = np.zeros((H, K, q, rows + EXTRA, p))
        states = np.zeros((H, K, rows + EXTRA - 1, X.shape[1]))
        for h in (0, -1):  # until its onset each of the others equals the first one
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
        """Add one sample to the evidence; unmeasured outputs are replaced by predictions.

        Args:
            state: Evidence before the sample.
            sample: Sample to add; only a complete one is evidence.
            shaken: Standard deviation of the displacement at which an actuator locks, in units of
                output noise.
            whitening: Weights (q + 1, p) of the newest to the oldest residual.
            decoupled: Weights of the last hypothesis; None: `whitening`.
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
        """Return states after a sample and outputs during it, for the mask `steps` (H, K)."""
        X, now = state.X.copy() if copy else state.X, state.onsets == sample.number
        onset = self.models.onset
        later = np.zeros((len(X), X.shape[-1]))
        if now.any():  # until then each hypothesis equals the first one
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
        """Return the slopes (H, K, p) of outputs per standard deviation of the lost fraction."""
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
    """Make the hypotheses of a mechanism with known faults, for samples of `ticks` ticks.

    Weak actuators may get weaker, lock or become free.
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
    """Make only `base_model` of :func:`hypothesis_bank`, since the other models take most time."""
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
    """Return the remaining effectiveness (n,) of actuators with these faults, not all zero."""
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
    """Make the hypotheses of one more failure of any plant with n actuators.

    `lock_displacement` (n, s) is the change of the state if an actuator locks further out by one
    standard deviation of output noise. `command`, `supply` and `scale` of `disturbances` may occur
    in addition to failures.
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
    """List possible next faults, grouped by actuator, then alternatives to the known faults.

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
    """List the possible causes other than failures; a supply change needs two actuators."""
    working = np.flatnonzero(remaining).tolist()
    causes = [Cause("offset", k) for k in working if disturbances.command > 0]
    causes += [Cause("supply")] if disturbances.supply > 0 and len(working) > 1 else []
    return causes + ([Cause("scale")] if disturbances.scale > 0 else [])


def _cause_drives(
    base_model: UncertainModel, cause: Cause, disturbances: Uncertainty, sample_s: float
) -> Array:
    """Return [M; N] per standard deviation of a cause's two parameters, (2, s + p, s + r)."""
    driven, s = np.vstack([base_model.M[0], base_model.N[0]]), len(base_model.A)
    drives, k = np.zeros((2, *driven.shape)), s + cause.actuator
    if cause.kind == "offset":  # its standard deviation finally moves an output by `command`
        states = at_rest(base_model.A, base_model.M[0, :, k : k + 1], sample_s)
        visible = np.linalg.norm(base_model.C @ states + base_model.N[0, :, k : k + 1])
        drives[0, :, -1] = disturbances.command / max(visible, _UNSEEN) * driven[:, k]
        drives[1, :, -1] = sample_s * drives[0, :, -1]
    if cause.kind == "supply":
        drives[0, :, s:-1] = disturbances.supply * driven[:, s:-1]
    if cause.kind == "scale":
        drives[0] = disturbances.scale * driven
    return drives
