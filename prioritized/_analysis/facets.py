"""Facets, ball about zero and support of {G x : C x = 0, lower <= x <= upper}.

Leading axes are batch axes. With c = G^T d + C^T y, linear programming duality gives the
largest d . v as the least h(d, y) = sum_i max(lower_i c_i, upper_i c_i) over y. The half-spaces
d . v <= h(d, y) of all (d, y) contain the set; it is the intersection of those normal to the facets
of {[G; C] x : lower <= x <= upper}. Such a normal is orthogonal to rank - 1 independent columns.
"""

import itertools
from math import comb
from typing import NamedTuple

import numpy as np

from argument_checks import Array, Indices
from prioritized._analysis.polytope import Polytope
from prioritized._solver.arrays import transposed
from prioritized._solver.rank import RANK_TOLERANCE, ranked_svd

MOST_CHOICES = 100_000
"""Largest number of column sets that are enumerated for the facets."""


def refuse_too_many(P: Polytope) -> None:
    """Raise a ValueError if a polytope has more than :data:`MOST_CHOICES` sets of columns."""
    m1, n = P.offset.shape[-1], P.lower.shape[-1]
    for r in np.unique(P.constraints).tolist():
        for k in (m1 + r - 1, r):
            if k > 0 and comb(n, k) > MOST_CHOICES:
                raise ValueError(
                    f"major must leave at most {MOST_CHOICES} sets of actuators to enumerate, got "
                    f"{comb(n, k)}: {k} of {n}"
                )


class Facets(NamedTuple):
    """Half-spaces normal @ z <= distance with v = offset + U sigma z that include every facet.

    Attributes:
        normal: Shape (..., F, k); zero if v is unbounded, and `distance` must then not be negative.
        distance: Infinite where there is no bound, shape (..., F).
        size: Sum of the absolute terms of `distance`, the scale of its round-off, shape (..., F).
    """

    normal: Array
    distance: Array
    size: Array


def facets(P: Polytope, k: int, r: int) -> Facets:
    """Return the facets of polytopes whose G has rank k and whose C has rank r.

    With k = 0 they only state whether the limits allow C x = 0: if no distance is negative.
    """
    E = np.concatenate([P.Vt[..., :k, :], P.rows[..., :r, :]], axis=-2)
    rank, n = E.shape[-2:]
    if not rank:
        empty = np.zeros((*E.shape[:-2], 0))
        return Facets(np.zeros((*empty.shape, 0)), empty, empty)
    # The rows are orthonormal, so that the scale of ranks is one. Wrongly independent columns do
    # no harm: any (d, y) gives a half-space that contains the set.
    spanned = np.moveaxis(E[..., _choices(n, rank - 1)], -2, -3)
    svd = ranked_svd(spanned, 1.0, P.tolerance, full=True)
    w = svd.U[..., -1]
    w = np.concatenate([w, -w], axis=-2)
    proper = np.concatenate([svd.rank, svd.rank], axis=-1) == rank - 1
    lower, upper = P.lower[..., None, :], P.upper[..., None, :]
    c = w @ E
    distance = np.where(proper, farthest(c, lower, upper, P.tolerance), np.inf)
    most = np.maximum(*(np.where(np.isinf(limit), 0.0, np.abs(limit)) for limit in (lower, upper)))
    bounds = np.linalg.norm(w[..., :k], axis=-1, keepdims=True) > P.tolerance
    return Facets(np.where(bounds, w[..., :k], 0.0), distance, (np.abs(c) * most).sum(axis=-1))


def ball(P: Polytope, r: int) -> Array:
    """Return the radius of the largest ball about v = 0 in polytopes with C of rank r, (...)."""
    m1 = P.offset.shape[-1]
    normal, distance, size = facets(P, m1, r)
    d = (normal / P.sigma[..., None, :m1]) @ transposed(P.U)
    shift = (d @ P.offset[..., None])[..., 0]
    slack, length = distance + shift, np.linalg.norm(d, axis=-1)
    # Round-off is neither slack nor, where d = 0, infeasibility.
    slack = np.where(np.abs(slack) <= RANK_TOLERANCE * (size + np.abs(shift)), 0.0, slack)
    radius = np.divide(slack, length, out=np.where(slack < 0.0, 0.0, np.inf), where=length > 0.0)
    return np.maximum(radius.min(axis=-1, initial=np.inf), 0.0)


def dual_vertices(P: Polytope, k: int, r: int) -> Array:
    """Return every G - Y C that vanishes on r columns, for ranks k and r, shape (K, m1, n).

    h(d) = min over these of sum_i max(lower_i c_i, upper_i c_i), c = d @ (G - Y C): the minimum of
    a convex, piecewise linear function of y is at one of its vertices.
    """
    C = P.rows[:r]
    G = (P.U[:, :k] * P.sigma[:k]) @ P.Vt[:k]
    chosen = _choices(C.shape[1], r)
    svd = ranked_svd(np.moveaxis(C[:, chosen], 1, 0), 1.0, P.tolerance)
    proper = svd.rank == r
    chosen, inverse = chosen[proper], svd.pseudo_inverse()[proper]
    duals = G - np.moveaxis(G[:, chosen], 1, 0) @ inverse @ C
    np.put_along_axis(duals, chosen[:, None, :], 0.0, axis=-1)
    return duals


def farthest(c: Array, lower: Array, upper: Array, zero: Array | float) -> Array:
    """Return the largest c @ x within the limits, shape (...), infinite where x is unbounded.

    Coefficients up to `zero` are treated as zero if their variable is unbounded.
    """
    endless = np.isinf(lower) | np.isinf(upper)
    c = np.where(endless & (np.abs(c) <= zero), 0.0, c)
    return (np.where(c == 0.0, 0.0, np.where(c > 0.0, upper, lower)) * c).sum(axis=-1)


def _choices(n: int, k: int) -> Indices:
    """Return all sets of k of n indices, shape (., k)."""
    listed = itertools.combinations(range(n), k)
    return np.array(list(listed), dtype=np.intp).reshape(comb(n, k), k)
