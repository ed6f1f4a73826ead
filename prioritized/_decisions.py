"""Every rank decision on a task, made once: mappings, classification and atlas all read these.

In natural units; of one failure condition or of many, whose axes lead, as in :class:`Motions`.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from argument_checks import Array, Indices
from prioritized._arrays import transposed
from prioritized._motions import Motions
from prioritized._rank import RANK_TOLERANCE, RankedSvd, frobenius, largest, norm, ranked_svd

_BELOW = 1e-15
"""Part of the size of the terms below which singular values are round-off."""
_LEAST_ROWS = 1e-4
"""Part of the whole task's size that some of its rows have at least: smaller ones are round-off."""


@dataclass(frozen=True, eq=False)
class TaskMotion:
    """How the whole task moves.

    Attributes:
        motions: That the mechanism admits.
        actuated: Velocity indices of the columns of J, (n,).
    """

    motions: Motions
    actuated: Indices

    @cached_property
    def J(self) -> Array:
        """Task Jacobian on the admissible rates, zero on all others, shape (..., m, n)."""
        return self._task @ self.motions.driven

    @cached_property
    def error(self) -> Array | None:
        """Bound of the error of each entry of J: of eq. (14) to first order; None where exact."""
        return self._error(self._velocities)

    @cached_property
    def reach(self) -> RankedSvd:
        """Of J."""
        return self.decided(self.J, self.scale(None), self.error)

    @cached_property
    def moved(self) -> RankedSvd:
        """Of the task motion with every active joint locked."""
        return self.decided(self.still, frobenius(self.motions.geometry.task), self.still_error)

    @cached_property
    def still(self) -> Array:
        """Task motion per self-motion, shape (..., m, .)."""
        return self._task @ self.motions.self_motion

    @cached_property
    def still_error(self) -> Array | None:
        """Bound of its error."""
        F = self.motions.self_motion
        return self._error(self.motions.geometry.motions @ F) if F.shape[-1] else None

    @property
    def task_units(self) -> Array:
        """Natural units of the task rows, shape (m,)."""
        return self.motions.geometry.task_units

    @property
    def rate_units(self) -> Array:
        """Natural units of the rates, shape (n,)."""
        return self.motions.geometry.velocity_units[self.actuated]

    @cached_property
    def start(self) -> "Before":
        """Before any step: all admissible rates are free."""
        Z, rank = self.motions.admissible, self.motions.rates.rank
        free = Z[:, : int(rank)] if Z.ndim == 2 else Z @ transposed(Z)
        none = np.zeros((*Z.shape[:-1], 0))
        return Before(free, none, None if self.error is None else transposed(none))

    def step(self, S: Array) -> "Step":
        """The rows S J, S (k, m) in natural units."""
        error = None if self.error is None else np.abs(S) @ self.error
        return Step(S @ self.J, frobenius(S) * self.size(S), error)

    def decided(self, A: Array, scale: Array, error: Array | None) -> RankedSvd:
        """The rank decision on a product of this size, with the whole bases."""
        tolerance = self.motions.geometry.rank_tolerance
        return ranked_svd(A, scale, tolerance, full=True, error=error)

    def scale(self, S: Array | None) -> Array:
        """Size of the terms of the task rows that S (k, m) takes part in, or of all, (...)."""
        task = self.motions.geometry.task
        rows = task if S is None else task[S.any(axis=0)]
        follow = self.motions.moving[..., None] * self._velocities
        through = np.sqrt((rows**2).sum(axis=0))[:, None]
        return frobenius(rows) + frobenius(through * follow)

    def size(self, S: Array) -> Array:
        """The same, but not below what round-off leaves of larger rows, shape (...)."""
        return np.maximum(self.scale(S), _LEAST_ROWS * self.scale(None))

    def _error(self, velocities: Array) -> Array | None:
        """Of the task motion in this motion of all joints."""
        geometry, closing = self.motions.geometry, self.motions.closing
        if geometry.task_error is None:
            return None
        error = geometry.task_error @ np.abs(velocities)
        if closing is None or geometry.closure_error is None:
            return error
        return error + np.abs(closing) @ (geometry.closure_error @ np.abs(velocities))

    @cached_property
    def _task(self) -> Array:
        return self.motions.geometry.task @ self.motions.geometry.motions

    @cached_property
    def _velocities(self) -> Array:
        return self.motions.velocities


class Step(NamedTuple):
    """Rows that are decided on after others: A (..., k, n), its size, and the errors of it."""

    A: Array
    scale: Array
    error: Array | None


class Before(NamedTuple):
    """What earlier steps leave, and how far off their rows may be.

    Attributes:
        free: Rates that they leave at rest: basis (n, .) or projector (..., n, n).
        gain: Rates that move them, each without moving those before it, shape (..., n, k).
        error: Of their rows, (..., k, n); None where exact.
    """

    free: Array
    gain: Array
    error: Array | None

    def then(self, task: TaskMotion, step: Step) -> tuple[RankedSvd, "Before"]:
        """The rank decision on further rows with these at rest, and what both leave."""
        N, error = self.free, step.error
        moved = step.A @ self.gain
        if error is not None and self.error is not None:
            # As the null space turns, so does what the further rows see of it.
            error = (error + np.abs(moved) @ self.error) @ np.abs(N)
        decided = task.decided(step.A @ N, step.scale, error)
        own = N @ decided.pseudo_inverse()
        gain = np.concatenate([self.gain - own @ moved, own], axis=-1)
        rows = None
        if step.error is not None and self.error is not None:
            rows = np.concatenate([self.error, step.error], axis=-2)
        return decided, Before(N @ null_of(decided), gain, rows)

    def dropped(self, decided: RankedSvd) -> Array | None:
        """The part of further rows that is more than round-off and counts as zero, (..., k, n)."""
        some = ~decided.kept & (decided.sigma > decided.round_off)
        if not some.any():
            return None
        k = decided.sigma.shape[-1]
        sigma = np.where(some, decided.sigma, 0.0)
        part = (decided.U[..., :k] * sigma[..., None, :]) @ decided.Vt[..., :k, :]
        return part @ transposed(self.free)


class Decided(NamedTuple):
    """What mappings of one condition take, its rank decisions made.

    Attributes:
        J: Task Jacobian without what counts as lost, (m, n).
        scale: Size of J for which :data:`RANK_TOLERANCE` parts what counts from what does not.
        self_motion: Task directions (m, k) whose major parts S_m self_motion are orthonormal and
            move with every active joint locked.
        gap: Smallest gap of the decisions.
    """

    J: Array
    scale: float
    self_motion: Array
    gap: float


@dataclass(frozen=True, eq=False)
class MajorTask:
    """The decisions on a major task v_m = S_m v, and on a secondary one with it at rest.

    Attributes:
        task: The whole task.
        S_m: Shape (m1, m).
        S_s: Shape (m2, m).
    """

    task: TaskMotion
    S_m: Array
    S_s: Array

    @property
    def reach(self) -> RankedSvd:
        """Of the major Jacobian."""
        return self._first[0]

    @property
    def secondary(self) -> RankedSvd:
        """Of the secondary Jacobian with the major task at rest."""
        return self._second[0]

    @cached_property
    def _first(self) -> tuple[RankedSvd, "Before"]:
        return self.task.start.then(self.task, self.task.step(self._major))

    @cached_property
    def _second(self) -> tuple[RankedSvd, "Before"]:
        return self._first[1].then(self.task, self.task.step(self._secondary))

    @cached_property
    def moved(self) -> RankedSvd:
        """Of the major motion with every active joint locked."""
        S, error, task = self._major, self.task.still_error, self.task.motions.geometry.task
        # Against the 2-norm, so that with every row major it is the decision on the whole task.
        rows = np.maximum(frobenius(task[S.any(axis=0)]), _LEAST_ROWS * frobenius(task))
        size = largest(S) * rows
        return self.task.decided(
            S @ self.task.still, size, None if error is None else np.abs(S) @ error
        )

    @cached_property
    def aside(self) -> RankedSvd:
        """Of the task motion, active joints locked, that does not move the major task."""
        rest, error = null_of(self.moved), self.task.still_error
        error = None if error is None else error @ np.abs(rest)
        size = frobenius(self.task.motions.geometry.task)
        return self.task.decided(self.task.still @ rest, size, error)

    @cached_property
    def lost(self) -> Array | None:
        """What J has of the directions that count as lost, in its own units, shape (..., m, n).

        Without it the ranks of J are those decided here, by far. None where there is nothing.
        """
        of_major = self.task.start.dropped(self.reach)
        of_secondary = self._first[1].dropped(self.secondary)
        if of_major is None and of_secondary is None:
            return None
        S_m, S_s = self._major, self._secondary
        lost = np.zeros(self.task.J.shape)
        if of_major is not None:
            lost = lost + np.linalg.pinv(S_m) @ of_major
        if of_secondary is not None:
            beside = S_s @ (np.eye(S_s.shape[1]) - np.linalg.pinv(S_m) @ S_m)
            lost = lost + np.linalg.pinv(beside) @ of_secondary
        return self.task.task_units[:, None] * lost / self.task.rate_units

    @property
    def gap(self) -> Array:
        """Smallest gap of the decisions that a mapping rests on, shape (...)."""
        decisions = self.reach, self.moved, self.secondary
        return np.minimum.reduce([self.task.motions.gap, *(one.gap for one in decisions)])

    def of(self, J: Array, scale: float, constraint: Array) -> Decided:
        """What mappings take, for J (m, n) of one condition on all rates, rows C (r, n).

        `scale` is the size of the terms whose difference is J.
        """
        lost = self.lost
        J = J if lost is None else J - lost
        U = self.moved.U[:, : int(self.moved.rank)]
        self_motion = np.linalg.pinv(self.S_m) @ respanned(U, self.major_units)
        size = self.parting(J - J @ constraint.T @ constraint, np.asarray(scale))
        return Decided(J, float(size), self_motion, float(self.gap))

    def parting(self, J: Array, scale: Array) -> Array:
        """Size of J (..., m, n) for which :data:`RANK_TOLERANCE` parts what counts from the rest.

        The `scale` of its terms unless that would drop a direction that counts, shape (...).
        """
        if not (size := norm(self.S_m) * RANK_TOLERANCE):
            return scale
        sigma = np.linalg.svd(self.S_m @ J, compute_uv=False)
        counts = np.arange(sigma.shape[-1]) < self.reach.rank[..., None]
        least = sigma.min(axis=-1, initial=np.inf, where=counts)
        between = np.sqrt(np.minimum(least, scale) * norm(self.S_m) * _BELOW * scale) / size
        return np.where(least > 2.0 * size * scale, scale, between)

    @cached_property
    def major_units(self) -> Array:
        """Natural unit of each major velocity, shape (m1,)."""
        return _units_of(self.S_m, self.task.task_units)

    @cached_property
    def secondary_units(self) -> Array:
        """Natural unit of each secondary velocity, shape (m2,)."""
        return _units_of(self.S_s, self.task.task_units)

    @cached_property
    def gain_unit(self) -> float:
        """Major velocity over rate of which gains are multiples: 1 where these are of two kinds."""
        rates = self.task.rate_units
        kinds = [np.unique(units) for units in (self.major_units, rates)]
        if any(len(kind) != 1 for kind in kinds):
            return 1.0
        return float(kinds[0][0] / kinds[1][0])

    @cached_property
    def _major(self) -> Array:
        units = self.task.task_units
        return self.S_m * units / self.major_units[:, None]

    @cached_property
    def _secondary(self) -> Array:
        units = self.task.task_units
        return self.S_s * units / self.secondary_units[:, None]


def _units_of(S: Array, units: Array) -> Array:
    """Of directions, the norm of their units per unit norm."""
    sizes = np.sqrt((S**2).sum(axis=1))
    return np.sqrt(((S * units) ** 2).sum(axis=1)) / np.where(sizes > 0.0, sizes, 1.0) + (
        sizes == 0.0
    )


def null_of(decided: RankedSvd) -> Array:
    """Of one matrix a basis of its null space, of many the projectors."""
    return decided.null if decided.sigma.ndim == 1 else decided.null_projector()


def respanned(columns: Array, factors: Array) -> Array:
    """Orthonormal basis of the span of columns times row factors; zero ones stay, (..., k, .)."""
    if not columns.size or (factors == factors[0]).all():
        return columns
    moved = factors[:, None] * columns
    U, sigma, _ = np.linalg.svd(moved, full_matrices=False)
    count = (np.linalg.norm(columns, axis=-2) > 0.5).sum(axis=-1)
    return U * (np.arange(sigma.shape[-1]) < count[..., None])[..., None, :]


def in_order(
    task: TaskMotion, levels: list[tuple[Array, Array]], rows: list[tuple[Array, float]]
) -> list[tuple[Array, float]]:
    """Levels of one condition without what counts as lost where those before them are at rest.

    Args:
        task: How the task moves; it has rates.
        levels: Rows on the task (k, m), and on the rates (k, n), to be added.
        rows: Their sums A (k, n) as rows on the rates, and the size of the terms.
    """
    before, decided = task.start, []
    for (S, R), (A, size) in zip(levels, rows, strict=True):
        units = _units_of(np.hstack([S, R]), np.hstack([task.task_units, task.rate_units]))
        on_task = S * task.task_units / units[:, None]
        on_rates = R * task.rate_units / units[:, None]
        step = task.step(on_task)
        all_rows = Step(step.A + on_rates, step.scale + norm(on_rates), step.error)
        decision, after = before.then(task, all_rows)
        lost = before.dropped(decision)
        if lost is not None:
            A = A - units[:, None] * lost / task.rate_units
        least = decision.sigma.min(initial=np.inf, where=decision.kept)
        least *= units.min(initial=np.inf) / task.rate_units.max(initial=0.0)
        if least < 2.0 * RANK_TOLERANCE * size:
            size = float(np.sqrt(least * _BELOW * size)) / RANK_TOLERANCE
        decided.append((A, size))
        before = after
    return decided
