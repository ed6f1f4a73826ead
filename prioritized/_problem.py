"""The checked arguments that Problems 1 and 6 have in common."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from prioritized import _check
from prioritized._check import Array
from prioritized._rank import frobenius, ranked_svd
from prioritized._task import task_selection


@dataclass(frozen=True)
class Problem:
    """Arguments of a mapping as checked arrays; what was None has no rows or columns.

    Attributes:
        J: (..., m, n).
        S_m: (m1, m); `S_s`: (m2, m).
        weight: W1 or W3, (..., k, n); `secondary_weight`: W2 or W4, (..., k, m2).
        active_constraint: C, (..., r, n); `self_motion`: Q, (..., m, k).
        major_metric: M, (..., k, m1); `tie_metric`: T, (..., k, n).
        scale: Size of J, shape (...).
        tolerance: Of the rank decisions.
        lead: Batch axes of the answer.
    """

    J: Array
    S_m: Array
    S_s: Array
    weight: Array
    secondary_weight: Array
    active_constraint: Array
    self_motion: Array
    major_metric: Array
    tie_metric: Array
    scale: Array
    tolerance: float
    lead: tuple[int, ...]


def checked(
    J: ArrayLike,
    major: Sequence[int] | ArrayLike,
    secondary: Sequence[int] | ArrayLike | None,
    *,
    weight_name: str,
    weight: ArrayLike | None,
    secondary_weight: ArrayLike | None,
    active_constraint: ArrayLike | None,
    self_motion: ArrayLike | None,
    major_metric: ArrayLike | None,
    tie_metric: ArrayLike | None,
    scale: ArrayLike | None,
    rank_tolerance: float,
) -> Problem:
    """Check every argument of a mapping; `weight_name` is what its caller calls `weight`.

    Raises:
        ValueError: Wrong shape, index or non-finite input, naming the argument.
    """
    J = _check.batch("J", J)
    m, n = J.shape[-2:]
    tolerance = _check.fraction("rank_tolerance", rank_tolerance)
    S_m, S_s = task_selection(major, secondary, m, tolerance)
    m1, m2 = len(S_m), len(S_s)
    W = _check.weight(weight_name, _no_rows(weight, n), n)
    W_s = _check.weight("secondary_weight", _no_rows(secondary_weight, m2), m2)
    C = _check.batch("active_constraint", _no_rows(active_constraint, n), columns=n)
    Q = np.zeros((m, 0)) if self_motion is None else self_motion
    Q = _check.batch("self_motion", Q, rows=m)
    M = np.eye(m1)
    if major_metric is not None:
        M = _check.weight("major_metric", major_metric, m1)
        if np.any(ranked_svd(M, frobenius(M), tolerance).rank < m1):
            raise ValueError(f"major_metric must weigh every major direction, got {major_metric}")
    T = _check.weight("tie_metric", _no_rows(tie_metric, n), n)
    size = frobenius(J) if scale is None else _check.not_negative("scale", scale)
    if not np.isfinite(size).all():
        raise ValueError(f"J must be of a size whose square is finite, got {np.abs(J).max():.0e}")
    if size.ndim > J.ndim - 2:
        raise ValueError(f"scale must have the leading axes of J, got shape {size.shape}")
    lead = _check.common_axes(
        {
            "J": J.shape[:-2],
            weight_name: W.shape[:-2],
            "secondary_weight": W_s.shape[:-2],
            "active_constraint": C.shape[:-2],
            "self_motion": Q.shape[:-2],
            "major_metric": M.shape[:-2],
            "tie_metric": T.shape[:-2],
            "scale": size.shape,
        }
    )
    return Problem(J, S_m, S_s, W, W_s, C, Q, M, T, size, tolerance, lead)


def _no_rows(value: ArrayLike | None, columns: int) -> ArrayLike:
    """What is None counts as a matrix without rows."""
    return np.zeros((0, columns)) if value is None else value
