"""Lexicographic least squares, and the levels of Problems 1 and 6."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from argument_checks import Array
from prioritized._mapping.problem import Problem
from prioritized._solver.arrays import on_axes, stack, transposed
from prioritized._solver.rank import RankedSvd, basis_scale, frobenius, ranked_svd


class Level(NamedTuple):
    """Level that minimizes |A x - target p| for every p.

    Attributes:
        A: Shape (..., k, n).
        target: Shape (..., k, p).
        scale: Size of the matrices that A was computed from, shape (...), against which ranks are
            decided.
        damping: Tikhonov damping of this level alone, in units of A's singular values.
    """

    A: Array
    target: Array
    scale: Array | float
    damping: float = 0.0


def lexicographic(levels: Sequence[Level], tolerance: float) -> tuple[Array, list[RankedSvd]]:
    """Return the gain X of x = X p, shape (..., n, p), and the rank decision of each level.

    Each level is solved in the null space of the previous ones; x has least norm.
    """
    n, p = levels[0].A.shape[-1], levels[0].target.shape[-1]
    # A projector, not a basis: in a batch its shape must not depend on the rank.
    X, free = np.zeros((n, p)), np.eye(n)
    decisions = []
    for level in levels:
        svd = ranked_svd(level.A @ free, level.scale, tolerance)
        decisions.append(svd)
        if level.A.shape[-2] == 0:
            continue
        # The step has least norm: in the range of `free`, orthogonal to the remaining null space.
        X = X + free @ svd.pseudo_inverse(level.damping) @ (level.target - level.A @ X)
        free = free @ svd.null_projector()
    return X, decisions


def smallest_gap(decisions: Sequence[RankedSvd]) -> Array:
    """Return the smallest gap of the rank decisions, shape (...)."""
    gap = np.asarray(np.inf)
    for svd in decisions:
        if svd.sigma.size:
            gap = np.minimum(gap, svd.gap)
    return gap


def velocity_levels(problem: Problem, damping: float) -> list[Level]:
    """Return Problem 1 as levels in the rates for p = [v_m; rates_d; v_sd].

    The levels are those of :func:`prioritized.velocity_mapping`; the second is the major task.
    """
    J, C, T = problem.J, problem.active_constraint, problem.tie_metric
    W1, W2, W2_S = problem.weight, problem.secondary_weight, problem.task_weight
    n, m1, m2 = J.shape[-1], len(problem.S_m), len(problem.S_s)
    M = np.eye(m1) if problem.major_metric is None else problem.major_metric
    I_m, I_joint, I_s = np.split(np.eye(m1 + n + m2), [m1, m1 + n])
    zero = np.zeros((1, m1 + n + m2))
    return [
        Level(C, zero, frobenius(C)),
        Level(
            M @ problem.major_jacobian, M @ I_m, frobenius(M @ problem.S_m) * problem.scale, damping
        ),
        Level(
            stack(W1, W2_S @ J),
            stack(W1 @ I_joint, W2 @ I_s),
            np.hypot(frobenius(W1) * problem.exact, frobenius(W2_S) * problem.scale),
        ),
        Level(T, zero, frobenius(T) * problem.exact),
    ]


def velocity_gains(problem: Problem, damping: float = 0.0) -> tuple[Array, list[RankedSvd]]:
    """Return the gains of p = [v_m; rates_d; v_sd], (..., n, m1 + n + m2), and rank decisions."""
    X, decisions = lexicographic(velocity_levels(problem, damping), problem.tolerance)
    return on_axes(X, problem.lead), decisions


def damped(levels: Sequence[Level], tolerance: float) -> list[Level]:
    """Replace damped levels by undamped ones with additional weighted rows (Tikhonov).

    For problems with further unknowns whose norm does not count. The added rows are the components
    of the unknowns along the singular vectors of the level on the null space of the previous ones,
    so that the level determines no more directions than before, with or without limits.
    """
    free, plain = np.eye(levels[0].A.shape[-1]), []
    for level in levels:
        svd = ranked_svd(level.A @ free, level.scale, tolerance)
        free = free @ svd.null_projector()
        if level.damping:
            V = svd.Vt * svd.significant[..., None]
            nothing = np.zeros((V.shape[-2], level.target.shape[-1]))
            A, target = stack(level.A, level.damping * V), stack(level.target, nothing)
            level = Level(A, target, level.scale)
        plain.append(level)
    return plain


class Forces(NamedTuple):
    """Task force (m, .) and torques (..., n, .) per unknown [f_m; f_s; eta], and their scales."""

    task: Array
    torques: Array
    task_scale: Array
    torque_scale: Array


def forces_of(problem: Problem) -> Forces:
    """Return task force and torques as functions of the unknowns of Problem 6, eq. (16)."""
    S_m, S_s, C = problem.S_m, problem.S_s, problem.active_constraint
    m, of_task = problem.J.shape[-2], len(S_m) + len(S_s)
    task = np.hstack([S_m.T, S_s.T, np.zeros((m, C.shape[-2]))])
    torques = transposed(stack(task[:, :of_task].T @ problem.J, C))
    scale = frobenius(task)
    return Forces(task, torques, scale, np.hypot(scale * problem.scale, frobenius(C)))


def force_levels(problem: Problem, forces: Forces) -> list[Level]:
    """Return Problem 6 as levels for x = [f_m; f_s; eta] and p = [f_md; torques_d; f_sd].

    The levels are those of :func:`prioritized.force_mapping`: self-motion, the major force, the
    weighted sum, then three that break ties, the last of them the least secondary force.
    """
    W3, W4, T, Q = problem.weight, problem.secondary_weight, problem.tie_metric, problem.self_motion
    n, m1, m2 = problem.J.shape[-1], len(problem.S_m), len(problem.S_s)
    M = np.eye(m1) if problem.major_metric is None else problem.major_metric
    I_m, I_torque, I_s = np.split(np.eye(m1 + n + m2), [m1, m1 + n])
    X_m, X_s, _ = np.split(np.eye(forces.task.shape[1]), [m1, m1 + m2])
    zero = np.zeros((1, m1 + n + m2))
    return [
        Level(transposed(Q) @ forces.task, zero, forces.task_scale * basis_scale(Q)),
        Level(M @ X_m, M @ I_m, frobenius(M)),
        Level(
            stack(W3 @ forces.torques, W4 @ X_s),
            stack(W3 @ I_torque, W4 @ I_s),
            np.hypot(frobenius(W3) * forces.torque_scale, frobenius(W4)),
        ),
        Level(T @ forces.torques, zero, frobenius(T) * forces.torque_scale),
        Level(forces.torques, zero, forces.torque_scale),
        Level(X_s, zero, frobenius(X_s)),
    ]
