"""Optimal rates of a batch of problems, many at once."""

from math import prod

import numpy as np
from numpy.typing import ArrayLike

import argument_checks as check
from argument_checks import Array, Mask
from prioritized._equality import can_be_decided, certain, equality_constrained_batch
from prioritized._gains import lexicographic_gains
from prioritized._problem import Problem
from prioritized._rank import frobenius

BLOCK = 2048
"""So many at once: numpy's overhead is spread thin, and the arrays stay in the cache."""


def rates_side_by_side(
    problem: Problem,
    v_major: ArrayLike,
    joint_velocity: ArrayLike | None,
    secondary_velocity: ArrayLike | None,
) -> Array | None:
    """The rates of a batch, shape (..., n), without the gains of those whose ranks are no question.

    For unconstrained problems.

    Returns:
        None where gains are the better way: too few weights, or wishes with more axes than the
        batch.

    Raises:
        ValueError: A wish of the wrong shape or not finite.
    """
    p, n, m2 = len(problem.S_m), problem.J.shape[-1], len(problem.S_s)
    k = problem.weight.shape[-2] + problem.secondary_weight.shape[-2]
    if not can_be_decided(p, n, k):
        return None
    wishes = {
        "v_major": check.vector("v_major", v_major, p),
        "joint_velocity": _or_zero("joint_velocity", joint_velocity, n),
        "secondary_velocity": _or_zero("secondary_velocity", secondary_velocity, m2),
    }
    axes = {name: wish.shape[:-1] for name, wish in wishes.items()}
    if check.common_axes({"the mapping": problem.lead, **axes}) != problem.lead:
        return None
    flat = problem.flat()
    aims = [
        np.broadcast_to(wish, (*problem.lead, wish.shape[-1])).reshape(*flat.lead, wish.shape[-1])
        for wish in wishes.values()
    ]
    rates, doubtless = np.empty((flat.lead[0], n)), np.empty(flat.lead, dtype=bool)
    for start in range(0, len(rates), BLOCK):
        now = slice(start, start + BLOCK)
        rates[now], doubtless[now] = _block(flat.part(now), *(aim[now] for aim in aims))
    if not doubtless.all():
        X, _ = lexicographic_gains(flat.part(~doubtless))
        rates[~doubtless] = np.einsum("bij,bj->bi", X, np.hstack(aims)[~doubtless])
    return rates.reshape(*problem.lead, n)


def _or_zero(name: str, wish: ArrayLike | None, size: int) -> Array:
    return np.zeros(size) if wish is None else check.vector(name, wish, size)


def _block(problem: Problem, v: Array, rates_d: Array, v_sd: Array) -> tuple[Array, Mask]:
    """Rates (B, n) and which are beyond doubt; the problems' axis comes last meanwhile."""
    W1, W2, W2_S = problem.weight, problem.secondary_weight, problem.task_weight
    # One J for a batch of weights must stand there as often as they do.
    J = np.ascontiguousarray(np.broadcast_to(_last(problem.J), (*problem.J.shape[-2:], len(v))))
    soft = np.empty((W1.shape[-2] + W2.shape[-2], *J.shape[1:]))
    soft[: W1.shape[-2]] = _last(W1)
    soft[W1.shape[-2] :] = _times(W2_S, J)
    target = np.concatenate([_times(W1, rates_d.T), _times(W2, v_sd.T)])
    least = certain(problem.tolerance)
    scale_soft = np.hypot(frobenius(W1), frobenius(W2_S) * problem.scale)
    rates, doubtless = equality_constrained_batch(
        _times(problem.S_m, J),
        v.T.copy(),
        soft,
        target,
        least * problem.scale * frobenius(problem.S_m),
        least * scale_soft,
    )
    return rates.T, doubtless


def _last(A: Array) -> Array:
    """One matrix, or a batch of them, with the problems' axis last."""
    return A[..., None] if A.ndim == 2 else A.transpose(1, 2, 0)


def _times(A: Array, B: Array) -> Array:
    """A (i, j) or (B, i, j) times columns (j, ..., B)."""
    if A.ndim == 2:
        return A.dot(B.reshape(len(B), prod(B.shape[1:]))).reshape(len(A), *B.shape[1:])
    return np.einsum("bij,j...b->i...b", A, B)
