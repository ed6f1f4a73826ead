"""Eq. (40): how far the Jacobian gets from the nominal one, in which norm, and read in which way.

A reading is what the rates of [alpha, beta, gamma, t_x, t_y, t_z] in eq. (38) are taken to be.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from typing import Literal, get_args

import numpy as np
from scipy.optimize import differential_evolution
from scipy.spatial.transform import Rotation

from argument_checks.ties import exceeds, greatest
from sim import Array, Hexapod, Pose, forward_kinematics

Norm = Literal["frobenius", "two"]
NORMS: tuple[Norm, ...] = get_args(Norm)
ByNorm = dict[Norm, float]


def size(matrices: Array, norm: Norm) -> Array:
    """Norm of each of the matrices (..., p, q), shape (...)."""
    return np.linalg.norm(matrices, "fro" if norm == "frobenius" else 2, axis=(-2, -1))


Reading = Callable[[Pose, Array], Array]
"""From poses (...) and base-axes twists J (..., 6, 6) to the matrices that are compared."""

VERTICES = np.array(list(product((1.0, -1.0), repeat=6)))
"""Of the box of strut lengths, in strokes."""


def twist_in_base_axes(_pose: Pose, J: Array) -> Array:
    """J as it is: the twist [omega; v] of the payload origin per strut rate."""
    return J


def twist_in_payload_axes(pose: Pose, J: Array) -> Array:
    """[omega; v] of the payload origin along the payload's own axes."""
    to_payload = pose.rotation.swapaxes(-1, -2)
    return np.concatenate([to_payload @ J[..., :3, :], to_payload @ J[..., 3:, :]], axis=-2)


def euler_rates(sequence: str) -> Reading:
    """Rates of three angles about x, y and z, one rotation after the other; v in base axes.

    The sequence is "XYZ" for R = R_x R_y R_z, "ZYX" for R = R_z R_y R_x.
    """

    def reading(pose: Pose, J: Array) -> Array:
        flat = Rotation.from_matrix(pose.rotation.reshape(-1, 3, 3))
        angles = flat.as_euler(sequence)
        omega_per_rate = np.empty((len(angles), 3, 3))
        turned = Rotation.identity(len(angles))
        for letter, angle in zip(sequence, angles.T, strict=True):
            axis = np.eye(3)["XYZ".index(letter)]
            omega_per_rate[:, :, "XYZ".index(letter)] = turned.apply(axis)
            turned = turned * Rotation.from_rotvec(angle[:, None] * axis)
        omega_per_rate = omega_per_rate.reshape(pose.rotation.shape)
        rates = np.linalg.solve(omega_per_rate, J[..., :3, :])
        return np.concatenate([rates, J[..., 3:, :]], axis=-2)

    return reading


def inverse(_pose: Pose, J: Array) -> Array:
    """Strut rates per twist."""
    return np.linalg.inv(J)


def in_millimetres(_pose: Pose, J: Array) -> Array:
    """Turns in rad/mm, displacements in mm/mm."""
    return J * np.array([1e-3] * 3 + [1.0] * 3)[:, None]


def at_height(height_m: float) -> Reading:
    """The twist of the point of the payload that lies this far along z_b from its origin."""

    def reading(pose: Pose, J: Array) -> Array:
        arm = height_m * pose.rotation[..., :, 2]
        moved = J[..., 3:, :] + np.cross(J[..., :3, :], arm[..., :, None], axis=-2)
        return np.concatenate([J[..., :3, :], moved], axis=-2)

    return reading


READINGS: dict[str, Reading] = {
    "twist, base axes": twist_in_base_axes,
    "twist, payload axes": twist_in_payload_axes,
    "Euler rates, R = Rz Ry Rx": euler_rates("ZYX"),
    "Euler rates, R = Rx Ry Rz": euler_rates("XYZ"),
}
"""Readings of (38) itself."""


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


@dataclass(frozen=True)
class Variation:
    """Eq. (40): the largest ||J - J_0|| / ||J_0|| found, and strut displacements (6,) there."""

    value: float
    at_strut_m: Array


def variation(
    geometry: Hexapod,
    stroke_m: float,
    norm: Norm,
    reading: Reading = twist_in_base_axes,
    seed: int = 0,
) -> Variation:
    """Eq. (40) over all strut displacements of at most the stroke, by global search.

    Differential evolution (Storn and Price 1997) from the 64 vertices: J is nearly linear in the
    strut lengths and a norm is convex, so that the largest change is at a vertex or close to one.
    It ends with a local search from the best.
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
    # By the symmetry of the machine several vertices are equally far: of these the first.
    at_vertices = -found(VERTICES.T)
    first = greatest(at_vertices)
    if not exceeds(-best.fun, at_vertices[first]):
        return Variation(value=float(at_vertices[first]), at_strut_m=stroke_m * VERTICES[first])
    return Variation(value=-float(best.fun), at_strut_m=stroke_m * best.x)
