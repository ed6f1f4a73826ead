"""Velocity mapping: Problem 1 of the paper for all weights."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import ArrayLike

from prioritized import _check
from prioritized._check import Array
from prioritized._rank import RANK_TOLERANCE, frobenius, ranked_svd


class Status(Enum):
    """What a mapping can promise about the major task; the value says what to do."""

    EXACT = "every major velocity is reached exactly"
    LEAST_SQUARES = (
        "some major velocities are out of reach and come out as the least-squares best: "
        "see residual(v_major), drop major rows, or give the mechanism back an actuator"
    )


@dataclass(frozen=True)
class VelocityMapping:
    """Gains of the optimal active joint rates; made by :func:`velocity_mapping`.

    rates = major @ v_m + joint @ rates_desired + secondary @ v_s_desired

    Attributes:
        major: (..., n, m1), `joint`: (..., n, n), `secondary`: (..., n, m2).
        achieved: (..., m1, m1), major velocity reached per major velocity asked for.
        rank: Rank of the major task on the admissible rates, shape (...).
        gap: Factor the rank threshold could move before `rank` changed, shape (...).
    """

    major: Array
    joint: Array
    secondary: Array
    achieved: Array
    rank: Array
    gap: Array

    @property
    def status(self) -> Status:
        """EXACT if the major task is reached for every batch element."""
        exact = np.all(self.rank == self.major.shape[-1])
        return Status.EXACT if exact else Status.LEAST_SQUARES

    def __call__(
        self,
        v_major: ArrayLike,
        joint_velocity: ArrayLike | None = None,
        secondary_velocity: ArrayLike | None = None,
    ) -> Array:
        """Optimal active joint rates, shape (..., n); what is None counts as zero."""
        rates = _apply(self.major, "v_major", v_major)
        if joint_velocity is not None:
            rates = rates + _apply(self.joint, "joint_velocity", joint_velocity)
        if secondary_velocity is not None:
            rates = rates + _apply(self.secondary, "secondary_velocity", secondary_velocity)
        return rates

    def residual(self, v_major: ArrayLike) -> Array:
        """Part of the major velocity that is out of reach, shape (..., m1)."""
        v = _check.vector("v_major", v_major, self.major.shape[-1])
        return v - np.einsum("...ij,...j->...i", self.achieved, v)


def velocity_mapping(
    J: ArrayLike,
    major: Sequence[int] | ArrayLike,
    secondary: Sequence[int] | ArrayLike | None = None,
    joint_weight: ArrayLike | None = None,
    secondary_weight: ArrayLike | None = None,
    active_constraint: ArrayLike | None = None,
    scale: ArrayLike | None = None,
    rank_tolerance: float = RANK_TOLERANCE,
) -> VelocityMapping:
    """Minimize |W1 (rates - rates_d)|^2 + |W2 (v_s - v_sd)|^2 without touching the major task.

    Three levels, each inside what the one before leaves free:

    1. C rates = 0                          (constrained active joints, eq. 17)
    2. |J_m rates - v_m|   smallest         (zero where reachable, eq. 23)
    3. the weighted sum above smallest      (eq. 24), ties by the least norm of the rates

    Theorems 3, 4 and 5 of Chen, McInroy, Yi (2003) are the cases of W1, W2 both nonsingular,
    W2 = 0, and W1 = 0; here the weights may be anything.

    Args:
        J: Task Jacobian, eq. (14), shape (..., m, n).
        major: Task rows of the major task, or a matrix of directions (m1, m).
        secondary: Task rows, or directions (m2, m), of the secondary task; by default the
            remaining rows in ascending order (for directions: their orthogonal complement).
        joint_weight: W1, diagonal (n,) or matrix (..., k, n); None is zero.
        secondary_weight: W2, diagonal (m2,) or matrix (..., k, m2); None is zero.
        active_constraint: C, shape (..., r, n).
        scale: Size of J that ranks are decided against, shape (...); by default its norm. A J that
            is a difference of large terms has theirs.
        rank_tolerance: Singular values below this fraction of the scale count as zero.

    Raises:
        ValueError: Wrong shape, index or non-finite input, naming the argument.
    """
    J = _check.batch("J", J)
    m, n = J.shape[-2:]
    S_m, S_s = task_selection(major, secondary, m)
    m2 = len(S_s)
    W1 = _check.weight("joint_weight", _or_no_rows(joint_weight, n), n)
    W2 = _check.weight("secondary_weight", _or_no_rows(secondary_weight, m2), m2)
    C = _check.batch("active_constraint", _or_no_rows(active_constraint, n), columns=n)
    tolerance = float(_check.not_negative("rank_tolerance", rank_tolerance))
    scale = frobenius(J) if scale is None else _check.not_negative("scale", scale)

    # Levels 1 and 2: rates = X v_m + P y, y free.
    P = np.eye(n)
    if C.shape[-2]:
        P = ranked_svd(C, frobenius(C), tolerance).null_projector()
    J_m = S_m @ J
    reach = ranked_svd(J_m @ P, frobenius(S_m) * scale, tolerance)
    X = P @ reach.pseudo_inverse()
    P = P @ reach.null_projector()

    # Level 3: G rates close to [W1 rates_d; W2 v_sd]. X is orthogonal to P, so the pseudo-inverse
    # gives the least norm of the rates among equals.
    lead = np.broadcast_shapes(J.shape[:-2], W1.shape[:-2], W2.shape[:-2])
    W2_S = W2 @ S_s
    G = _stack(lead, W1, W2_S @ J)
    G_scale = np.hypot(frobenius(W1), frobenius(W2_S) * scale)
    Y = P @ ranked_svd(G @ P, G_scale, tolerance).pseudo_inverse()
    k1 = W1.shape[-2]
    return VelocityMapping(
        major=X - Y @ (G @ X),
        joint=Y[..., :k1] @ W1,
        secondary=Y[..., k1:] @ W2,
        achieved=J_m @ X,
        rank=reach.rank,
        gap=reach.gap,
    )


def task_selection(
    major: Sequence[int] | ArrayLike,
    secondary: Sequence[int] | ArrayLike | None,
    m: int,
) -> tuple[Array, Array]:
    """Selection matrices S_m (m1, m), S_s (m2, m): v_m = S_m v, v_s = S_s v."""
    S_m = _selection("major", major, m)
    if secondary is not None:
        return S_m, _selection("secondary", secondary, m)
    if np.ndim(major) == 2:
        full = ranked_svd(S_m, frobenius(S_m), RANK_TOLERANCE, full=True)
        return S_m, full.Vt[int(full.rank) :]
    rest = np.setdiff1d(np.arange(m), np.asarray(major, dtype=int))
    return S_m, np.eye(m)[rest]


def _selection(name: str, rows: Sequence[int] | ArrayLike, m: int) -> Array:
    if np.ndim(rows) == 2:
        return _check.matrix(name, rows, columns=m)
    return np.eye(m)[_check.indices(name, rows, m)]


def _or_no_rows(value: ArrayLike | None, columns: int) -> ArrayLike:
    return np.zeros((0, columns)) if value is None else value


def _stack(lead: tuple[int, ...], top: Array, bottom: Array) -> Array:
    wide = [np.broadcast_to(A, lead + A.shape[-2:]) for A in (top, bottom)]
    return np.concatenate(wide, axis=-2)


def _apply(gain: Array, name: str, value: ArrayLike) -> Array:
    v = _check.vector(name, value, gain.shape[-1])
    return np.einsum("...ij,...j->...i", gain, v)
