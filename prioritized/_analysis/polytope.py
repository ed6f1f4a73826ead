"""Image {G x : C x = 0, lower <= x <= upper} in minimal coordinates, with decided ranks."""

from typing import NamedTuple

import numpy as np

from argument_checks import Array, Indices, Mask
from prioritized._solver.rank import ranked_svd


class Polytope(NamedTuple):
    """Polytope {offset + U sigma V^T x : rows x = 0, lower <= x <= upper}.

    The matrices have the decided ranks k = `rank` and r = `constraints`; rows and columns beyond
    these must not be used. Coordinates with equal limits have zero columns.

    Attributes:
        offset: Contribution of the fixed coordinates and of those determined by them, shape (...,
            m1).
        U: Orthonormal columns, shape (..., m1, .).
        sigma: Shape (..., .).
        Vt: Orthonormal rows, orthogonal to `rows`, shape (..., ., n).
        rows: Orthonormal rows, shape (..., ., n).
        rank: Shape (...).
        constraints: Shape (...).
        lower: Shape (..., n); zero, as is `upper`, where limits are equal.
        upper: Shape (..., n).
        consistent: Whether fixed coordinates can satisfy C x = 0, shape (...).
        tolerance: Tolerance of the rank decisions.
    """

    offset: Array
    U: Array
    sigma: Array
    Vt: Array
    rows: Array
    rank: Indices
    constraints: Indices
    lower: Array
    upper: Array
    consistent: Mask
    tolerance: float

    def part(self, which: Indices) -> "Polytope":
        """Return the polytopes that an index or mask selects from a batch with one axis."""
        return self._make([*(A[which] for A in self[:-1]), self.tolerance])


def polytope(
    G: Array, C: Array, lower: Array, upper: Array, scale: Array | float, tolerance: float
) -> Polytope:
    """Return the polytope of {G x : C x = 0, lower <= x <= upper}.

    G is (..., m1, n); C has orthonormal rows, or is a projector on them, (..., r, n); limits are
    (..., n) and may be infinite. `scale` (...) is the size of the matrices that G was computed
    from, against which its rank is decided.
    """
    fixed = lower == upper
    moving = np.where(fixed, 0.0, 1.0)[..., None, :]
    x = np.where(fixed, lower, 0.0)
    closure = ranked_svd(C * moving, 1.0, tolerance)
    opened = C @ x[..., None]
    follow = -closure.pseudo_inverse() @ opened
    left_open = np.abs(opened + C * moving @ follow).max(axis=(-2, -1), initial=0.0)
    consistent = left_open <= tolerance * np.abs(x).max(axis=-1, initial=0.0)
    x = x + follow[..., 0]
    image = ranked_svd(G * moving @ closure.null_projector(), scale, tolerance)
    return Polytope(
        offset=(G @ x[..., None])[..., 0],
        U=image.U,
        sigma=image.sigma,
        Vt=image.Vt,
        rows=closure.Vt,
        rank=image.rank,
        constraints=closure.rank,
        lower=np.where(fixed, 0.0, lower - x),
        upper=np.where(fixed, 0.0, upper - x),
        consistent=consistent,
        tolerance=tolerance,
    )
