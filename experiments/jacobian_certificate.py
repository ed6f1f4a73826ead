"""Rigorous upper bound on the variation of the Jacobian over the box of strut lengths.

The proof is in docs/jacobian.md. In short, for every l in the box |l_k| <= s,

    J(l) - J(0) = T1[l] + T2[l, l] + T3[l, l, l] + R(l).

A norm of a linear map is convex, so that the norm of each T is largest at a combination of vertices
of the box; all combinations are evaluated. R is at most the largest fourth Taylor coefficient in
the box, which triangle inequalities bound.

The coefficients come from a power series. On the ray l = t d the lengths are L + t d, and the
payload moves with the twist [omega; v] = J d:

    R' = omega x R,    x' = v,    J = A^-1,
    A = [p x u, u],    p = R a,    u = (x + p - b) / (L + t d)

The right sides are products of known series, so that the Taylor coefficients follow recursively.
The k-th coefficient of J is a homogeneous polynomial of degree k in d.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from math import factorial, prod
from typing import Generic, Literal, NamedTuple, TypeVar, get_args

import numpy as np

from fjh.rig.hexapod.closed_form import Hexapod
from sim import NOMINAL, Array

ORDER = 3
"""Order of the last Taylor coefficient that is bounded at the vertices."""
ROUNDING = 1e-9
"""Relative allowance for floating-point arithmetic."""

Norm = Literal["frobenius", "two"]
NORMS: tuple[Norm, ...] = get_args(Norm)

_VERTICES = np.array([(1.0, *signs) for signs in product((1.0, -1.0), repeat=5)])
"""Half of the vertices of the box; the negatives of these vertices have the same norms."""

Kind = TypeVar("Kind", Array, float)


def size(matrices: Array, norm: Norm) -> Array:
    """Return the norms of matrices (..., p, q), shape (...)."""
    return np.linalg.norm(matrices, "fro" if norm == "frobenius" else 2, axis=(-2, -1))


class Series(NamedTuple, Generic[Kind]):
    """Taylor coefficients in t along a ray, from order 0 on, or bounds on their norms."""

    arm: list[Kind]  # p, (..., 6, 3)
    from_bottom: list[Kind]  # x - b, (..., 6, 3)
    over_length: list[Kind]  # 1 / (L + t d), (..., 6, 1)
    A: list[Kind]  # inverse Jacobian, (..., 6, 6)
    J: list[Kind]


def jacobian_series(geometry: Hexapod, direction_m: Array, order: int) -> Series[Array]:
    """Compute the Taylor coefficients of J(t d) and its factors about t = 0, for d (..., 6)."""
    L, J_0 = geometry.nominal_length_m, np.linalg.inv(geometry.inverse_jacobian(NOMINAL))
    over_length = [(-direction_m / L)[..., None] ** k / L[:, None] for k in range(order + 1)]
    arm, from_bottom = [geometry.top_m], [-geometry.bottom_m]
    rows: list[Array] = []
    A: list[Array] = []
    J: list[Array] = []
    turning: list[Array] = []
    for k in range(order + 1):
        moment = _coefficient(k, arm, from_bottom, np.cross)  # p x (x + p - b) = p x (x - b)
        rows.append(np.concatenate([moment, arm[k] + from_bottom[k]], axis=-1))
        A.append(_coefficient(k, rows, over_length, np.multiply))
        J.append(J_0 if k == 0 else -J_0 @ _coefficient(k - 1, A[1:], J, np.matmul))
        twist = (J[k] @ direction_m[..., None])[..., None, :, 0]
        turning.append(twist[..., :3])
        arm.append(_coefficient(k, turning, arm, np.cross) / (k + 1))
        from_bottom.append(twist[..., 3:] / (k + 1))
    return Series(arm, from_bottom, over_length, A, J)


def jacobian_forms(geometry: Hexapod, stroke_m: float, order: int) -> list[Array]:
    """Return the coefficients as symmetric multilinear forms of displacements in strokes.

    Polarization: T(d1, ..., dk) = sum over signs of e1 ... ek P(e1 d1 + ... + ek dk) / (2^k k!).

    Returns:
        For k = 0 to `order` the form T_k, shape (6,) * k + (6, 6): the k-th coefficient along a
        ray d = stroke s is T_k contracted k times with s.
    """
    forms = [np.linalg.inv(geometry.inverse_jacobian(NOMINAL))]
    strokes = stroke_m * np.eye(6)
    for k in range(1, order + 1):
        axes = np.indices((6,) * k).reshape(k, -1)
        total = np.zeros((6**k, 6, 6))
        for signs in product((-1.0, 1.0), repeat=k):
            parts = [e * strokes[axis] for e, axis in zip(signs, axes, strict=True)]
            direction = np.sum(parts, axis=0)
            total += prod(signs) * jacobian_series(geometry, direction, k).J[k]
        forms.append(total.reshape((6,) * k + (6, 6)) / (2**k * factorial(k)))
    return forms


def _coefficient(
    k: int, left: list[Array], right: list[Array], times: Callable[[Array, Array], Array]
) -> Array:
    """Return the k-th coefficient of the Cauchy product of two series."""
    return np.sum([times(left[m], right[k - m]) for m in range(k + 1)], axis=0)


@dataclass(frozen=True)
class Certificate:
    """Upper bound on ||J - J_0|| over the box, as a sum of bounds on Taylor terms."""

    terms: tuple[float, ...]
    """Largest norm of the linear, quadratic and cubic term."""
    remainder: float
    """Bound on the remainder; infinite if the proof does not apply."""

    @property
    def upper_bound(self) -> float:
        """Upper bound on sup ||J - J_0||, including the rounding allowance."""
        return (sum(self.terms) + self.remainder) * (1 + ROUNDING)


def certify(geometry: Hexapod, stroke_m: float, norm: Norm) -> Certificate:
    """Bound ||J - J_0|| over all strut displacements of at most the stroke.

    The rounding allowance holds for condition numbers up to 1e6.

    Args:
        geometry: Hexapod; J is the twist of its payload origin, base axes, per strut rate.
        stroke_m: Half the side of the box.
        norm: Norm of the matrices.

    Raises:
        ValueError: The stroke is negative or not finite.
    """
    if not 0 <= stroke_m < np.inf:
        raise ValueError(f"stroke_m must be finite and not negative, got {stroke_m}")
    forms = jacobian_forms(geometry, stroke_m, ORDER)
    return Certificate(
        terms=tuple(largest_at_vertices(form, norm) for form in forms[1:]),
        remainder=_remainder(geometry, stroke_m, norm),
    )


def largest_at_vertices(form: Array, norm: Norm) -> float:
    """Return the largest norm of a multilinear form (6,) * k + (6, 6) over tuples of vertices."""
    for _ in range(form.ndim - 2):
        form = np.tensordot(form, _VERTICES, axes=(0, 1))
    matrices = np.moveaxis(form.reshape(6, 6, -1), -1, 0)
    return float(size(matrices, norm).max())


def _remainder(geometry: Hexapod, stroke_m: float, norm: Norm) -> float:
    """Bound the norm of the next Taylor coefficient of J over the box.

    The bound depends on a characteristic length that weights rotations against displacements; it
    is valid for any length, and the smallest is returned.
    """
    if not stroke_m < geometry.nominal_length_m.min():
        return np.inf  # a strut would have zero length
    lengths_m = geometry.nominal_length_m.mean() * np.geomspace(0.1, 2.0, 40)
    return min(_remainder_with(geometry, stroke_m, norm, float(c)) for c in lengths_m)


def _remainder_with(geometry: Hexapod, stroke_m: float, norm: Norm, length_m: float) -> float:
    scale = np.array([length_m] * 3 + [1.0] * 3)
    J_0 = np.linalg.inv(geometry.inverse_jacobian(NOMINAL))
    nominal = float(np.linalg.norm(scale[:, None] * J_0, 2))
    for ratio in np.linspace(1.005, 1.5, 100):
        bounds = coefficient_bounds(geometry, stroke_m, length_m, ratio * nominal)
        # By continuity the norm stays below `ratio * nominal`: see docs/jacobian.md.
        if nominal + bounds.J[1] < ratio * nominal:
            return bounds.J[-1] * unscaled(length_m, norm)
    return np.inf


def unscaled(length_m: float, norm: Norm) -> float:
    """Return a bound on |M| / |D M|_2 with D = diag(c, c, c, 1, 1, 1) and the length c."""
    return float(size(np.diag([1 / length_m] * 3 + [1.0] * 3), norm))


def coefficient_bounds(
    geometry: Hexapod, stroke_m: float, length_m: float, largest_J: float
) -> Series[float]:
    """Return bounds on the coefficients of :func:`jacobian_series` at all points in the box.

    The recursion is that of the series, with lengths instead of vectors and 2-norms instead of the
    matrices A / D and D J, where D = diag(c, c, c, 1, 1, 1) weights rotations by c = `length_m`.
    The stroke, half the box, is less than the shortest strut; `largest_J` bounds ||D J||.
    """
    L, shortest = geometry.nominal_length_m, float(geometry.nominal_length_m.min()) - stroke_m
    over_length = [(stroke_m / shortest) ** k / shortest for k in range(ORDER + 2)]
    displacement = np.sqrt(6) * stroke_m
    arm = [float(np.linalg.norm(geometry.top_m, axis=1).max())]
    to_bottom = float(np.linalg.norm(geometry.bottom_m, axis=1).max())
    from_bottom = [to_bottom + largest_J * displacement]
    strut = [float(L.max()) + stroke_m]
    A, J, turning = [], [], []
    for k in range(ORDER + 2):
        moment = [sum(arm[i] * from_bottom[m - i] for i in range(m + 1)) for m in range(k + 1)]
        rows = [np.hypot(c / length_m, s) for c, s in zip(moment, strut, strict=True)]
        A.append(np.sqrt(6) * sum(rows[m] * over_length[k - m] for m in range(k + 1)))
        J.append(largest_J if k == 0 else largest_J * sum(A[m] * J[k - m] for m in range(1, k + 1)))
        turning.append(J[k] * displacement / length_m)
        arm.append(sum(turning[m] * arm[k - m] for m in range(k + 1)) / (k + 1))
        from_bottom.append(J[k] * displacement / (k + 1))
        strut.append(from_bottom[-1] + arm[-1])
    return Series(arm, from_bottom, over_length, A, J)
