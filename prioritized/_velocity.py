"""Velocity mapping: Problem 1 of the paper for all weights."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from prioritized import _check
from prioritized._arrays import ReadOnly, apply, on_axes, respond, stack
from prioritized._check import Array, Indices, Mask
from prioritized._levels import Level, lexicographic, smallest_gap
from prioritized._problem import checked
from prioritized._rank import RANK_TOLERANCE, basis_scale, frobenius, ranked_svd
from prioritized._task import Status


@dataclass(frozen=True, eq=False)
class VelocityMapping(ReadOnly):
    """Gains of the optimal active joint rates; made by :func:`velocity_mapping`.

    rates = major @ v_m + joint @ rates_desired + secondary @ v_s_desired

    Attributes:
        major: (..., n, m1), `joint`: (..., n, n), `secondary`: (..., n, m2).
        achieved: (..., m1, m1), major velocity reached per major velocity asked for.
        rank: Rank of the major task on the admissible rates, shape (...).
        gap: Factor the rank threshold could move before the rank of any level changed, shape (...).
        status: The worst of the batch.
    """

    major: Array
    joint: Array
    secondary: Array
    achieved: Array
    rank: Indices
    gap: Array
    status: Status

    def __call__(
        self,
        v_major: ArrayLike,
        joint_velocity: ArrayLike | None = None,
        secondary_velocity: ArrayLike | None = None,
    ) -> Array:
        """Optimal active joint rates, shape (..., n); what is None counts as zero."""
        return respond(
            (self.major, self.joint, self.secondary),
            "v_major",
            v_major=v_major,
            joint_velocity=joint_velocity,
            secondary_velocity=secondary_velocity,
        )

    def residual(self, v_major: ArrayLike) -> Array:
        """Part of the major velocity that the rates leave out, shape (..., m1)."""
        wanted = _check.vector("v_major", v_major, self.achieved.shape[-1])
        return wanted - apply(self.achieved, "v_major", wanted)


def velocity_mapping(
    J: ArrayLike,
    major: Sequence[int] | ArrayLike,
    secondary: Sequence[int] | ArrayLike | None = None,
    joint_weight: ArrayLike | None = None,
    secondary_weight: ArrayLike | None = None,
    active_constraint: ArrayLike | None = None,
    self_motion: ArrayLike | None = None,
    *,
    major_metric: ArrayLike | None = None,
    tie_metric: ArrayLike | None = None,
    damping: float = 0.0,
    scale: ArrayLike | None = None,
    rank_tolerance: float = RANK_TOLERANCE,
) -> VelocityMapping:
    """Minimize |W1 (rates - rates_d)|^2 + |W2 (v_s - v_sd)|^2 without touching the major task.

    Four levels, each inside what the one before leaves free:

    1. C rates = 0                          (constrained active joints, eq. 17)
    2. |M (J_m rates - v_m)|   smallest     (zero where reachable, eq. 23)
    3. the weighted sum above  smallest     (eq. 24)
    4. |T rates|, then |rates| smallest     (ties)

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
        self_motion: Basis of the task motion that no actuator holds, shape (..., m, k), columns of
            unit size; it only decides the status.
        major_metric: M, diagonal (m1,) or matrix (..., k, m1). It matters where the major task is
            out of reach or damped, and its rows mix units.
        tie_metric: T, diagonal (n,) or matrix (..., k, n). It matters where the weights leave
            rates undecided, and joints mix units.
        damping: Tikhonov damping of level 2, in units of the singular values of M J_m: the part of
            the rates that serves the major task stays below |M v_m| / (2 damping), and the major
            task is not exact. The secondary goal is not damped: give it a joint_weight.
        scale: Size of J that ranks are decided against, shape (...); by default its norm. A J that
            is a difference of large terms has theirs.
        rank_tolerance: Singular values below this fraction of the scale count as zero, those of
            the stacked weights too: one goal cannot be weighed 1e10 times another.

    Raises:
        ValueError: Wrong shape, index or non-finite input, naming the argument.
    """
    args = checked(
        J,
        major,
        secondary,
        weight_name="joint_weight",
        weight=joint_weight,
        secondary_weight=secondary_weight,
        active_constraint=active_constraint,
        self_motion=self_motion,
        major_metric=major_metric,
        tie_metric=tie_metric,
        scale=scale,
        rank_tolerance=rank_tolerance,
    )
    damping = _check.number("damping", damping)
    J, S_m, C, Q = args.J, args.S_m, args.active_constraint, args.self_motion
    W1, W2, M, T = args.weight, args.secondary_weight, args.major_metric, args.tie_metric
    n, m1, m2 = J.shape[-1], len(S_m), len(args.S_s)

    # What the levels aim at, as gains of p = [v_m; rates_d; v_sd].
    I_m, I_joint, I_s = np.split(np.eye(m1 + n + m2), [m1, m1 + n])
    zero = np.zeros((1, m1 + n + m2))
    J_m, W2_S = S_m @ J, W2 @ args.S_s
    levels = [
        Level(C, zero, frobenius(C)),
        Level(M @ J_m, M @ I_m, frobenius(M @ S_m) * args.scale, damping),
        Level(
            stack(W1, W2_S @ J),
            stack(W1 @ I_joint, W2 @ I_s),
            np.hypot(frobenius(W1), frobenius(W2_S) * args.scale),
        ),
        Level(T, zero, frobenius(T)),
    ]
    X, decisions = lexicographic(levels, args.tolerance)
    X, reach = on_axes(X, args.lead), decisions[1]
    drift = ranked_svd(S_m @ Q, frobenius(S_m) * basis_scale(Q), args.tolerance)
    return VelocityMapping(
        major=X[..., :m1],
        joint=X[..., m1 : m1 + n],
        secondary=X[..., m1 + n :],
        achieved=on_axes(J_m @ X[..., :m1], args.lead),
        rank=np.broadcast_to(reach.rank, args.lead),
        gap=np.broadcast_to(smallest_gap(decisions), args.lead),
        status=_status(drifts=drift.rank > 0, reached=reach.rank == m1, damped=damping > 0),
    )


def _status(*, drifts: Mask, reached: Mask, damped: bool) -> Status:
    if np.any(drifts):
        return Status.SELF_MOTION
    if not np.all(reached):
        return Status.LEAST_SQUARES
    return Status.DAMPED if damped else Status.EXACT
