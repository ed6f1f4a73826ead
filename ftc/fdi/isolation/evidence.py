"""What the samples since an alarm say of each hypothesis, and what its parameters may be.

Given its parameters, a hypothesis leaves residuals that are white noise, in which they are linear:
all that matters of the samples are sums of products of the whitened residuals and of what each
parameter would add to them (the normal equations of linear regression).
"""

from dataclasses import dataclass, replace

import numpy as np

from argument_checks import Array, Indices, Mask
from ftc.fdi.detection.parameter_filter import Parameters
from kernels import lib, pointer

LOST = (0.25, 0.5, 0.75, 1.0)
"""Parts of an actuator's force that the models have lost. Within an eighth of each the part is one
more unknown parameter, of which the outputs are taken as linear."""

PART_SPREAD = 0.25 / np.sqrt(12)
ONSET_SPREAD = 1 / np.sqrt(12)
"""Standard deviations within a cell, of the part lost and of the onset, in samples."""

LEAST_LOST = 0.02
"""A smaller loss is no failure."""

EXTRA = 4
"""Parameters of a hypothesis beside errors of the model and offsets: its onset; two more of its
own, such as the place of a locked actuator, or the constant and the growth of an offset; and the
part lost."""

_CELLS = [-EXTRA, -1]
"""Places of onset and part lost among the parameters."""


@dataclass(frozen=True)
class Evidence:
    """For H hypotheses and K onsets: states, and sums of products of whitened residuals.

    Attributes:
        onsets: Samples, ascending, shape (K,).
        prior: Parameters when the first of them began.
        samples: Of evidence so far.
        X: States, shape (H, K, 4 + J, s): of the model, of its errors, and what an onset later, and
            both parameters of its own, by a standard deviation each, would add.
        memory: Latest residuals and regressors before whitening, newest last, shape
            (H, K, q + 1, 5 + J, p).
        information: Sum of products of the regressors: rows of the lower triangle, one after
            another, shape (H, K, R (R + 1) / 2).
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
        """With all parameters integrated out; the onset and the part lost stay in their cells.

        Returns:
            Energy of the residuals that is left, (H, K); log of the square root of the determinant
            of their covariance, (H, K); and the most likely parameters, less their prior mean,
            (H, K, R).
        """
        R = self.score.shape[-1]
        spread, room = np.zeros((R, R)), np.empty(R * (2 * R + 1))
        spread[:-EXTRA, :-EXTRA] = self.prior.root
        spread[-EXTRA:, -EXTRA:] = np.eye(EXTRA)
        score = self.score @ spread
        solved = np.zeros((*score.shape, 3))
        solved[..., 0], solved[..., _CELLS, [1, 2]] = score, 1.0
        log_det = np.empty(self.energy.shape)
        given = pointer(self.information), pointer(spread), pointer(room)
        lib.integrate_out(log_det.size, R, *given, pointer(solved), pointer(log_det))
        root = solved[..., 0]
        energy = self.energy - (score * root).sum(axis=-1)
        spreads = solved[..., _CELLS, 1:]
        moved = _into(root[..., _CELLS], spreads, *self.cells) - root[..., _CELLS]
        pull = np.linalg.solve(spreads, moved[..., None])
        energy = energy + (moved * pull[..., 0]).sum(axis=-1)
        root = root + (solved[..., 1:] @ pull)[..., 0]
        return energy, log_det, root @ spread.T

    @property
    def cells(self) -> tuple[Array, Array]:
        """Least and largest onset and part lost, about those of each hypothesis, (H, 1, 2) each."""
        high = np.full((len(self.energy), 1, 2), np.sqrt(3.0))
        low, m = -high, 1 + len(LOST)
        low[2::m, 0, 1] = (LEAST_LOST - LOST[0]) / PART_SPREAD
        high[m::m, 0, 1] = 0.0
        return low, high

    def only(self, kept: Mask) -> "Evidence":
        """The evidence of some onsets, bool (K,)."""
        parts = {}
        for name in ("X", "memory", "information", "score", "energy"):
            whole = getattr(self, name)
            parts[name] = np.compress(kept, whole, axis=1)
            for h in (0, -1):  # no failure, which has no onset
                parts[name][h, 0] = whole[h, 0]
        return replace(self, onsets=self.onsets[kept], **parts)


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
