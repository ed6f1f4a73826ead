"""What no pose changes of the levels that a tick solves."""

from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag

from argument_checks import Array, Indices
from prioritized._mapping.asked import Asked, Mechanism
from prioritized._mechanism.conditioning import well_conditioned_above
from prioritized._mechanism.geometry import Geometry
from prioritized._solver.compiled import regular
from prioritized._solver.rank import norm

_SPREAD = 1e4
"""Ratio of weights of rates up to which these are scaled by them without loss of digits."""


class Plan(NamedTuple):
    """Arguments of :func:`prioritized._solver.regular.meet`, which says what they are."""

    S: Array
    T: Array
    order: Indices
    p: int
    z: int
    place: Indices
    weight: Array
    errors: Array

    @classmethod
    def of(cls, asked: Asked, mechanism: Mechanism) -> "Plan | None":
        """Of a mechanism at any pose; None where the compiled solution is not for these levels."""
        system, levels, stacked = mechanism.system, asked.levels, asked.stacked
        first = (0, *stacked.ends)[-2]
        on_rates = stacked.on_rates[first:]
        has_rates = bool(on_rates.any())
        is_odd = any(asked.damping) or any(level[0].interval for level in levels)
        if is_odd or not (stacked.rates_last and system.is_rigid and on_rates.shape[1]):
            return None
        weight = _weights(on_rates if has_rates else _tie(asked), needs_all=not has_rates)
        if weight is None or (has_rates and stacked.on_task[first:].any()):
            return None
        weighted, rows = weight > 0.0, stacked.on_task.any(axis=1)
        W = right_sides(asked)
        wanted = np.zeros((len(weight), W.shape[1]))
        if has_rates:
            wanted[weighted] = (on_rates.T @ W[first:])[weighted] / weight[weighted, None] ** 2
        order = np.append(np.flatnonzero(~weighted), np.flatnonzero(weighted))
        moving = system.joints.moving
        S, z = np.ascontiguousarray(stacked.on_task[rows]), int((~weighted).sum())
        own = weight[order[z:]]
        settling = regular().CLEAR * norm(own) / float(own.min())
        return cls(
            S,
            np.concatenate([W[rows], wanted[order[z:]]]),
            np.concatenate([moving, system.joints.active[order]]),
            *(len(moving), z, order, own),
            np.array([*_errors(system.geometry), norm(S), settling]),
        )


def right_sides(asked: Asked) -> Array:
    """What the weighted rows of all levels are to be, per target, (k, t)."""
    parts = [part for level in asked.levels for part in level]
    return block_diag(*(np.eye(part.size) if part.W is None else part.W for part in parts))


def _tie(asked: Asked) -> Array:
    """What decides where no level weighs rates, (., n)."""
    metric, identity = (each.A for each in asked.ties)
    return metric if len(metric) else identity


def _weights(rows: Array, needs_all: bool) -> Array | None:
    """Weights w (n,) for which |rows rates| = |w rates|; None where there are no good ones."""
    squares = rows.T @ rows
    weight = np.sqrt(squares.diagonal())
    some = weight[weight > 0.0]
    if (squares != np.diag(squares.diagonal())).any() or (needs_all and len(some) < len(weight)):
        return None
    return weight if some.max() < _SPREAD * some.min() else None


def _errors(geometry: Geometry) -> tuple[float, ...]:
    """Size of the errors of J_C and J_T per bound, and where their singular values are in doubt."""
    clear = max(regular().CLEAR, well_conditioned_above(geometry.rank_tolerance))
    if geometry.accuracy is None:
        return 0.0, 0.0, clear, clear
    of_task, of_loops, (fastest, slowest) = geometry.accuracy.extremes
    per_bound, doubtful = [], []
    for A, (most, least) in ((geometry.J_C, of_loops), (geometry.J_T, of_task)):
        per_bound.append(0.0 if geometry.is_stated else float(np.sqrt(A.size)) * most / slowest)
        doubtful.append(clear * (most / least) * (fastest / slowest))
    return *per_bound, *doubtful
