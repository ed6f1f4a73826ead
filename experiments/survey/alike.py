"""Which inputs of an effectiveness matrix no sensor of its effects tells apart.

A failure of an input changes the effects along its column. Two failures whose columns are parallel
look alike, however well the effects are measured and whatever the inputs do; any others differ in
direction. Inputs without effect are not seen at all.
"""

from dataclasses import dataclass

import numpy as np
from scipy.sparse.csgraph import connected_components

from argument_checks.ties import least
from sim import Array


@dataclass(frozen=True)
class Columns:
    """Single failures of n inputs, by the directions of their columns.

    Attributes:
        groups: Two or more inputs each, 0..n-1, whose columns are parallel.
        unseen: Inputs without effect.
        nearest: Of the others the two whose columns are nearest, from different groups; None where
            there are none.
        angle_deg: Between these, each effect in units of its row's norm.
    """

    groups: tuple[tuple[int, ...], ...]
    unseen: tuple[int, ...]
    nearest: tuple[int, int] | None
    angle_deg: float | None

    def isolable(self, n: int) -> list[int]:
        """Inputs whose failure looks like no other's, of all n."""
        alike = {k for group in self.groups for k in group} | set(self.unseen)
        return [k for k in range(n) if k not in alike]


def alike_columns(B: Array, tolerance: float) -> Columns:
    """Parallel columns of a matrix (m, n).

    Args:
        B: Effects per input.
        tolerance: Fraction of the scale below which a singular value is zero, as of the rank
            decisions of a :class:`prioritized.ConstrainedSystem`: of two columns of norm one.
    """
    rows = np.linalg.norm(B, axis=1, keepdims=True)
    scaled = np.divide(B, rows, out=np.zeros_like(B), where=rows > 0.0)
    size = np.linalg.norm(scaled, axis=0)
    seen = np.flatnonzero(size > tolerance * size.max(initial=0.0))
    unit = (scaled / np.where(size > 0.0, size, 1.0))[:, seen]
    # Of [a, b] the singular values are |a - b| and |a + b| over the root of two.
    apart, sums = (
        np.linalg.norm(unit[:, :, None] + sign * unit[:, None, :], axis=0) for sign in (-1, 1)
    )
    small, large = np.minimum(apart, sums), np.maximum(apart, sums)
    count, of_group = connected_components(small <= tolerance * large, directed=False)
    members = [seen[of_group == k] for k in range(count)]
    groups = tuple(tuple(each.tolist()) for each in members if len(each) > 1)
    unseen = tuple(np.setdiff1d(np.arange(B.shape[1]), seen).tolist())
    if count < 2:
        return Columns(groups, unseen, None, None)
    between = np.where(of_group[:, None] == of_group, np.inf, small)
    i, j = divmod(least(between.ravel()), len(seen))
    angle_deg = float(np.rad2deg(2 * np.arctan2(small[i, j], large[i, j])))
    return Columns(groups, unseen, (int(seen[i]), int(seen[j])), angle_deg)
