"""Rank decisions on a task, made once and used by mappings, classification and atlas.

In natural units, for one failure condition or for many, whose axes lead.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from argument_checks import Array, Indices
from prioritized._mechanism.measure import Measure, units_of
from prioritized._mechanism.task_motion import LEAST_ROWS, RemainingMotion, TaskMotion, null_of
from prioritized._solver.arrays import transposed
from prioritized._solver.rank import RANK_TOLERANCE, RankedSvd, frobenius, largest, norm


@dataclass(frozen=True, eq=False)
class MajorTask:
    """Rank decisions on a major task v_m = S_m v, and on a secondary one with v_m = 0.

    Attributes:
        task: Motion of the whole task.
        S_m: Shape (m1, m).
        S_s: Shape (m2, m).
    """

    task: TaskMotion
    S_m: Array
    S_s: Array

    @property
    def decision(self) -> RankedSvd:
        """Rank decision on the major Jacobian."""
        return self._first[0]

    @property
    def secondary(self) -> RankedSvd:
        """Rank decision on the secondary Jacobian with the major task at rest."""
        return self._second[0]

    @cached_property
    def _first(self) -> tuple[RankedSvd, RemainingMotion]:
        return self.task.start.then(self.task, self.task.step(self._major))

    @cached_property
    def _second(self) -> tuple[RankedSvd, RemainingMotion]:
        return self._first[1].then(self.task, self.task.step(self._secondary))

    @cached_property
    def moved(self) -> RankedSvd:
        """Rank decision on the major motion with every active joint locked."""
        S, error, task = self._major, self.task.self_motion_error, self.task.geometry.task
        # Scaled by the 2-norm, so that with every row major it is the decision on the whole task.
        rows = np.maximum(frobenius(task[S.any(axis=0)]), LEAST_ROWS * self.task.geometry.size)
        error = None if error is None else np.abs(S) @ error
        return self.task.decide(S @ self.task.self_motion_task, largest(S) * rows, error)

    @cached_property
    def moved_secondary(self) -> RankedSvd:
        """Rank decision on self-motion of the task that leaves the major task at rest."""
        null, error = null_of(self.moved), self.task.self_motion_error
        error = None if error is None else error @ np.abs(null)
        return self.task.decide(self.task.self_motion_task @ null, self.task.geometry.size, error)

    @property
    def gap(self) -> Array:
        """Smallest gap of the rank decisions that a mapping depends on, shape (...)."""
        decisions = self.decision, self.moved, self.secondary
        return np.minimum.reduce([self.task.gap, *(svd.gap for svd in decisions)])

    def truncated(
        self, J: Array, scale: Array | float, constraint: Array, metric: Array | None = None
    ) -> tuple[Array, Array]:
        """Return J (..., m, n) without components of decided rank zero, and the scale of its rank.

        With this scale solvers reproduce the decisions made here. J and its size `scale` (...) are
        in natural units; `constraint` is a projector or orthonormal rows of forbidden rates;
        `metric` is M (k, m1) of the major velocity in its own units, None for natural units.
        """
        S_m, S_s = self._major, self._secondary
        if (negligible := self.task.start.negligible(self.decision, S_m @ J)) is not None:
            J = J - np.linalg.pinv(S_m) @ negligible
        if (negligible := self._first[1].negligible(self.secondary, S_s @ J)) is not None:
            complement = S_s @ (np.eye(S_s.shape[1]) - np.linalg.pinv(S_m) @ S_m)
            J = J - np.linalg.pinv(complement) @ negligible
        S = S_m if metric is None else metric @ (self.S_m * self.task.task_units)
        admissible: Array = S @ (J - J @ transposed(constraint) @ constraint)
        sigma = np.linalg.svd(admissible, compute_uv=False)
        return J, separating_scale(scale, norm(S), sigma, self.decision.rank)

    @property
    def gain_uncertainty(self) -> float:
        """Relative error of the least gain due to the accuracy of the geometry, for one condition.

        Zero if a direction is unreachable.
        """
        return self.decision.uncertainty if self.decision.rank == len(self.S_m) else 0.0

    @cached_property
    def major_units(self) -> Array:
        """Natural unit of each major velocity, shape (m1,)."""
        return units_of(self.S_m, self.task.task_units)

    @cached_property
    def secondary_units(self) -> Array:
        """Natural unit of each secondary velocity, shape (m2,)."""
        return units_of(self.S_s, self.task.task_units)

    @property
    def measure(self) -> Measure:
        """Natural units of major velocities and rates."""
        return Measure(self.major_units, self.task.rate_units)

    @cached_property
    def _major(self) -> Array:
        return self.S_m * self.task.task_units / self.major_units[:, None]

    @cached_property
    def _secondary(self) -> Array:
        return self.S_s * self.task.task_units / self.secondary_units[:, None]


def separating_scale(
    scale: Array | float, size: float, sigma: NDArray[Any], rank: Indices
) -> Array:
    """Return the scale of J at which RANK_TOLERANCE separates significant from zero directions.

    It is the `scale` (...) of the terms of J unless that would drop one of the `rank` significant
    singular values `sigma` (..., k) of S J; `size` is the norm of S.
    """
    counts = np.arange(sigma.shape[-1]) < np.asarray(rank)[..., None]
    least = sigma.min(axis=-1, initial=np.inf, where=counts)
    return np.minimum(scale, 0.5 * least / (RANK_TOLERANCE * (size or 1.0)))


def respanned(columns: Array, factors: Array) -> Array:
    """Return an orthonormal basis of columns with scaled rows, (..., k, .); zero ones stay."""
    if not columns.size or (factors == factors[0]).all():
        return columns
    U, sigma, _ = np.linalg.svd(factors[:, None] * columns, full_matrices=False)
    count = (np.linalg.norm(columns, axis=-2) > 0.5).sum(axis=-1)
    return U * (np.arange(sigma.shape[-1]) < count[..., None])[..., None, :]
