"""Worst-case major speed and force within limits, under many failure conditions at once."""

from math import comb
from typing import NamedTuple

import numpy as np

from argument_checks import Array, Mask
from prioritized._analysis.facets import ball, refuse_too_many
from prioritized._analysis.major_maps import MajorMap, of_rates, of_torques, with_free
from prioritized._analysis.polytope import Polytope, polytope
from prioritized._mapping.problem import Problem
from prioritized._solver.limits import Limits

BLOCK = 2**18
"""Largest number of elements in one block of facets, chosen to fit the cache."""


class ActuatorLimits(NamedTuple):
    """Limits of n actuators, and which of them are active under each of C conditions.

    Attributes:
        active: Shape (C, n).
        rates: Lower and upper limits, shape (C, n) each; None is not to be evaluated.
        torques: Lower and upper limits, shape (C, n) each; None is not to be evaluated.
    """

    active: Mask
    rates: Limits | None
    torques: Limits | None

    def speed(self, problem: Problem, possible: Mask) -> Array | None:
        """Return the radius of the attainable velocities, zero where impossible, shape (C,)."""
        if self.rates is None:
            return None
        return np.where(possible, self._radii(of_rates(problem), self.rates, problem.tolerance), 0)

    def force(self, problem: Problem) -> Array | None:
        """Return the radius of the attainable forces, shape (C,)."""
        if self.torques is None:
            return None
        return self._radii(of_torques(problem), self.torques, problem.tolerance)

    def _radii(self, maps: MajorMap, limits: Limits, tolerance: float) -> Array:
        """Return the radii with facets chosen among the columns of the survivors alone."""
        radius, survivors = np.zeros(len(self.active)), self.active.sum(axis=1)
        for count in np.unique(survivors).tolist():
            rows = np.flatnonzero(survivors == count)
            columns = np.nonzero(self.active[rows])[1].reshape(len(rows), 1, count)
            lower, upper = (np.take_along_axis(A[rows], columns[:, 0], axis=1) for A in limits)
            subset = MajorMap._make(A[rows] for A in maps)
            survivors_only = {
                name: np.take_along_axis(getattr(subset, name), columns, axis=-1)
                for name in ("gain", "constraint")
            }
            radius[rows] = radii(subset._replace(**survivors_only), lower, upper, tolerance)
        return radius


def radii(maps: MajorMap, lower: Array, upper: Array, tolerance: float) -> Array:
    """Return the radius of the largest ball about zero in the set of each of C maps, shape (C,).

    It equals :attr:`prioritized.Attainable.radius`; sets with facets of one size are batched. The
    limits of x have the shape (C, n).

    Raises:
        ValueError: Too many facets to be enumerated.
    """
    radius = np.zeros(len(maps.gain))
    for free in np.unique(maps.dimension).tolist():
        rows = np.flatnonzero(maps.dimension == free)
        subset = MajorMap._make(A[rows] for A in maps)
        sets = polytope(*with_free(subset, lower[rows], upper[rows], free), subset.scale, tolerance)
        full = sets.consistent & (sets.rank == maps.gain.shape[-2])
        for r in np.unique(sets.constraints[full]).tolist():
            rows_of_rank = np.flatnonzero(full & (sets.constraints == r))
            is_empty = not r and not maps.gain.shape[-2]  # neither constraints nor major rows
            radius[rows[rows_of_rank]] = np.inf if is_empty else _balls(sets.part(rows_of_rank), r)
    return radius


def _balls(sets: Polytope, r: int) -> Array:
    """Return the radii of sets of full rank whose C have rank r."""
    refuse_too_many(sets)
    (C, n), m1 = sets.lower.shape, sets.offset.shape[1]
    blocks = np.array_split(np.arange(C), 1 + C * n * comb(n, m1 + r - 1) // BLOCK)
    return np.concatenate([ball(sets.part(block), r) for block in blocks])
