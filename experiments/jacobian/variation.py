"""Eq. (40): how far the Jacobian gets from the nominal one, and at which strut lengths."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.optimize import differential_evolution

from experiments.jacobian.norms import Norm, size
from sim import Array, Hexapod, Pose, forward_kinematics

Reading = Callable[[Pose, Array], Array]
"""What (38) is taken to say: from poses (...) and base-axes twists J (..., 6, 6) to matrices."""

VERTICES = np.array(list(product((-1.0, 1.0), repeat=6)))
"""Of the box of strut lengths, in strokes."""


@dataclass(frozen=True)
class Variation:
    """e of eq. (40).

    Attributes:
        value: sup ||J - J_0|| / ||J_0||, the largest found.
        at_strut_m: Strut displacements where it is attained, shape (6,).
    """

    value: float
    at_strut_m: Array


def twist_in_base_axes(_pose: Pose, J: Array) -> Array:
    """J as it is: the twist [omega; v] of the payload origin per strut rate."""
    return J


def jacobian(geometry: Hexapod, displacements_m: Array, reading: Reading) -> Array:
    """J at strut displacements (..., 6), as the reading takes it."""
    pose = forward_kinematics(geometry, displacements_m)
    return reading(pose, np.linalg.inv(geometry.inverse_jacobian(pose)))


def relative_change(
    geometry: Hexapod, displacements_m: Array, norm: Norm, reading: Reading = twist_in_base_axes
) -> Array:
    """||J - J_0|| / ||J_0|| at strut displacements (..., 6), shape (...)."""
    J_0 = jacobian(geometry, np.zeros(6), reading)
    change = jacobian(geometry, displacements_m, reading) - J_0
    return size(change, norm) / size(J_0, norm)


def variation(
    geometry: Hexapod,
    stroke_m: float,
    norm: Norm,
    reading: Reading = twist_in_base_axes,
    seed: int = 0,
) -> Variation:
    """Eq. (40) over all strut displacements of at most the stroke, by global search.

    Differential evolution (Storn and Price 1997) that starts from the 64 vertices: J is so nearly
    linear in the strut lengths, and a norm so convex, that one of them is all but the answer. It
    ends with a local search from the best.
    """

    def found(struts: Array) -> Array:
        return -relative_change(geometry, stroke_m * struts.T, norm, reading)

    best = differential_evolution(
        found,
        bounds=[(-1.0, 1.0)] * 6,
        init=VERTICES,
        maxiter=60,
        vectorized=True,
        updating="deferred",
        rng=seed,
    )
    return Variation(value=-float(best.fun), at_strut_m=stroke_m * best.x)
