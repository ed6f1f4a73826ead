"""Elimination of the passive joints, eqs. (6) to (17); springs decide what loops leave free."""

from typing import NamedTuple

import numpy as np

from prioritized._check import Array, Indices
from prioritized._kinematics import Kinematics
from prioritized._rank import RankedSvd, frobenius, ranked_svd


def reduce_to_active(
    J_T: Array,
    J_C: Array,
    *,
    actuators: Indices,
    active: Indices,
    stuck: Indices,
    actuator_count: int,
    stiffness: Array | None,
    passive_metric: Array | None,
    rank_tolerance: float,
) -> Kinematics:
    """Eliminate all but the `active` velocities from v = J_T theta_dot, J_C theta_dot = 0.

    The `stuck` ones are zero. The paper adds a unit row E to J_C for each (section 2.3.2); here
    they are left out of the decomposition and E's share is put back afterwards, which is the same
    and does not weigh a unit row against the units of J_C.

    Passive motion that the loops leave free goes where the potential energy of the springs,
    theta^T K theta / 2, is least; what no spring resists stays self-motion, and follows the
    active joints with the least norm in the passive metric.
    """
    passive = _others(active, J_T.shape[1])
    moving = _others(np.concatenate([active, stuck]), J_T.shape[1])
    constraint_scale, task_scale = float(frobenius(J_C)), float(frobenius(J_T))
    loops = ranked_svd(J_C[:, moving], constraint_scale, rank_tolerance, full=True)
    left_null = loops.U[:, int(loops.rank) :].T
    bound = ranked_svd(left_null @ J_C[:, active], constraint_scale, rank_tolerance)
    motion = _passive_motion(
        loops, J_C[:, active], moving, active, stiffness, passive_metric, rank_tolerance
    )
    # Motion of the moving joints under a task force, springs alone: give @ J_Tp^T @ f, negated.
    stretch = motion.give @ J_T[:, moving].T

    # Rows of [J_C; E]: a stuck joint's reaction balances what f, f_C, springs put on it, eq. (9).
    f_C = -motion.closing.T @ J_T[:, moving].T
    reaction = -J_T[:, stuck].T - J_C[:, stuck].T @ f_C + _rows(stiffness, stuck, moving) @ stretch
    rows = np.hstack([left_null, -left_null @ J_C[:, stuck]])
    internal_force = np.linalg.qr(rows.T)[0].T if stuck.size else rows
    constraint_gain = np.vstack([f_C, reaction])
    constraint_gain -= internal_force.T @ (internal_force @ constraint_gain)  # least norm
    torque_gain = J_T[:, active].T + J_C[:, active].T @ constraint_gain[: len(J_C)]
    torque_gain -= _rows(stiffness, active, moving) @ stretch

    def among_passive(rows: Array) -> Array:
        everyone = np.zeros((len(passive), rows.shape[1]))
        everyone[np.searchsorted(passive, moving)] = rows
        return everyone

    # J is a difference of J_Ta and of what comes through the passive joints that the task sees.
    through = np.linalg.norm(J_T[:, moving], axis=0)
    task_drift = J_T[:, moving] @ motion.free / (task_scale or 1.0)
    drift = ranked_svd(task_drift, 1.0, rank_tolerance)
    return Kinematics(
        J=J_T[:, active] + J_T[:, moving] @ motion.gain,
        self_motion=drift.U[:, : int(drift.rank)],
        internal_force=internal_force,
        active_constraint=bound.Vt[: int(bound.rank)],
        actuators=actuators,
        active=active,
        passive=passive,
        actuator_count=actuator_count,
        passive_gain=among_passive(motion.gain),
        passive_drift=among_passive(motion.free),
        task_drift=task_drift,
        constraint_gain=constraint_gain,
        torque_gain=torque_gain,
        internal_gain=internal_force @ rows.T @ bound.pseudo_inverse().T,
        scale=task_scale + float(frobenius(through[:, None] * motion.gain)),
        loop_gap=float(loops.gap),
        constraint_gap=float(bound.gap),
        spring_gap=motion.spring_gap,
        rank_tolerance=rank_tolerance,
    )


class _PassiveMotion(NamedTuple):
    """How the p moving passive joints follow.

    Attributes:
        gain: Rates per active rate, eq. (10), shape (p, n).
        closing: J_Cp^+, in the metric of springs and passive metric, shape (p, c).
        free: Orthonormal basis of the motion that neither loops nor springs hold, shape (p, d).
        give: Inverse of the springs' K on the motion that the loops leave free, shape (p, p).
        spring_gap: Gap between what springs hold, or the metric weighs, and what they do not.
    """

    gain: Array
    closing: Array
    free: Array
    give: Array
    spring_gap: float


def _passive_motion(
    loops: RankedSvd,
    J_Ca: Array,
    moving: Indices,
    active: Indices,
    stiffness: Array | None,
    passive_metric: Array | None,
    rank_tolerance: float,
) -> _PassiveMotion:
    r = int(loops.rank)
    closing = (loops.Vt[:r].T / loops.sigma[:r]) @ loops.U[:, :r].T
    gain, free = -closing @ J_Ca, loops.Vt[r:].T
    give, spring_gap = np.zeros((len(moving), len(moving))), np.inf
    if stiffness is not None:
        give, rest, spring_gap = _least(free, stiffness[np.ix_(moving, moving)], rank_tolerance)
        gain, closing = _settled(gain, closing, give, stiffness, moving, active)
        free = rest  # the springs hold all else
    if passive_metric is not None:
        follow, _, metric_gap = _least(free, passive_metric[np.ix_(moving, moving)], rank_tolerance)
        gain, closing = _settled(gain, closing, follow, passive_metric, moving, active)
        spring_gap = min(spring_gap, metric_gap)
    return _PassiveMotion(gain, closing, free, give, spring_gap)


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


def _rows(stiffness: Array | None, rows: Indices, columns: Indices) -> Array:
    """Springs between joints; zero in a rigid mechanism."""
    if stiffness is None:
        return np.zeros((len(rows), len(columns)))
    return stiffness[np.ix_(rows, columns)]
