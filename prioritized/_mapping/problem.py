"""Checked arguments common to Problems 1 and 6."""

from collections.abc import Callable, Sequence
from math import prod
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

import argument_checks as check
from argument_checks import Array, Mask
from prioritized._mapping.task import task_selection
from prioritized._solver.arrays import none, product
from prioritized._solver.rank import RANK_TOLERANCE, frobenius, norm, ranked_svd

_LEAST, _MOST = 1e-50, 1e50
"""Norms of weights between which products with any J neither under- nor overflow."""


class Problem(NamedTuple):
    """Checked copies of the arguments of a mapping; absent ones have no rows or columns."""

    J: Array  # (..., m, n)
    S_m: Array  # (m1, m)
    S_s: Array  # (m2, m)
    weight: Array  # W1 or W3, (..., k, n)
    secondary_weight: Array  # W2 or W4, (..., k, m2)
    active_constraint: Array  # C, (..., r, n)
    self_motion: Array  # Q, (..., m, k)
    major_metric: Array | None  # M, (..., k, m1); None is the identity
    tie_metric: Array  # T, (..., k, n)
    scale: Array  # size of J, (...)
    tolerance: float  # of the rank decisions
    lead: tuple[int, ...]  # batch axes of the result

    @property
    def major_jacobian(self) -> Array:
        """Jacobian of the major task, shape (..., m1, n)."""
        return product(self.S_m, self.J)

    @property
    def admissible_jacobian(self) -> Array:
        """J on the admissible rates, zero on those that the constraint forbids, (..., m, n)."""
        C = self.active_constraint
        if not C.size:
            return self.J
        return self.J @ ranked_svd(C, frobenius(C), self.tolerance).null_projector()

    @property
    def task_weight(self) -> Array:
        """Secondary weight on the task, shape (..., k, m)."""
        return product(self.secondary_weight, self.S_s)

    @property
    def has_ties(self) -> bool:
        """Return whether the least norm of all unknowns breaks ties, as without weights on all."""
        W, n = self.weight, self.J.shape[-1]
        is_positive = W.ndim == 2 and len(W) == n and bool(W.diagonal().all())
        return not self.tie_metric.size and not (is_positive and np.count_nonzero(W) == n)

    @property
    def exact(self) -> float:
        """Factor from `tolerance` to the tolerance of ranks that do not depend on J.

        Weights are exact up to round-off, also if the geometry is inaccurate.
        """
        return exact_part(self.tolerance)

    def natural(self, task_units: Array, rate_units: Array | float) -> "Problem":
        """Return the problem for a J (..., m, n) with rows and columns in these natural units.

        Major and secondary task stay in their own units, rates are in the natural ones.
        """
        return self._replace(
            S_m=self.S_m * task_units,
            S_s=self.S_s * task_units,
            weight=self.weight * rate_units,
            tie_metric=self.tie_metric * rate_units,
        )

    def flat(self) -> "Problem":
        """Return the same problems with one batch axis, on those arrays that have any."""

        def flattened(A: Array, axes: int) -> Array:
            if A.ndim == axes:
                return A
            shape = A.shape[A.ndim - axes :]
            return np.broadcast_to(A, (*self.lead, *shape)).reshape(prod(self.lead), *shape)

        return self._map(flattened, lead=(prod(self.lead),))

    def part(self, which: slice | Mask) -> "Problem":
        """Return some problems of a flat batch."""
        return self._map(
            lambda A, axes: A if A.ndim == axes else A[which],
            lead=np.empty(self.lead, dtype=bool)[which].shape,
        )

    def _map(self, change: Callable[[Array, int], Array], lead: tuple[int, ...]) -> "Problem":
        """Apply a function of an array and its number of unbatched axes to each batchable array."""
        M = self.major_metric
        return self._replace(
            J=change(self.J, 2),
            weight=change(self.weight, 2),
            secondary_weight=change(self.secondary_weight, 2),
            active_constraint=change(self.active_constraint, 2),
            self_motion=change(self.self_motion, 2),
            major_metric=None if M is None else change(M, 2),
            tie_metric=change(self.tie_metric, 2),
            scale=change(np.asarray(self.scale), 0),
            lead=lead,
        )


def exact_part(tolerance: float) -> float:
    """Return the fraction of a rank tolerance that round-off alone would need."""
    return min(1.0, RANK_TOLERANCE / tolerance) if tolerance else 1.0


def checked(
    J: ArrayLike,
    major: Sequence[int] | ArrayLike,
    secondary: Sequence[int] | ArrayLike | None,
    *,
    weight_name: str = "weight",
    weight: ArrayLike | None = None,
    secondary_weight: ArrayLike | None = None,
    active_constraint: ArrayLike | None = None,
    self_motion: ArrayLike | None = None,
    major_metric: ArrayLike | None = None,
    tie_metric: ArrayLike | None = None,
    scale: ArrayLike | None = None,
    rank_tolerance: float = RANK_TOLERANCE,
) -> Problem:
    """Check the arguments of a mapping; `weight_name` is the caller's name of `weight`."""
    J = check.array("J", J, ..., None, None, copy=True)
    m, n = J.shape[-2:]
    tolerance = check.number("rank_tolerance", rank_tolerance, 0.0, 0.5)
    S_m, S_s = task_selection(major, secondary, m, tolerance)
    m1, m2 = len(S_m), len(S_s)
    W = _weight(weight_name, weight, n)
    W_s = _weight("secondary_weight", secondary_weight, m2)
    T = _weight("tie_metric", tie_metric, n)
    if W.size or W_s.size:
        W, W_s = _of_moderate_size(W, W_s)
    if T.size:
        (T,) = _of_moderate_size(T)
    M = None if major_metric is None else _metric(major_metric, m1, tolerance)
    C, Q = none((0, n)), none((m, 0))
    if active_constraint is not None:
        C = check.array("active_constraint", active_constraint, ..., None, n, copy=True)
    if self_motion is not None:
        Q = check.array("self_motion", self_motion, ..., m, None, copy=True)
    size = frobenius(J) if scale is None else check.array("scale", scale, least=0.0, copy=True)
    if size.ndim > J.ndim - 2:
        raise ValueError(f"scale must have the leading axes of J, got shape {size.shape}")
    M_axes = 2 if M is None else M.ndim
    if J.ndim == W.ndim == W_s.ndim == C.ndim == Q.ndim == T.ndim == M_axes == 2:
        return Problem(J, S_m, S_s, W, W_s, C, Q, M, T, size, tolerance, lead=())
    batches = {
        "J": J,
        weight_name: W,
        "secondary_weight": W_s,
        "active_constraint": C,
        "self_motion": Q,
        "major_metric": S_m if M is None else M,
        "tie_metric": T,
    }
    leads = {name: A.shape[:-2] for name, A in batches.items()}
    lead = check.common_axes(leads | {"scale": size.shape})
    return Problem(J, S_m, S_s, W, W_s, C, Q, M, T, size, tolerance, lead)


def _weight(name: str, value: ArrayLike | None, size: int) -> Array:
    return none((0, size)) if value is None else check.weight(name, value, size)


def _of_moderate_size(*weights: Array) -> tuple[Array, ...]:
    """Scale the weights of one sum by one power of two if products could under- or overflow.

    Only their ratios matter; the solution is identical, round-off included.
    """
    for W in weights:  # the common case
        if W.ndim == 2 and _LEAST < norm(W) < _MOST:
            return weights
    sizes = [np.abs(W).max(axis=(-2, -1), initial=0.0) for W in weights]
    size = np.maximum.reduce(np.broadcast_arrays(*sizes))
    extreme = (size > 0.0) & ((size < _LEAST) | (size > _MOST))
    if not extreme.any():
        return weights
    exponent = np.where(extreme, np.frexp(size)[1], 0)[..., None, None]
    return tuple(np.ldexp(W, -exponent) for W in weights)


def _metric(value: ArrayLike, m1: int, tolerance: float) -> Array:
    M = check.array("major_metric", check.weight("major_metric", value, m1), ..., None, m1)
    if np.any(ranked_svd(M, frobenius(M), tolerance).rank < m1):
        got = check.short_repr(value)
        raise ValueError(f"major_metric must weigh every major direction, got {got}")
    return M
