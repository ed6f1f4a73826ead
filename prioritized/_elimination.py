"""Elimination of the passive joints, eqs. (6) to (17); springs decide what loops leave free."""

from typing import NamedTuple

import numpy as np

from argument_checks import Array, Indices
from prioritized._arrays import none
from prioritized._equality import certain, certain_inverse
from prioritized._rank import RankedSvd, frobenius, norm, ranked_svd


class Joints(NamedTuple):
    """Velocity indices by what their joints do, ascending but for the active ones.

    The paper adds a unit row E to J_C for each stuck joint (section 2.3.2); here they are left out
    of the decomposition and E's share is put back afterwards, which is the same and does not weigh
    a unit row against the units of J_C.

    Attributes:
        actuators: Surviving actuators, in nominal numbering, shape (n - q,).
        active: Their velocities, shape (n - q,).
        stuck: Joints whose rate is zero, actuated or not.
        moving: All others, shape (p,).
        passive: All that are not active, shape (N - n + q,).
        actuator_count: Nominal number n of actuators.
    """

    actuators: Indices
    active: Indices
    stuck: Indices
    moving: Indices
    passive: Indices
    actuator_count: int

    def among_passive(self, rows: Array) -> Array:
        """Rows of the moving joints (p, .) among all that are not active, the others zero."""
        everyone = np.zeros((len(self.passive), rows.shape[1]))
        everyone[np.searchsorted(self.passive, self.moving)] = rows
        return everyone


def sort_joints(actuators: Indices, active: Indices, stuck: Indices, n: int, N: int) -> Joints:
    """Tell the joints apart: `active` and `stuck` of N velocities, all n actuators counted."""
    moving = _others(np.concatenate([active, stuck]), N)
    return Joints(actuators, active, stuck, moving, _others(active, N), n)


class Task(NamedTuple):
    """The task Jacobian by joints.

    Attributes:
        J_T: Shape (m, N).
        active: Its columns of active joints, shape (m, n - q).
        moving: Those of moving ones, shape (m, p).
        size: Norm of J_T.
        moving_squared: Squared norm of each moving joint's column, shape (p,).
    """

    J_T: Array
    active: Array
    moving: Array
    size: float
    moving_squared: Array


def sort_task(J_T: Array, joints: Joints) -> Task:
    """Tell the columns of the task Jacobian apart."""
    moving = J_T[:, joints.moving]
    squared = (moving * moving).sum(axis=0)
    return Task(J_T, J_T[:, joints.active], moving, norm(J_T), squared)


class Loops(NamedTuple):
    """The decision on what the loops hold of the moving joints.

    Attributes:
        closing: J_Cp^+ in the plain norm, shape (p, c).
        free: Orthonormal basis of what the loops leave free, shape (p, d).
        left_null: Orthonormal rows that span the left null space of J_Cp, shape (r, c).
        decision: Of the rank of J_Cp; None where it is beyond doubt.
        J_Cp: Shape (c, p); `scale`: what its rank is decided against, with `rank_tolerance`.
    """

    closing: Array
    free: Array
    left_null: Array
    decision: RankedSvd | None
    J_Cp: Array
    scale: float
    rank_tolerance: float

    def gap(self) -> float:
        """Gap of the rank of J_Cp."""
        decision = self.decision or ranked_svd(self.J_Cp, self.scale, self.rank_tolerance)
        return float(decision.gap)


def close_loops(J_C: Array, moving: Indices, rank_tolerance: float) -> Loops:
    """Eliminate the moving joints from J_C theta_dot = 0, eqs. (6) to (8)."""
    J_Cp, scale = J_C.take(moving, 1), norm(J_C)
    c, p = J_Cp.shape
    if c == p:
        inverse = certain_inverse(J_Cp, certain(rank_tolerance) * scale)
        if inverse is not None:
            return Loops(inverse, none((p, 0)), none((0, c)), None, J_Cp, scale, rank_tolerance)
    svd = ranked_svd(J_Cp, scale, rank_tolerance, full=True)
    r = int(svd.rank)
    closing = (svd.Vt[:r].T / svd.sigma[:r]) @ svd.U[:, :r].T
    return Loops(closing, svd.Vt[r:].T, svd.U[:, r:].T, svd, J_Cp, scale, rank_tolerance)


class PassiveMotion(NamedTuple):
    """How the p moving passive joints follow.

    Attributes:
        gain: Rates per active rate, eq. (10), shape (p, n).
        closing: J_Cp^+, in the metric of springs and passive metric, shape (p, c).
        free: Orthonormal basis of the motion that neither loops nor springs hold, shape (p, d).
        give: Inverse of the springs' K on the motion that the loops leave free, shape (p, p).
        spring_gap: Gap between what springs hold, or the metric weighs, and what they do not.
        loops: What the loops alone hold.
    """

    gain: Array
    closing: Array
    free: Array
    give: Array
    spring_gap: float
    loops: Loops


def passive_motion(
    J_C: Array,
    joints: Joints,
    stiffness: Array | None,
    passive_metric: Array | None,
    rank_tolerance: float,
) -> PassiveMotion:
    """Eq. (10): the moving joints follow the active ones.

    Motion that the loops leave free goes where the potential energy of the springs,
    theta^T K theta / 2, is least; what no spring resists stays self-motion, and follows the
    active joints with the least norm in the passive metric.
    """
    moving, active = joints.moving, joints.active
    loops = close_loops(J_C, moving, rank_tolerance)
    closing, free = loops.closing, loops.free
    gain = -closing.dot(J_C.take(active, 1))
    give, spring_gap = none((len(moving), len(moving))), np.inf
    if not free.shape[1]:
        return PassiveMotion(gain, closing, free, give, spring_gap, loops)
    if stiffness is not None:
        give, rest, spring_gap = _least(free, stiffness[np.ix_(moving, moving)], rank_tolerance)
        gain, closing = _settled(gain, closing, give, stiffness, moving, active)
        free = rest  # the springs hold all else
    if passive_metric is not None:
        follow, _, metric_gap = _least(free, passive_metric[np.ix_(moving, moving)], rank_tolerance)
        gain, closing = _settled(gain, closing, follow, passive_metric, moving, active)
        spring_gap = min(spring_gap, metric_gap)
    return PassiveMotion(gain, closing, free, give, spring_gap, loops)


def _least(free: Array, K_pp: Array, rank_tolerance: float) -> tuple[Array, Array, float]:
    """How free motion gives way to a load when theta^T K theta resists, and the motion left over.

    The inverse of K on its span, shape (p, p), an orthonormal basis of what K does not see, and
    the gap between the two.
    """
    held = ranked_svd(free.T @ K_pp @ free, frobenius(K_pp), rank_tolerance, full=True)
    h = int(held.rank)
    directions = free @ held.Vt[:h].T
    give = (directions / held.sigma[:h]) @ directions.T
    return give, free @ held.Vt[h:].T, float(held.gap)


def _settled(
    gain: Array, closing: Array, give: Array, K: Array, moving: Indices, active: Indices
) -> tuple[Array, Array]:
    """Passive rates per active rate, and J_Cp^+, taken along the free motion to the least."""
    K_pp, K_pa = K[np.ix_(moving, moving)], K[np.ix_(moving, active)]
    return gain - give @ (K_pp @ gain + K_pa), closing - give @ (K_pp @ closing)


def _others(known: Indices, count: int) -> Indices:
    """The indices of range(count) that are not known, ascending."""
    rest = np.ones(count, dtype=bool)
    rest[known] = False
    return np.flatnonzero(rest)
