"""Force mapping: Problem 6 of the paper for all weights, internal forces and self-motion too."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

import argument_checks as check
from argument_checks import Array, Indices, Mask
from prioritized._arrays import ReadOnly, apply, on_axes, respond, stack, transposed
from prioritized._levels import Level, lexicographic, smallest_gap
from prioritized._problem import checked
from prioritized._rank import RANK_TOLERANCE, basis_scale, frobenius, ranked_svd
from prioritized._task import Status

Gains = tuple[Array, Array, Array]
"""Per major force, desired torque and desired secondary force."""


@dataclass(frozen=True, eq=False)
class ForceMapping(ReadOnly):
    """Gains of the optimal active joint torques; made by :func:`force_mapping`.

    torques = major @ f_m + torque @ torques_desired + secondary @ f_s_desired

    Attributes:
        torque_gains: What the torques are made of: `major` (..., n, m1), `torque` (..., n, n),
            `secondary` (..., n, m2).
        secondary_gains: What the secondary force is made of, (..., m2, .).
        internal_gains: What the internal force is made of, (..., r, .).
        achieved: (..., m1, m1), major force in equilibrium per major force asked for.
        reaction: Orthogonal projector on the task forces that no torque sees: the structure bears
            them, whatever the actuators do, shape (..., m, m); zero when there are none. Where
            they have a major part, the torques hold f_m in equilibrium but do not determine it.
        rank: Dimension of the major forces that equilibrium admits, shape (...).
        gap: Factor the rank threshold could move before the rank of any level changed, shape (...).
        status: The worst of the batch.
    """

    torque_gains: Gains
    secondary_gains: Gains
    internal_gains: Gains
    achieved: Array
    reaction: Array
    rank: Indices
    gap: Array
    status: Status

    @property
    def major(self) -> Array:
        """Torques per major force, shape (..., n, m1)."""
        return self.torque_gains[0]

    @property
    def torque(self) -> Array:
        """Torques per desired torque, shape (..., n, n)."""
        return self.torque_gains[1]

    @property
    def secondary(self) -> Array:
        """Torques per desired secondary force, shape (..., n, m2)."""
        return self.torque_gains[2]

    def __call__(
        self,
        f_major: ArrayLike,
        torque: ArrayLike | None = None,
        secondary_force: ArrayLike | None = None,
    ) -> Array:
        """Optimal active joint torques, shape (..., n); what is None counts as zero."""
        return _respond(self.torque_gains, f_major, torque, secondary_force)

    def secondary_force(
        self,
        f_major: ArrayLike,
        torque: ArrayLike | None = None,
        secondary_force: ArrayLike | None = None,
    ) -> Array:
        """The secondary force f_s that goes with the torques, shape (..., m2)."""
        return _respond(self.secondary_gains, f_major, torque, secondary_force)

    def internal_force(
        self,
        f_major: ArrayLike,
        torque: ArrayLike | None = None,
        secondary_force: ArrayLike | None = None,
    ) -> Array:
        """The internal force eta that goes with them, shape (..., r): one per row of C."""
        return _respond(self.internal_gains, f_major, torque, secondary_force)

    def residual(self, f_major: ArrayLike) -> Array:
        """Part of the major force that no equilibrium admits, shape (..., m1)."""
        wanted = check.vector("f_major", f_major, self.achieved.shape[-1])
        return wanted - apply(self.achieved, "f_major", wanted)


def force_mapping(
    J: ArrayLike,
    major: Sequence[int] | ArrayLike,
    secondary: Sequence[int] | ArrayLike | None = None,
    torque_weight: ArrayLike | None = None,
    secondary_weight: ArrayLike | None = None,
    active_constraint: ArrayLike | None = None,
    self_motion: ArrayLike | None = None,
    *,
    major_metric: ArrayLike | None = None,
    tie_metric: ArrayLike | None = None,
    scale: ArrayLike | None = None,
    rank_tolerance: float = RANK_TOLERANCE,
) -> ForceMapping:
    """Minimize |W3 (torques - torques_d)|^2 + |W4 (f_s - f_sd)|^2 at the major force asked for.

    torques = J^T f + C^T eta with f = S_m^T f_m + S_s^T f_s, eq. (16): f_m is dual to v_m by
    power, whatever directions they are taken in. The secondary force f_s and the internal force
    eta are chosen; four levels, each inside what the one before leaves free:

    1. Q^T f = 0                          (no joint bears what self-motion gives way to, eq. 9)
    2. |M (f_m - f_md)|        smallest   (zero unless level 1 forbids it, eq. 33)
    3. the weighted sum above  smallest
    4. |T torques|, then |torques|, then |f_s|, then |eta| smallest   (ties)

    Theorems 7, 8 and 9 of Chen, McInroy, Yi (2003) are the cases without self-motion and internal
    force of W3, W4 both nonsingular, W4 = 0, and W3 = 0; here the weights may be anything. Power
    balances: f . v = torques . rates for all admissible rates, whatever the self-motion.

    Args:
        J: Task Jacobian, eq. (14), shape (..., m, n).
        major: Task rows of the major task, or a matrix of directions (m1, m).
        secondary: Task rows, or directions (m2, m), of the secondary task; by default the
            remaining rows in ascending order (for directions: their orthogonal complement).
        torque_weight: W3, diagonal (n,) or matrix (..., k, n); None is zero.
        secondary_weight: W4, diagonal (m2,) or matrix (..., k, m2); None is zero.
        active_constraint: C, shape (..., r, n); admissible rates are its null space, eq. (17).
        self_motion: Q, a basis of the task motion that no actuator holds, shape (..., m, k),
            columns of unit size.
        major_metric: M, diagonal (m1,) or matrix (..., k, m1). It matters where self-motion
            forbids the major force, and its rows mix units.
        tie_metric: T, diagonal (n,) or matrix (..., k, n). It matters where the weights leave
            torques undecided, and joints mix units.
        scale: Size of J that ranks are decided against, shape (...); by default its norm.
        rank_tolerance: Singular values below this fraction of the scale count as zero, those of
            the stacked weights too: one goal cannot be weighed 1e10 times another.

    Raises:
        ValueError: Wrong shape, index or non-finite input, naming the argument.
    """
    args = checked(
        J,
        major,
        secondary,
        weight_name="torque_weight",
        weight=torque_weight,
        secondary_weight=secondary_weight,
        active_constraint=active_constraint,
        self_motion=self_motion,
        major_metric=major_metric,
        tie_metric=tie_metric,
        scale=scale,
        rank_tolerance=rank_tolerance,
    )
    J, S_m, S_s, C, Q = args.J, args.S_m, args.S_s, args.active_constraint, args.self_motion
    W3, W4, T = args.weight, args.secondary_weight, args.tie_metric
    M = np.eye(len(S_m)) if args.major_metric is None else args.major_metric
    _refuse_overlap(S_m, S_s, args.tolerance)
    (m, n), m1, m2, r = J.shape[-2:], len(S_m), len(S_s), C.shape[-2]

    # Unknown x = [f_m; f_s; eta], aims p = [f_md; torques_d; f_sd].
    I_m, I_torque, I_s = np.split(np.eye(m1 + n + m2), [m1, m1 + n])
    zero = np.zeros((1, m1 + n + m2))
    X_m, X_s, _ = np.split(np.eye(m1 + m2 + r), [m1, m1 + m2])
    force = np.hstack([S_m.T, S_s.T, np.zeros((m, r))])
    torques = transposed(stack(force[:, : m1 + m2].T @ J, C))
    force_scale = frobenius(force)
    torque_scale = np.hypot(force_scale * args.scale, frobenius(C))
    borne = Level(transposed(Q) @ force, zero, force_scale * basis_scale(Q))
    exerted = Level(M @ X_m, M @ I_m, frobenius(M))
    least_secondary = Level(X_s, zero, frobenius(X_s))
    levels = [
        borne,
        exerted,
        Level(
            stack(W3 @ torques, W4 @ X_s),
            stack(W3 @ I_torque, W4 @ I_s),
            np.hypot(frobenius(W3) * torque_scale, frobenius(W4)),
        ),
        Level(T @ torques, zero, frobenius(T) * torque_scale),
        Level(torques, zero, torque_scale),
        least_secondary,
    ]
    X, decisions = lexicographic(levels, args.tolerance)
    X, reach = on_axes(X, args.lead), decisions[1]
    to_f_m, to_f_s, to_eta = np.split(X, [m1, m1 + m2], axis=-2)

    # Forces that do no work on any motion, driven or self-motion: the structure bears them.
    driven = J @ ranked_svd(C, frobenius(C), args.tolerance).null_projector()
    motion = stack(transposed(driven), transposed(Q) * args.scale[..., None, None])
    motion_scale = args.scale * basis_scale(Q)
    # A major force, with no more secondary force than self-motion demands of it.
    alone, _ = lexicographic([borne, exerted, least_secondary], args.tolerance)
    work = motion @ force @ alone[..., :m1]
    seen = ranked_svd(work, force_scale * motion_scale, args.tolerance).rank == m1
    return ForceMapping(
        torque_gains=_by_aim(torques @ X, m1, n),
        secondary_gains=_by_aim(to_f_s, m1, n),
        internal_gains=_by_aim(to_eta, m1, n),
        achieved=to_f_m[..., :m1],
        reaction=on_axes(
            ranked_svd(motion, motion_scale, args.tolerance).null_projector(), args.lead
        ),
        rank=np.broadcast_to(reach.rank, args.lead),
        gap=np.broadcast_to(smallest_gap(decisions), args.lead),
        status=_status(exerted=reach.rank == m1, seen=seen),
    )


def _refuse_overlap(S_m: Array, S_s: Array, tolerance: float) -> None:
    """A secondary force along a major direction would cancel the major force unnoticed."""
    both = stack(S_m, S_s)
    ranks = [ranked_svd(S, frobenius(S), tolerance).rank for S in (S_m, S_s, both)]
    if ranks[2] < ranks[0] + ranks[1]:
        raise ValueError("secondary must leave out the major directions, got some of them")


def _status(*, exerted: Mask, seen: Mask) -> Status:
    if not np.all(exerted):
        return Status.LEAST_SQUARES
    return Status.EXACT if np.all(seen) else Status.UNSEEN


def _by_aim(gain: Array, m1: int, n: int) -> Gains:
    """Columns of a gain by what they multiply: major force, torques, secondary force."""
    on_major, on_torque, on_secondary = np.split(gain, [m1, m1 + n], axis=-1)
    return on_major, on_torque, on_secondary


def _respond(
    gains: Gains,
    f_major: ArrayLike,
    torque: ArrayLike | None,
    secondary_force: ArrayLike | None,
) -> Array:
    return respond(
        gains, "f_major", f_major=f_major, torque=torque, secondary_force=secondary_force
    )
