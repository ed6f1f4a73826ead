"""Task motion under one failure condition or many, and successive rank decisions on it.

In natural units; the axes of many conditions lead, as in :class:`Motions`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np

from argument_checks import Array, Indices, Mask
from prioritized._mechanism.geometry import Geometry
from prioritized._mechanism.motions import Motions
from prioritized._solver.arrays import transposed
from prioritized._solver.rank import RANK_TOLERANCE, ROUND_OFF, RankedSvd, frobenius, ranked_svd

LEAST_ROWS = 10.0 * ROUND_OFF / RANK_TOLERANCE
"""Least size of task rows per size of the task: the tolerance is then ten times the round-off."""


@dataclass(frozen=True, eq=False)
class TaskMotion:
    """Motion of the whole task per active rate and by self-motion.

    Attributes:
        geometry: J_T and J_C.
        actuated: Velocity indices of the columns of J, (n,).
        velocities: All velocities per active rate, shape (..., N, n).
        admissible: Rates that the loops admit: basis (n, .) or projector (..., n, n).
        self_motion: All velocities with every active joint locked, (..., N, .).
        closing: As in :class:`Motions`.
        moving: Passive and free joints that are not stuck, shape (..., N).
        gap_of_motions: Function that returns the smallest gap of the rank decisions on the motions.
    """

    geometry: Geometry
    actuated: Indices
    velocities: Array
    admissible: Array
    self_motion: Array
    closing: Array | None
    moving: Mask
    gap_of_motions: Callable[[], Array]

    @classmethod
    def of(cls, motions: Motions, actuated: Indices) -> "TaskMotion":
        """Return the task motion of these admissible motions."""
        B, Z = motions.geometry.motions, motions.admissible
        return cls(
            geometry=motions.geometry,
            actuated=actuated,
            velocities=B @ motions.driven,
            admissible=Z[:, : int(motions.rates.rank)] if Z.ndim == 2 else Z @ transposed(Z),
            self_motion=B @ motions.self_motion,
            closing=motions.closing,
            moving=motions.moving,
            gap_of_motions=partial(getattr, motions, "gap"),
        )

    @property
    def gap(self) -> Array:
        """Smallest gap of the rank decisions on the motions, shape (...)."""
        return self.gap_of_motions()

    @cached_property
    def J(self) -> Array:
        """Task Jacobian on the admissible rates, zero on all others, shape (..., m, n)."""
        return self.geometry.task @ self.velocities

    @cached_property
    def error(self) -> Array | None:
        """First-order error bound of each entry of J, eq. (14); None if exact."""
        return self._error(self.velocities)

    @cached_property
    def decision(self) -> RankedSvd:
        """Rank decision on J."""
        return self.decide(self.J, self.scale(None), self.error)

    @cached_property
    def moved(self) -> RankedSvd:
        """Rank decision on the task motion with every active joint locked."""
        return self.decide(self.self_motion_task, self.geometry.size, self.self_motion_error)

    @cached_property
    def self_motion_task(self) -> Array:
        """Task motion per self-motion, shape (..., m, .)."""
        return self.geometry.task @ self.self_motion

    @cached_property
    def self_motion_error(self) -> Array | None:
        """Error bound of the task motion per self-motion; None if exact."""
        return self._error(self.self_motion) if self.self_motion.shape[-1] else None

    @property
    def task_units(self) -> Array:
        """Natural units of the task rows, shape (m,)."""
        return self.geometry.task_units

    @property
    def rate_units(self) -> Array:
        """Natural units of the rates, shape (n,)."""
        return self.geometry.velocity_units[self.actuated]

    @cached_property
    def start(self) -> "RemainingMotion":
        """Remaining motion before any step: all admissible rates."""
        nothing = np.zeros((*self.velocities.shape[:-2], len(self.actuated), 0))
        error = None if self.error is None else transposed(nothing)
        return RemainingMotion(self.admissible, nothing, error)

    def step(self, S: Array) -> "Step":
        """Return the rows S J, S (k, m) in natural units."""
        error = None if self.error is None else np.abs(S) @ self.error
        return Step(S @ self.J, frobenius(S) * self.size(S), error)

    def decide(self, A: Array, scale: Array | float, error: Array | None) -> RankedSvd:
        """Decide the rank of a product of this size, with complete bases."""
        return ranked_svd(A, scale, self.geometry.rank_tolerance, full=True, error=error)

    def scale(self, S: Array | None) -> Array:
        """Return the size of the terms of the task rows used by S (k, m), or of all rows, (...)."""
        task = self.geometry.task
        rows = task if S is None else task[S.any(axis=0)]
        follow = self.moving[..., None] * self.velocities
        through = np.sqrt((rows**2).sum(axis=0))[:, None]
        return frobenius(rows) + frobenius(through * follow)

    def size(self, S: Array) -> Array:
        """Return `scale`, but not less than the round-off of larger rows requires, shape (...)."""
        return np.maximum(self.scale(S), LEAST_ROWS * self._size)

    @cached_property
    def _size(self) -> Array:
        return self.scale(None)

    def _error(self, velocities: Array) -> Array | None:
        """Return the error bounds of the task motion for this motion of all joints."""
        geometry, closing = self.geometry, self.closing
        if geometry.task_error is None:
            return None
        error = geometry.task_error @ np.abs(velocities)
        if closing is None or geometry.closure_error is None:
            return error
        return error + np.abs(closing) @ (geometry.closure_error @ np.abs(velocities))


class Step(NamedTuple):
    """Rows on which a rank is decided after others: A (..., k, n), its size, and its errors."""

    A: Array
    scale: Array
    error: Array | None


class RemainingMotion(NamedTuple):
    """Null space of the rows processed so far, with their error bound.

    Attributes:
        free: Rates that leave these rows at rest: basis (n, .) or projector (..., n, n).
        gain: Rates that move each row without moving the previous ones, shape (..., n, k).
        error: Error bounds of the rows, (..., k, n); None if exact.
    """

    free: Array
    gain: Array
    error: Array | None

    def then(self, task: TaskMotion, step: Step) -> tuple[RankedSvd, "RemainingMotion"]:
        """Decide the rank of further rows on the null space, and return the remaining motion."""
        N, error = self.free, step.error
        moved = step.A @ self.gain
        if error is not None and self.error is not None:
            # Errors of the previous rows rotate the null space on which the further rows act.
            error = (error + np.abs(moved) @ self.error) @ np.abs(N)
        svd = task.decide(step.A @ N, step.scale, error)
        inverse = N @ svd.pseudo_inverse()
        gain = np.concatenate([self.gain - inverse @ moved, inverse], axis=-1)
        rows = None
        if step.error is not None and self.error is not None:
            rows = np.concatenate([self.error, step.error], axis=-2)
        return svd, RemainingMotion(N @ null_of(svd), gain, rows)

    def negligible(self, decision: RankedSvd, A: Array) -> Array | None:
        """Return the part of further rows A (..., k, n) of decided rank zero, (..., k, n).

        None if the part is round-off. A are rows for the solvers; with badly conditioned loops
        their zero directions differ from those of the rows whose rank was decided.
        """
        is_dropped = ~decision.significant & (decision.sigma > decision.round_off)
        is_more = is_dropped.any(axis=-1, keepdims=True)
        if not is_more.any():
            return None
        U, sigma, Vt = np.linalg.svd(A @ self.free, full_matrices=False)
        part = (U * np.where(~decision.significant & is_more, sigma, 0.0)[..., None, :]) @ Vt
        return part @ transposed(self.free)


def null_of(svd: RankedSvd) -> Array:
    """Return a basis of the null space of one matrix, or the projectors of many."""
    return svd.null if svd.sigma.ndim == 1 else svd.null_projector()
