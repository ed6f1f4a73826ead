"""Elimination of the passive joints, eqs. (6) to (17); springs decide what loops leave free."""

import numpy as np

from prioritized._check import Array, Indices
from prioritized._kinematics import Kinematics
from prioritized._rank import frobenius, ranked_svd


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
    passive = np.setdiff1d(np.arange(J_T.shape[1]), active, assume_unique=True)
    moving = np.setdiff1d(passive, stuck, assume_unique=True)
    J_Ca, J_Cs, J_Cp = J_C[:, active], J_C[:, stuck], J_C[:, moving]
    J_Ts, J_Tp = J_T[:, stuck], J_T[:, moving]
    constraint_scale, task_scale = float(frobenius(J_C)), float(frobenius(J_T))

    loops = ranked_svd(J_Cp, constraint_scale, rank_tolerance, full=True)
    r = int(loops.rank)
    closing = (loops.Vt[:r].T / loops.sigma[:r]) @ loops.U[:, :r].T  # J_Cp^+
    free, left_null = loops.Vt[r:].T, loops.U[:, r:].T
    bound = ranked_svd(left_null @ J_Ca, constraint_scale, rank_tolerance)

    gain = -closing @ J_Ca
    # What springs that f stretches do to stuck and to active joints.
    pull, drag = np.zeros((len(stuck), len(J_T))), np.zeros((len(active), len(J_T)))
    spring_gap = np.inf
    if stiffness is not None:
        give, rest, spring_gap = _least(free, stiffness[np.ix_(moving, moving)], rank_tolerance)
        pull = stiffness[np.ix_(stuck, moving)] @ give @ J_Tp.T
        drag = stiffness[np.ix_(active, moving)] @ give @ J_Tp.T
        gain, closing = _settled(gain, closing, give, stiffness, moving, active)
        free = rest  # the springs hold all else
    if passive_metric is not None:
        give, _, _ = _least(free, passive_metric[np.ix_(moving, moving)], rank_tolerance)
        gain, closing = _settled(gain, closing, give, passive_metric, moving, active)

    # Rows of [J_C; E]: a stuck joint's reaction balances what f and f_C put on it, eq. (9).
    internal_force = np.linalg.qr(np.hstack([left_null, -left_null @ J_Cs]).T)[0].T
    f_C = -closing.T @ J_Tp.T
    constraint_gain = np.vstack([f_C, pull - J_Ts.T - J_Cs.T @ f_C])
    constraint_gain -= internal_force.T @ (internal_force @ constraint_gain)  # least norm
    c = len(J_C)
    squeeze = ranked_svd((internal_force[:, :c] @ J_Ca).T, constraint_scale, rank_tolerance)

    def among_passive(rows: Array) -> Array:
        everyone = np.zeros((len(passive), rows.shape[1]))
        everyone[np.searchsorted(passive, moving)] = rows
        return everyone

    task_drift = J_Tp @ free / (task_scale or 1.0)
    drift = ranked_svd(task_drift, 1.0, rank_tolerance)
    return Kinematics(
        J=J_T[:, active] + J_Tp @ gain,
        self_motion=drift.U[:, : int(drift.rank)],
        internal_force=internal_force,
        active_constraint=bound.Vt[: int(bound.rank)],
        actuators=actuators,
        active=active,
        passive=passive,
        actuator_count=actuator_count,
        passive_gain=among_passive(gain),
        passive_drift=among_passive(free),
        task_drift=task_drift,
        constraint_gain=constraint_gain,
        torque_gain=J_T[:, active].T + J_Ca.T @ constraint_gain[:c] - drag,
        internal_gain=squeeze.pseudo_inverse(),
        scale=task_scale * (1.0 + float(frobenius(gain))),
        loop_gap=float(loops.gap),
        constraint_gap=float(bound.gap),
        spring_gap=spring_gap,
        rank_tolerance=rank_tolerance,
    )


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
