"""Elimination of the passive joints, eqs. (6) to (10); springs decide what loops leave free."""

from math import sqrt
from typing import NamedTuple

import numpy as np

from argument_checks import Array, Indices
from prioritized._arrays import none, read_only
from prioritized._conditioning import well_conditioned_above, well_conditioned_inverse
from prioritized._rank import RankedSvd, norm, ranked_svd


class Joints(NamedTuple):
    """Velocity indices by the role of the joint; all but the active ones ascend.

    For each stuck joint the paper adds a unit row E to J_C (section 2.3.2). Here stuck joints are
    left out of the decomposition instead, and E's rows are restored in the result: the same
    mathematically, but ranks do not depend on the units of J_C relative to E.

    Attributes:
        actuators: Surviving actuators, in nominal numbering, shape (n - q,).
        active: Their velocities, shape (n - q,).
        stuck: Joints whose rate is zero, actuated or not, shape (s,).
        moving: All others, shape (p,).
        passive: All that are not active, shape (N - n + q,).
        actuated: Velocities of all nominal actuators, failed ones too, shape (n,).
    """

    actuators: Indices
    active: Indices
    stuck: Indices
    moving: Indices
    passive: Indices
    actuated: Indices

    def among_passive(self, rows: Array) -> Array:
        """Rows of the moving joints (p, .) placed among the passive ones, zero elsewhere."""
        passive = np.zeros((len(self.passive), rows.shape[1]))
        passive[np.searchsorted(self.passive, self.moving)] = rows
        return passive


def sort_joints(actuated: Indices, actuators: Indices, stuck: Indices, N: int) -> Joints:
    """The N velocities by role, given which actuators survive and which joints are stuck."""
    active = actuated[actuators]
    moving = _others(np.concatenate([active, stuck]), N)
    return Joints(actuators, active, stuck, moving, _others(active, N), actuated)


def _others(known: Indices, count: int) -> Indices:
    """The indices of range(count) that are not known, ascending."""
    rest = np.ones(count, dtype=bool)
    rest[known] = False
    return np.flatnonzero(rest)


class TaskJacobian(NamedTuple):
    """The task Jacobian by joints.

    Attributes:
        J_T: Shape (m, N).
        active: Its columns of active joints, shape (m, n - q).
        moving: Those of moving joints, shape (m, p).
        size: Norm of J_T.
        moving_squared: Squared norm of each column of `moving`, shape (p,).
    """

    J_T: Array
    active: Array
    moving: Array
    size: float
    moving_squared: Array

    def reduced(self, gain: Array) -> tuple[Array, float]:
        """J = J_Ta + J_Tp gain, eq. (14), shape (m, n - q), and the size of the two terms."""
        # A fast passive joint adds to the size only if it moves the task.
        through = self.moving_squared.dot(np.add.reduce(gain * gain, 1))
        return read_only(self.active + self.moving.dot(gain)), self.size + sqrt(through)


def sort_task(J_T: Array, joints: Joints) -> TaskJacobian:
    """The task Jacobian by joints."""
    moving = J_T[:, joints.moving]
    squared = (moving * moving).sum(axis=0)
    return TaskJacobian(J_T, J_T[:, joints.active], moving, norm(J_T), squared)


class Partition(NamedTuple):
    """A constrained system by joints, eqs. (6) to (9)."""

    task: TaskJacobian
    J_C: Array  # (c, N)
    joints: Joints
    stiffness: Array | None  # K of the joint springs, (N, N); None is a rigid mechanism
    passive_metric: Array | None  # (N, N); None is the identity
    rank_tolerance: float


class Loops(NamedTuple):
    """What the loops determine of the moving joints.

    Attributes:
        closing: J_Cp^+ in the plain norm, shape (p, c).
        free: Orthonormal basis of the motion that the loops leave free, shape (p, d).
        left_null: Orthonormal rows that span the left null space of J_Cp, shape (r, c).
        decision: Rank decision on J_Cp; None where it is clearly of full rank.
        J_Cp: Shape (c, p).
        scale: Size that its rank is decided against, with `rank_tolerance`.
    """

    closing: Array
    free: Array
    left_null: Array
    decision: RankedSvd | None
    J_Cp: Array
    scale: float
    rank_tolerance: float

    def decided(self) -> RankedSvd:
        """The decision on J_Cp, made now where it was not needed before."""
        return self.decision or ranked_svd(self.J_Cp, self.scale, self.rank_tolerance)


def close_loops(J_C: Array, moving: Indices, rank_tolerance: float) -> Loops:
    """The moving joints eliminated from J_C theta_dot = 0, eqs. (6) to (8)."""
    J_Cp, scale = J_C.take(moving, 1), norm(J_C)
    c, p = J_Cp.shape
    if c == p:
        least = well_conditioned_above(rank_tolerance) * scale
        inverse = well_conditioned_inverse(J_Cp, least)
        if inverse is not None:
            return Loops(inverse, none((p, 0)), none((0, c)), None, J_Cp, scale, rank_tolerance)
    svd = ranked_svd(J_Cp, scale, rank_tolerance, full=True)
    r = int(svd.rank)
    closing = (svd.Vt[:r].T / svd.sigma[:r]) @ svd.U[:, :r].T
    return Loops(closing, svd.Vt[r:].T, svd.U[:, r:].T, svd, J_Cp, scale, rank_tolerance)


class PassiveMotion(NamedTuple):
    """How the p moving passive joints follow the active ones.

    Attributes:
        gain: Passive rates per active rate, eq. (10), shape (p, n - q).
        closing: J_Cp^+ in the metric of the springs and the passive metric, shape (p, c).
        free: Orthonormal basis of the motion that neither loops nor springs resist, shape (p, d).
        compliance: Inverse of K on the motion that the loops leave free, shape (p, p).
        spring_gap: Gap between motion that springs resist, or the metric weighs, and the rest.
        loops: The decision on the loops alone.
    """

    gain: Array
    closing: Array
    free: Array
    compliance: Array
    spring_gap: float
    loops: Loops


def passive_motion(system: Partition) -> PassiveMotion:
    """The passive motion per active rate, eq. (10).

    Of the motion that the loops leave free, the part that springs resist minimizes their energy
    theta^T K theta / 2. The rest is self-motion: it takes the least norm in the passive metric.
    """
    _, J_C, joints, stiffness, passive_metric, rank_tolerance = system
    moving, active = joints.moving, joints.active
    loops = close_loops(J_C, moving, rank_tolerance)
    closing, free = loops.closing, loops.free
    gain = -closing.dot(J_C.take(active, 1))
    compliance, spring_gap = none((len(moving), len(moving))), np.inf
    if not free.shape[1]:
        return PassiveMotion(gain, closing, free, compliance, spring_gap, loops)
    if stiffness is not None:
        compliance, unresisted, spring_gap = _compliance(free, stiffness, moving, rank_tolerance)
        gain, closing = _least_energy(gain, closing, compliance, stiffness, moving, active)
        free = unresisted
    if passive_metric is not None:
        inverse, _, metric_gap = _compliance(free, passive_metric, moving, rank_tolerance)
        gain, closing = _least_energy(gain, closing, inverse, passive_metric, moving, active)
        spring_gap = min(spring_gap, metric_gap)
    return PassiveMotion(gain, closing, free, compliance, spring_gap, loops)


def _compliance(
    free: Array, K: Array, moving: Indices, rank_tolerance: float
) -> tuple[Array, Array, float]:
    """Inverse of K on the free motion (p, p), a basis of what K does not resist, and the gap."""
    # Against all forces on the moving joints: beside a coupling K_pa, round-off in K_pp is no
    # spring.
    K_p = K.take(moving, 0)
    resisted = ranked_svd(free.T @ K_p.take(moving, 1) @ free, norm(K_p), rank_tolerance, full=True)
    h = int(resisted.rank)
    directions = free @ resisted.Vt[:h].T
    compliance = (directions / resisted.sigma[:h]) @ directions.T
    return compliance, free @ resisted.Vt[h:].T, float(resisted.gap)


def _least_energy(
    gain: Array, closing: Array, compliance: Array, K: Array, moving: Indices, active: Indices
) -> tuple[Array, Array]:
    """Passive rates per active rate, and J_Cp^+, shifted along free motion to the least energy."""
    K_pp, K_pa = K[np.ix_(moving, moving)], K[np.ix_(moving, active)]
    return gain - compliance @ (K_pp @ gain + K_pa), closing - compliance @ (K_pp @ closing)
