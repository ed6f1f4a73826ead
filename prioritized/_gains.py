"""The gains of Problem 1 for all weights, whatever the ranks."""

import numpy as np

from argument_checks import Array
from prioritized._arrays import on_axes, stack
from prioritized._levels import Level, lexicographic
from prioritized._problem import Problem
from prioritized._rank import RankedSvd, frobenius


def lexicographic_gains(problem: Problem, damping: float = 0.0) -> tuple[Array, list[RankedSvd]]:
    """Gains of p = [v_m; rates_d; v_sd], shape (..., n, m1 + n + m2), and each level's decision.

    The levels are those of :func:`prioritized.velocity_mapping`.
    """
    J, C, T = problem.J, problem.active_constraint, problem.tie_metric
    W1, W2, W2_S = problem.weight, problem.secondary_weight, problem.task_weight
    n, m1, m2 = J.shape[-1], len(problem.S_m), len(problem.S_s)
    M = np.eye(m1) if problem.major_metric is None else problem.major_metric
    I_m, I_joint, I_s = np.split(np.eye(m1 + n + m2), [m1, m1 + n])
    zero = np.zeros((1, m1 + n + m2))
    levels = [
        Level(C, zero, frobenius(C)),
        Level(
            M @ problem.major_jacobian, M @ I_m, frobenius(M @ problem.S_m) * problem.scale, damping
        ),
        Level(
            stack(W1, W2_S @ J),
            stack(W1 @ I_joint, W2 @ I_s),
            np.hypot(frobenius(W1), frobenius(W2_S) * problem.scale),
        ),
        Level(T, zero, frobenius(T)),
    ]
    X, decisions = lexicographic(levels, problem.tolerance)
    return on_axes(X, problem.lead), decisions
