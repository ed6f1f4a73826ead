"""A rigorous upper bound on how much the Jacobian varies over the box of strut lengths.

The argument is written out in docs/jacobian.md. In short, for every l in the box |l_k| <= s,

    J(l) - J(0) = T1[l] + T2[l, l] + T3[l, l, l] + R(l).

A norm of a linear map is convex, so each T is largest at vertices of the box, all combinations of
which are tried; R is at most the largest fourth Taylor coefficient anywhere in the box, which
triangle inequalities bound.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np

from experiments.jacobian.norms import Norm, size
from experiments.jacobian.rays import jacobian_forms
from sim import NOMINAL, Array, Hexapod

ORDER = 3
"""Of the last Taylor coefficient that is bounded at the vertices."""
ROUNDING = 1e-9
"""Relative allowance for floating-point arithmetic."""

_VERTICES = np.array([(1.0, *rest) for rest in product((1.0, -1.0), repeat=5)])
"""Half of the box's; the others are their negatives, with the same norms."""


@dataclass(frozen=True)
class Certificate:
    """sup ||J - J_0|| over the box is at most the sum of what each Taylor term can be.

    Attributes:
        terms: Largest norm of the linear, quadratic and cubic term.
        remainder: Bound on all that is left; infinite where the argument does not hold.
    """

    terms: tuple[float, ...]
    remainder: float

    @property
    def upper_bound(self) -> float:
        """On sup ||J - J_0||, rounding allowed for."""
        return (sum(self.terms) + self.remainder) * (1 + ROUNDING)


def certify(geometry: Hexapod, stroke_m: float, norm: Norm) -> Certificate:
    """Bound ||J - J_0|| over all strut displacements of at most the stroke.

    Args:
        geometry: The hexapod; J is the twist of its payload origin, base axes, per strut rate.
        stroke_m: Half the side of the box.
        norm: Of the matrices.
    """
    forms = jacobian_forms(geometry, stroke_m, ORDER)
    return Certificate(
        terms=tuple(_largest(form, norm) for form in forms[1:]),
        remainder=_remainder(geometry, stroke_m, norm),
    )


def _largest(form: Array, norm: Norm) -> float:
    """Largest norm of a multilinear form (6,) * k + (6, 6) on vertices, each argument its own."""
    for _ in range(form.ndim - 2):
        form = np.tensordot(form, _VERTICES, axes=(0, 1))
    matrices = np.moveaxis(form.reshape(6, 6, -1), -1, 0)
    return float(size(matrices, norm).max())


def _remainder(geometry: Hexapod, stroke_m: float, norm: Norm) -> float:
    """Largest norm that the next Taylor coefficient of J can have anywhere in the box.

    A characteristic length weighs turns against displacements in the estimates; each is valid, and
    the best is taken.
    """
    lengths_m = geometry.nominal_length_m.mean() * np.geomspace(0.1, 2.0, 40)
    return min(_remainder_with(geometry, stroke_m, norm, float(c)) for c in lengths_m)


def _remainder_with(geometry: Hexapod, stroke_m: float, norm: Norm, length_m: float) -> float:
    scale = np.array([length_m] * 3 + [1.0] * 3)
    J_0 = np.linalg.inv(geometry.inverse_jacobian(NOMINAL))
    nominal = float(np.linalg.norm(scale[:, None] * J_0, 2))
    for growth in np.linspace(1.005, 1.5, 100):
        bounds = _coefficient_bounds(geometry, stroke_m, length_m, growth * nominal)
        # On the way out the norm cannot pass `growth` if it cannot get there: see the docs.
        if nominal + bounds[1] < growth * nominal:
            # ||D^-1 M|| is at most ||D^-1|| in the same norm times ||M||_2.
            return bounds[-1] * float(size(np.diag(1 / scale), norm))
    return np.inf


def _coefficient_bounds(
    geometry: Hexapod, stroke_m: float, length_m: float, largest_J: float
) -> list[float]:
    """Bounds on the 2-norms of J's Taylor coefficients at any point of any ray in the box.

    The recursion of :func:`experiments.jacobian.rays.jacobian_series` with norms for vectors.
    Turns are measured at `length_m`, where J itself is at most `largest_J`.
    """
    L = geometry.nominal_length_m
    over_length = [(stroke_m / (L.min() - stroke_m)) ** k / (L.min() - stroke_m) for k in range(5)]
    displacement = np.sqrt(6) * stroke_m
    arm = [float(np.linalg.norm(geometry.top_m, axis=1).max())]
    strut = [float(L.max()) + stroke_m]
    to_bottom = float(np.linalg.norm(geometry.bottom_m, axis=1).max())
    from_bottom = [to_bottom + largest_J * displacement]
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
    return J
