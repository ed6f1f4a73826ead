"""Optimal rates of one target, where the ranks of Problem 1 are beyond doubt."""

from math import hypot

import numpy as np
from numpy.typing import ArrayLike

import argument_checks as check
from argument_checks import Array
from prioritized._equality import certain, equality_constrained
from prioritized._problem import Problem
from prioritized._rank import norm


def optimal_rates(
    problem: Problem,
    v_major: ArrayLike,
    joint_velocity: ArrayLike | None,
    secondary_velocity: ArrayLike | None,
) -> Array | None:
    """The rates that reach v_m and minimize the weighted sum, without the gains.

    For one problem, and an unconstrained one.

    Returns:
        Shape (n,), or None where gains are the better way: several targets; a major task that is
        not beyond doubt within reach; weights that do not beyond doubt decide all that it leaves
        free.

    Raises:
        ValueError: A wish of the wrong shape or not finite.
    """
    J, W1, W2 = problem.J, problem.weight, problem.secondary_weight
    v = _one("v_major", v_major, len(problem.S_m))
    target = np.zeros(len(W1) + len(W2))
    if joint_velocity is not None:
        rates_d = _one("joint_velocity", joint_velocity, J.shape[1])
        if rates_d is None:
            return None
        target[: len(W1)] = W1.dot(rates_d)
    if secondary_velocity is not None:
        v_sd = _one("secondary_velocity", secondary_velocity, len(problem.S_s))
        if v_sd is None:
            return None
        target[len(W1) :] = W2.dot(v_sd)
    if v is None:
        return None
    least, scale = certain(problem.tolerance), float(problem.scale)
    soft, soft_scale = np.empty((len(target), J.shape[1]), order="F"), norm(W1)
    soft[: len(W1)] = W1
    if len(W2):
        W2_S = problem.task_weight
        soft[len(W1) :] = W2_S.dot(J)
        soft_scale = hypot(soft_scale, norm(W2_S) * scale)
    hard_scale = norm(problem.S_m) * scale
    return equality_constrained(
        problem.major_jacobian, v, soft, target, least * hard_scale, least * soft_scale
    )


def _one(name: str, wish: ArrayLike | None, size: int) -> Array | None:
    """One wish, or None for a batch of them."""
    if check.is_plain(wish) and wish.shape == (size,) and check.is_moderate(wish):
        return wish
    vector = check.vector(name, wish, size)
    return vector if vector.ndim == 1 else None
