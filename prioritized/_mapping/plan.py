"""What no pose changes of the levels that a tick solves."""

from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import block_diag

from argument_checks import Array, Indices, Mask
from kernels import ffi, pointer
from prioritized._mapping.asked import Asked, Mechanism
from prioritized._mapping.tasks import Level
from prioritized._mechanism.conditioning import well_conditioned_above
from prioritized._mechanism.elimination import Partition
from prioritized._mechanism.geometry import Geometry
from prioritized._solver.rank import norm

_CLEAR = 1e-6
"""Part of a scale above which a singular value is regular: any way then finds nine digits."""
_SPREAD = 1e4
"""Ratio of weights of rates up to which these are scaled by them without loss of digits."""


class Plan(NamedTuple):
    """What ``regular_plan`` in ``kernels.h`` names.

    Attributes:
        S: Shape (k, m).
        D: Shape (d, m).
        E: Shape (e, d).
        T: Shape (., t).
        order: Shape (p + n,).
        p: Passive velocities that move.
        z: Rates without a weight.
        place: Shape (n,).
        idle: Passive velocities that stay at rest.
        weight: Shape (n - z,).
        errors: Its last numbers, (7,).
    """

    S: Array
    D: Array
    E: Array
    T: Array
    order: Indices
    p: int
    z: int
    place: Indices
    idle: Indices
    weight: Array
    errors: Array

    @classmethod
    def of(cls, asked: Asked, mechanism: Mechanism) -> "Plan | None":
        """Of a mechanism at any pose; None where the compiled solution is not for these levels."""
        system, levels, stacked = mechanism.system, asked.levels, asked.stacked
        rates = stacked.on_rates
        is_odd = any(asked.damping) or any(level[0].interval for level in levels)
        if is_odd or not (stacked.rates_last and system.is_rigid and rates.shape[1]):
            return None
        has_rates = bool(rates.any())
        weight = _weights(rates if has_rates else _tie(asked), needs_all=not has_rates)
        if weight is None:
            return None
        D, E, is_beside = _beside(levels[-1:] if has_rates else (), stacked.on_task)
        is_met = stacked.on_task.any(axis=1) & ~is_beside
        S, W, weighted = stacked.on_task[is_met], right_sides(asked), weight > 0.0
        own, joints = weight[weighted], system.joints
        order = np.append(np.flatnonzero(~weighted), np.flatnonzero(weighted))
        wanted = (rates.T @ W)[weighted] / own[:, None] ** 2
        moving, idle = _widest_last(system)
        sizes = _CLEAR * np.array([norm(own), norm(E @ D)]) / own.min()
        return cls(
            *(S, D, E, np.concatenate([W[is_met], wanted, W[is_beside]])),
            np.concatenate([moving, joints.active[order]]),
            *(len(moving), len(weight) - len(own), order, idle, own),
            np.array([*_errors(system.geometry), norm(np.concatenate([S, D])), *sizes]),
        )

    def for_kernel(self, c: int, N: int) -> Any:
        """The same for :data:`kernels.lib` and J_C (c, N); of use as long as this plan lives."""
        (k, m), t, n = self.S.shape, self.T.shape[1], len(self.place)
        sizes = m, c, N, t, k, len(self.D), len(self.E), self.p, n, self.z, len(self.idle)
        arrays = self.S, self.D, self.E, self.T, self.weight, self.order, self.place, self.idle
        numbers = *self.errors.tolist(), _CLEAR, float(self.weight.min())
        return ffi.new("regular_plan *", (*sizes, *map(pointer, arrays), *numbers))


def _widest_last(system: Partition) -> tuple[Indices, Indices]:
    """The passive velocities that move, and those that neither loops nor task know.

    The former begin with those of one loop: more zeros then stay zeros.
    """
    moving = system.joints.moving
    is_idle = ~(system.J_C[:, moving].any(axis=0) | system.geometry.J_T[:, moving].any(axis=0))
    moving, idle = moving[~is_idle], moving[is_idle]
    rows = [np.flatnonzero(column) for column in system.J_C[:, moving].T]
    widths = [int(np.ptp(each)) if len(each) else 0 for each in rows]
    return moving[np.argsort(widths, kind="stable")], idle


def _beside(last: tuple[Level, ...], on_task: Array) -> tuple[Array, Array, Mask]:
    """Tasks that rates compromise with: directions (d, m), their weights, and which rows these are.

    Args:
        last: The last level, if its rates have weights.
        on_task: Rows of all levels, (k, m).
    """
    parts = [part for level in last for part in level]
    D, E, which = (
        [np.zeros((0, on_task.shape[1]))],
        [np.zeros((0, 0))],
        np.zeros(len(on_task), bool),
    )
    end = len(on_task)
    for part in reversed(parts):
        W = part.matrix
        if part.S is not None and W.any():
            D.insert(0, part.S)
            E.insert(0, W)
            which[end - len(W) : end] = True
        end -= len(W)
    return np.concatenate(D), np.ascontiguousarray(block_diag(*E)), which


def right_sides(asked: Asked) -> Array:
    """What the weighted rows of all levels are to be, per target, (k, t)."""
    return block_diag(*(part.matrix for level in asked.levels for part in level))


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
    clear = max(_CLEAR, well_conditioned_above(geometry.rank_tolerance))
    if geometry.accuracy is None:
        return 0.0, 0.0, clear, clear
    of_task, of_loops, (fastest, slowest) = geometry.accuracy.extremes
    per_bound, doubtful = [], []
    for A, (most, least) in ((geometry.J_C, of_loops), (geometry.J_T, of_task)):
        per_bound.append(0.0 if geometry.is_stated else float(np.sqrt(A.size)) * most / slowest)
        doubtful.append(clear * (most / least) * (fastest / slowest))
    return *per_bound, *doubtful
