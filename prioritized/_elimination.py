"""Elimination of the passive joints, eqs. (6) to (10); springs decide what loops leave free."""

from typing import NamedTuple

import numpy as np

from argument_checks import Array, Indices
from prioritized._arrays import identity, none, read_only
from prioritized._canonical import canonical
from prioritized._compiled import elimination
from prioritized._conditioning import well_conditioned_above
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
        joints: By role.
    """

    J_T: Array
    joints: Joints

    @property
    def active(self) -> Array:
        """Columns of active joints, shape (m, n - q)."""
        return self.J_T.take(self.joints.active, 1)

    @property
    def moving(self) -> Array:
        """Columns of moving joints, shape (m, p)."""
        return self.J_T.take(self.joints.moving, 1)

    @property
    def size(self) -> float:
        """Norm of J_T."""
        return norm(self.J_T)

    def reduced(self, gain: Array) -> tuple[Array, float]:
        """J = J_Ta + J_Tp gain, eq. (14), shape (m, n - q), and the size of the two terms."""
        _, active, _, moving, *_ = self.joints
        J = np.empty((len(self.J_T), len(active)))
        scale = elimination().reduce(self.J_T, active, moving, gain, J)
        return read_only(J), scale


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
        gain: Their rates per active rate, -J_Cp^+ J_Ca, shape (p, n - q).
        closing: J_Cp^+ in the plain norm, shape (p, c).
        free: Orthonormal basis of the motion that the loops leave free, shape (p, d).
        left_null: Orthonormal rows that span the left null space of J_Cp, shape (r, c).
        decision: Rank decision on J_Cp; None where it is clearly of full rank.
        J_C: Shape (c, N).
        moving: Velocity indices of J_Cp, shape (p,).
    """

    gain: Array
    closing: Array
    free: Array
    left_null: Array
    decision: RankedSvd | None
    J_C: Array
    moving: Indices
    rank_tolerance: float

    @property
    def scale(self) -> float:
        """Size that ranks are decided against, with `rank_tolerance`."""
        return norm(self.J_C)

    def decided(self) -> RankedSvd:
        """The decision on J_Cp, made now where it was not needed before."""
        if self.decision is not None:
            return self.decision
        return ranked_svd(self.J_C.take(self.moving, 1), self.scale, self.rank_tolerance)


def close_loops(J_C: Array, joints: Joints, rank_tolerance: float) -> Loops:
    """The moving joints eliminated from J_C theta_dot = 0, eqs. (6) to (8)."""
    _, active, _, moving, *_ = joints
    c, p, rest = len(J_C), len(moving), (J_C, moving, rank_tolerance)
    if not c:  # no loops
        gain = none((p, len(active)))
        return Loops(gain, none((p, 0)), identity(p), none((0, 0)), None, *rest)
    if c == p:
        closing, gain = np.empty((p, p)), np.empty((p, len(active)))
        clear = well_conditioned_above(rank_tolerance)
        if elimination().close(J_C, active, moving, clear, closing, gain):
            return Loops(gain, closing, none((p, 0)), none((0, c)), None, *rest)
    svd = ranked_svd(J_C.take(moving, 1), norm(J_C), rank_tolerance, full=True)
    r = int(svd.rank)
    closing = (svd.Vt[:r].T / svd.sigma[:r]) @ svd.U[:, :r].T
    gain = -closing.dot(J_C.take(active, 1))
    return Loops(gain, closing, svd.Vt[r:].T, svd.U[:, r:].T, svd, *rest)


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
    loops = close_loops(J_C, joints, rank_tolerance)
    gain, closing, free, *_ = loops
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
    return PassiveMotion(gain, closing, canonical(free), compliance, spring_gap, loops)


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
