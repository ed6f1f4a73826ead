"""What the rates of [alpha, beta, gamma, t_x, t_y, t_z] in eq. (38) can be taken to be."""

import numpy as np
from scipy.spatial.transform import Rotation

from experiments.jacobian.variation import Reading, twist_in_base_axes
from sim import Array, Pose


def twist_in_payload_axes(pose: Pose, J: Array) -> Array:
    """[omega; v] of the payload origin along the payload's own axes."""
    to_payload = pose.rotation.swapaxes(-1, -2)
    return np.concatenate([to_payload @ J[..., :3, :], to_payload @ J[..., 3:, :]], axis=-2)


def euler_rates(sequence: str) -> Reading:
    """Rates of three angles about x, y and z, taken one after the other; v in base axes.

    Args:
        sequence: "XYZ" for R = R_x R_y R_z, "ZYX" for R = R_z R_y R_x.
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
"""The ways to read (38) itself."""
