"""Solutions of Problem 1: gains by the SVD; rates alone without it where ranks are clearly full."""

from math import hypot, prod

import numpy as np
from numpy.typing import ArrayLike

import argument_checks as check
from argument_checks import Array, Mask
from prioritized._arrays import on_axes
from prioritized._equality import (
    equality_constrained,
    equality_constrained_batch,
    is_determined,
    well_conditioned_above,
)
from prioritized._levels import lexicographic, velocity_levels
from prioritized._problem import Problem
from prioritized._rank import RankedSvd, frobenius, norm

BLOCK = 2048
"""Problems solved at once: enough to amortize numpy's overhead, few enough for the cache."""


def velocity_gains(problem: Problem, damping: float = 0.0) -> tuple[Array, list[RankedSvd]]:
    """Gains of p = [v_m; rates_d; v_sd], shape (..., n, m1 + n + m2), and each rank decision."""
    X, decisions = lexicographic(velocity_levels(problem, damping), problem.tolerance)
    return on_axes(X, problem.lead), decisions


def optimal_rates(
    problem: Problem,
    v_major: ArrayLike,
    joint_velocity: ArrayLike | None,
    secondary_velocity: ArrayLike | None,
) -> Array | None:
    """Optimal rates (n,) of one unconstrained problem for one target, without the gains.

    Returns:
        None where the gains must decide: the arguments are batches, or the major Jacobian or the
        weights on its null space are not clearly of full rank.

    Raises:
        ValueError: A velocity of the wrong shape or not finite, by its name.
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
    least, scale = well_conditioned_above(problem.tolerance), float(problem.scale)
    soft, soft_scale = np.empty((len(target), J.shape[1]), order="F"), norm(W1) * problem.exact
    soft[: len(W1)] = W1
    if len(W2):
        W2_S = problem.task_weight
        soft[len(W1) :] = W2_S.dot(J)
        soft_scale = hypot(soft_scale, norm(W2_S) * scale)
    hard_scale = norm(problem.S_m) * scale
    return equality_constrained(
        problem.major_jacobian, v, soft, target, least * hard_scale, least * soft_scale
    )


def _one(name: str, value: ArrayLike | None, size: int) -> Array | None:
    """One checked vector, or None for a batch of them."""
    if check.is_plain(value) and value.shape == (size,) and check.is_moderate(value):
        return value
    vector = check.vector(name, value, size)
    return vector if vector.ndim == 1 else None


def batched_rates(
    problem: Problem,
    v_major: ArrayLike,
    joint_velocity: ArrayLike | None,
    secondary_velocity: ArrayLike | None,
) -> Array | None:
    """Optimal rates (..., n) of a batch of unconstrained problems; gains only where ranks need it.

    Returns:
        None where the gains must decide for all: too few rows of weights, or velocities with more
        batch axes than the problems.

    Raises:
        ValueError: A velocity of the wrong shape or not finite, by its name.
    """
    p, n, m2 = len(problem.S_m), problem.J.shape[-1], len(problem.S_s)
    k = problem.weight.shape[-2] + problem.secondary_weight.shape[-2]
    if not is_determined(p, n, k):
        return None
    given = {
        "v_major": check.vector("v_major", v_major, p),
        "joint_velocity": _or_zero("joint_velocity", joint_velocity, n),
        "secondary_velocity": _or_zero("secondary_velocity", secondary_velocity, m2),
    }
    axes = {name: velocity.shape[:-1] for name, velocity in given.items()}
    if check.common_axes({"the mapping": problem.lead, **axes}) != problem.lead:
        return None
    flat = problem.flat()
    targets = [
        np.broadcast_to(velocity, (*problem.lead, size)).reshape(*flat.lead, size)
        for velocity, size in zip(given.values(), (p, n, m2), strict=True)
    ]
    rates, well_conditioned = np.empty((flat.lead[0], n)), np.empty(flat.lead, dtype=bool)
    for start in range(0, len(rates), BLOCK):
        now = slice(start, start + BLOCK)
        block = (target[now] for target in targets)
        rates[now], well_conditioned[now] = _block_rates(flat.part(now), *block)
    if not well_conditioned.all():
        X, _ = velocity_gains(flat.part(~well_conditioned))
        rates[~well_conditioned] = np.einsum("bij,bj->bi", X, np.hstack(targets)[~well_conditioned])
    return rates.reshape(*problem.lead, n)


def _or_zero(name: str, value: ArrayLike | None, size: int) -> Array:
    return np.zeros(size) if value is None else check.vector(name, value, size)


def _block_rates(problem: Problem, v: Array, rates_d: Array, v_sd: Array) -> tuple[Array, Mask]:
    """Rates (B, n) and which problems are well conditioned; inside, the batch axis is the last."""
    W1, W2, W2_S = problem.weight, problem.secondary_weight, problem.task_weight
    # Where only the weights are a batch, J is repeated for each of them.
    J = np.ascontiguousarray(np.broadcast_to(_last(problem.J), (*problem.J.shape[-2:], len(v))))
    soft = np.empty((W1.shape[-2] + W2.shape[-2], *J.shape[1:]))
    soft[: W1.shape[-2]] = _last(W1)
    soft[W1.shape[-2] :] = _times(W2_S, J)
    target = np.concatenate([_times(W1, rates_d.T), _times(W2, v_sd.T)])
    least = well_conditioned_above(problem.tolerance)
    scale_soft = np.hypot(frobenius(W1) * problem.exact, frobenius(W2_S) * problem.scale)
    rates, well_conditioned = equality_constrained_batch(
        _times(problem.S_m, J),
        v.T.copy(),
        soft,
        target,
        least * problem.scale * frobenius(problem.S_m),
        least * scale_soft,
    )
    return rates.T, well_conditioned


def _last(A: Array) -> Array:
    """One matrix, or a batch of them, with the batch axis last."""
    return A[..., None] if A.ndim == 2 else A.transpose(1, 2, 0)


def _times(A: Array, B: Array) -> Array:
    """A (i, j) or (B, i, j) times columns (j, ..., B)."""
    if A.ndim == 2:
        return A.dot(B.reshape(len(B), prod(B.shape[1:]))).reshape(len(A), *B.shape[1:])
    return np.einsum("bij,j...b->i...b", A, B)
