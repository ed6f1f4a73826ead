"""The Jacobian along rays of strut lengths, as a power series.

On the ray l = t d the lengths are L + t d, and the payload moves with the twist [omega; v] = J d:

    R' = omega x R,    x' = v,    J = A^-1,
    A = [p x u, u],    p = R a,    u = (x + p - b) / (L + t d)

Everything on the right is a product of what is known before, so that the Taylor coefficients follow
one from another. The k-th coefficient of J is a homogeneous polynomial of degree k in d.
"""

from collections.abc import Callable
from itertools import product
from math import factorial, prod
from typing import NamedTuple

import numpy as np

from sim import NOMINAL, Array, Hexapod


class Series(NamedTuple):
    """Taylor coefficients in t of what moves along a ray.

    Attributes:
        arm: p, shapes (..., 6, 3).
        from_bottom: x - b, shapes (..., 6, 3).
        over_length: 1 / (L + t d), shapes (..., 6, 1).
        A: Inverse Jacobian, shapes (..., 6, 6).
        J: Jacobian, shapes (..., 6, 6).
    """

    arm: list[Array]
    from_bottom: list[Array]
    over_length: list[Array]
    A: list[Array]
    J: list[Array]


def jacobian_series(geometry: Hexapod, direction_m: Array, order: int) -> Series:
    """Taylor coefficients of J(t d), and of what it is made of, about t = 0.

    Args:
        geometry: The hexapod.
        direction_m: d, shape (..., 6).
        order: Of the last coefficient.
    """
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
    """The coefficients as symmetric multilinear forms, on struts in units of the stroke.

    Polarization: T(d1, ..., dk) = sum over signs of e1 ... ek P(e1 d1 + ... + ek dk) / (2^k k!).

    Returns:
        For k = 0 to `order` the form T_k, shape (6,) * k + (6, 6): the k-th coefficient along a
        ray d = stroke s is T_k contracted k times with s.
    """
    forms = [np.linalg.inv(geometry.inverse_jacobian(NOMINAL))]
    strokes = stroke_m * np.eye(6)
    for k in range(1, order + 1):
        chosen = np.indices((6,) * k).reshape(k, -1)
        total = np.zeros((6**k, 6, 6))
        for signs in product((-1.0, 1.0), repeat=k):
            parts = [e * strokes[axis] for e, axis in zip(signs, chosen, strict=True)]
            direction = np.sum(parts, axis=0)
            total += prod(signs) * jacobian_series(geometry, direction, k).J[k]
        forms.append(total.reshape((6,) * k + (6, 6)) / (2**k * factorial(k)))
    return forms


def _coefficient(
    k: int, left: list[Array], right: list[Array], times: Callable[[Array, Array], Array]
) -> Array:
    """The k-th coefficient of the product of two series: Cauchy's."""
    return np.sum([times(left[m], right[k - m]) for m in range(k + 1)], axis=0)
