"""Attainable major velocities within rate limits, and major forces within torque limits."""

from dataclasses import dataclass
from enum import Enum
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

import argument_checks as check
from argument_checks import Array, Indices
from argument_checks.ties import ACCURACY, ascending, ranks
from prioritized._analysis.facets import ball, dual_vertices, facets, farthest, refuse_too_many
from prioritized._analysis.major_maps import MajorMap, with_free
from prioritized._analysis.polytope import Polytope, polytope
from prioritized._mapping.amplification import as_sentence
from prioritized._solver.arrays import ReadOnly, read_only
from prioritized._solver.limits import Limits
from prioritized._solver.rank import RANK_TOLERANCE


def corners(normal: Array, distance: Array) -> Array:
    """Return the corners (V, k) of the bounded set {z : normal @ z <= distance}, each once.

    In the plane the order is counter-clockwise; a set without interior has no rows. Normals are (F,
    k), distances (F,), infinite for no bound.
    """
    # Imported here: together they take as long to import as the whole library.
    from scipy.optimize import linprog
    from scipy.spatial import ConvexHull, HalfspaceIntersection

    k = normal.shape[1]
    length = np.linalg.norm(normal, axis=1)
    real = np.isfinite(distance) & (length > 0.0)
    if not k or not real.any():
        return np.zeros((1, k))
    A, b = normal[real] / length[real, None], distance[real] / length[real]
    size = np.abs(b).max() or 1.0
    # Equal actuators give equal half-spaces; round-off would split their corners.
    once = _distinct(np.column_stack([A, b / size]))
    A, b = A[once], b[once]
    # The center of the largest ball inside.
    inside = linprog(
        -np.eye(k + 1)[k],
        A_ub=np.column_stack([A, np.ones(len(A))]),
        b_ub=b / size,
        bounds=[(None, None)] * k + [(None, 1.0)],
    )
    if not inside.success or inside.x[k] < ACCURACY:  # qhull needs an interior
        return np.zeros((0, k))
    if k == 1:
        lowest, highest = -b[A[:, 0] < 0].min(), b[A[:, 0] > 0].min()
        return np.array([[lowest], [highest]])
    vertices = HalfspaceIntersection(np.column_stack([A, -b / size]), inside.x[:k]).intersections
    vertices = vertices[_distinct(vertices)]
    return size * vertices[ConvexHull(vertices).vertices]


def in_order(corners: Array) -> Array:
    """Sort corners (V, k) independently of the processor's round-off.

    In the plane the cyclic order is preserved and starts with the lexicographically last corner;
    otherwise the order is lexicographic.
    """
    order = ascending(*corners.T, zero=ACCURACY * np.abs(corners).max(initial=0.0))
    return np.roll(corners, -order[-1], axis=0) if corners.shape[1] == 2 else corners[order]


def _distinct(points: Array) -> Indices:
    """Return the first index of each set of equal points (P, k) of unit size, in order."""
    groups = np.stack([ranks(column, zero=ACCURACY) for column in points.T], axis=1)
    return np.sort(np.unique(groups, axis=0, return_index=True)[1])


BLOCK = 2**20
"""Largest number of elements in one block of support evaluations, chosen to fit the cache."""


class AttainableStatus(Enum):
    """Meaning of the radius of an attainable set; the value is a sentence."""

    INTERIOR = "every major direction is possible within the limits, up to the radius at least"
    UNREACHABLE = (
        "the actuators that the limits let move do not reach every major direction: drop major "
        "rows, or restore an actuator"
    )
    NOT_INTERIOR = "the limits exclude a neighborhood of zero in some major direction"
    SELF_MOTION = (
        "the major task can move with every actuator locked, so that no velocity of it can be "
        "commanded: brake a joint, drop major rows, or give the system the stiffness that resists "
        "this motion"
    )
    EMPTY = "no values within the limits obey the constraints: widen the limits"


@dataclass(frozen=True, eq=False)
class Attainable(ReadOnly):
    """Set of attainable major velocities, or forces, {G x : C x = 0, lower <= x <= upper}.

    A convex polytope, in control allocation the attainable moment set. Created by
    :meth:`prioritized.Kinematics.attainable` and :meth:`prioritized.Kinematics.attainable_force`.

    Attributes:
        gain: G, major velocity or force per x, shape (m1, n').
        constraint: C, shape (r, n').
        lower: Lower limits of x: rates, or torques followed by unlimited forces that the structure
            bears without torque, shape (n',). Where rates are angular and linear, in units of 1 rad
            and of the mechanism's length.
        upper: Upper limits of x.
        scale: Size of the matrices that G was computed from.
        rank_tolerance: Fraction of the scale below which a singular value of G is zero.
        self_motion: Whether the major task can move with every actuator locked.
    """

    gain: Array
    constraint: Array
    lower: Array
    upper: Array
    scale: float
    rank_tolerance: float
    self_motion: bool = False

    @property
    def status(self) -> AttainableStatus:
        """Meaning of the radius, an `AttainableStatus` whose value is a sentence."""
        if self._empty:
            return AttainableStatus.EMPTY
        if self.self_motion:
            return AttainableStatus.SELF_MOTION
        if self._rank < len(self.gain):
            return AttainableStatus.UNREACHABLE
        return AttainableStatus.INTERIOR if self.radius else AttainableStatus.NOT_INTERIOR

    @cached_property
    def radius(self) -> float:
        """Radius of the largest ball about zero in the set, infinite where no limit bounds it.

        Zero if zero is not in the interior, and if self-motion moves the major task, because no
        velocity can then be commanded; the status distinguishes the cases.
        """
        if self._empty or self.self_motion or self._rank < len(self.gain):
            return 0.0
        return float(ball(self._polytope, self._constraints))

    @property
    def bounded(self) -> bool:
        """Return whether the set is bounded; forces that the structure bears have no bound."""
        axes = np.eye(len(self.gain))
        return bool((self.support(np.vstack([axes, -axes])) < np.inf).all())

    def support(self, direction: ArrayLike) -> Array:
        """Return the support function of the set: the largest d . v of all v in it, shape (...).

        It is a speed or force for a unit d, otherwise proportional to its norm. Infinite where no
        limit bounds the direction, minus infinity where the set is empty.

        Args:
            direction: d, shape (..., m1).
        """
        D = check.array("direction", direction, ..., len(self.gain))
        if self._empty:
            return np.full(D.shape[:-1], -np.inf)
        size = np.abs(D).max(axis=-1, initial=0.0)
        flat = (D / np.where(size > 0.0, size, 1.0)[..., None]).reshape(size.size, D.shape[-1])
        blocks = np.array_split(flat, 1 + flat.shape[0] * self._dual.size // BLOCK)
        h = np.concatenate([self._support(d) for d in blocks]).reshape(size.shape)
        return np.multiply(h, size, out=np.zeros_like(h), where=size > 0.0)

    @cached_property
    def vertices(self) -> Array:
        """Corners of the set, shape (V, m1), each once; in the plane counter-clockwise.

        In the plane the first corner has the largest first coordinate; otherwise the order is
        lexicographic. There are no rows if the set is empty, unbounded, or without interior because
        the constraints fix some x at their limits.
        """
        P, k = self._polytope, self._rank
        if self._empty or not self.bounded:
            return read_only(np.zeros((0, len(self.gain))))
        half_spaces = facets(P, k, self._constraints)
        z = corners(half_spaces.normal, half_spaces.distance)
        vertices = P.offset + (z * P.sigma[:k]) @ P.U[:, :k].T
        if k == len(P.U) == 2 and np.linalg.det(P.U) < 0.0:  # U mirrors the plane
            vertices = vertices[::-1]
        return read_only(in_order(vertices) if vertices.size else vertices)

    def __str__(self) -> str:
        sentence = as_sentence(self.status.value)
        return sentence if self.bounded else f"{sentence} In some direction there is no limit."

    @cached_property
    def _polytope(self) -> Polytope:
        limits = self.lower, self.upper
        return polytope(self.gain, self.constraint, *limits, self.scale, self.rank_tolerance)

    @property
    def _rank(self) -> int:
        return int(self._polytope.rank)

    @property
    def _constraints(self) -> int:
        return int(self._polytope.constraints)

    @cached_property
    def _empty(self) -> bool:
        P = self._polytope
        if not P.consistent:
            return True
        if (P.lower <= 0.0).all() and (P.upper >= 0.0).all():  # x = 0 is in the set
            return False
        bounds = facets(P, 0, self._constraints)
        return bool((bounds.distance < -RANK_TOLERANCE * bounds.size).any())

    @cached_property
    def _dual(self) -> Array:
        return dual_vertices(self._polytope, self._rank, self._constraints)

    def _support(self, D: Array) -> Array:
        """Return the support in directions D (B, m1) of a set that is not empty."""
        P = self._polytope
        c = np.einsum("bm,kmn->bkn", D, self._dual)
        zero = P.tolerance * self.scale * np.linalg.norm(D, axis=-1)[:, None, None]
        return D @ P.offset + farthest(c, P.lower, P.upper, zero).min(axis=-1)


def attainable(
    of: MajorMap, limits: Limits, rank_tolerance: float, *, self_motion: bool = False
) -> Attainable:
    """Return the attainable set of one map within limits of its x; refuse too many facets."""
    G, C, lower, upper = with_free(of, limits[0], limits[1], int(of.dimension))
    result = Attainable(G, C, lower, upper, float(of.scale), rank_tolerance, self_motion)
    refuse_too_many(result._polytope)
    return result
