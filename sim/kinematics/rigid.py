"""Rigid motions as arrays: homogeneous matrices, quaternions, adjoints."""

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

import argument_checks as check
from sim.array import Array

_ROTATION_ERROR = 1e-6


def rigid_motion(name: str, T: ArrayLike) -> tuple[Array, Array]:
    """Rotations (..., 3, 3) and translations (..., 3) of homogeneous matrices (..., 4, 4).

    Raises:
        ValueError: Another shape, numbers that are not finite, a last row that is not 0 0 0 1, or
            no rotation; it names the argument.
    """
    A = check.shaped(name, check.real(name, T), 4, 4)
    if (np.abs(A[..., 3, :] - [0.0, 0.0, 0.0, 1.0]) > _ROTATION_ERROR).any():
        raise ValueError(f"{name} must have the last row 0 0 0 1, got {check.shown(A.tolist())}")
    return checked_rotation(name, A[..., :3, :3]), A[..., :3, 3]


def rotation_of(name: str, quat_wxyz: ArrayLike) -> Array:
    """Rotation matrices (..., 3, 3) of quaternions (..., 4) of any length but zero.

    Raises:
        ValueError: Another shape, numbers that are not finite, or zeros; it names the argument.
    """
    quat = check.vector(name, quat_wxyz, 4)
    largest = np.abs(quat).max(axis=-1, keepdims=True)
    if not largest.all():
        raise ValueError(f"{name} must not be zero, got {check.shown(quat.tolist())}")
    unit = (quat / largest).reshape(-1, 4)  # else the squares of small numbers vanish
    rotation = Rotation.from_quat(unit, scalar_first=True).as_matrix()
    return rotation.reshape(*quat.shape[:-1], 3, 3)


def checked_rotation(name: str, R: Array) -> Array:
    """Matrices (..., 3, 3), each of which is that of a rotation.

    Raises:
        ValueError: One is not orthogonal, or a reflection; it names the argument.
    """
    error = np.abs(R @ R.swapaxes(-1, -2) - np.eye(3)).max(initial=0.0)
    if error > _ROTATION_ERROR or (np.linalg.det(R) < 0.0).any():
        raise ValueError(f"{name} must be a rotation matrix, got {check.shown(R.tolist())}")
    return R


def homogeneous(R: Array, t: Array, lead: tuple[int, ...]) -> Array:
    """Matrices (..., 4, 4) of rotations and translations, broadcast to these batch axes."""
    T = np.zeros((*lead, 4, 4))
    T[..., :3, :3], T[..., :3, 3], T[..., 3, 3] = R, t, 1.0
    return T


def adjoint(R: Array, t: Array, lead: tuple[int, ...]) -> Array:
    """Matrices (..., 6, 6) that take twists [angular; linear] from inner axes to outer ones."""
    Ad = np.zeros((*lead, 6, 6))
    Ad[..., :3, :3] = Ad[..., 3:, 3:] = R
    Ad[..., 3:, :3] = np.cross(t[..., None, :], R.swapaxes(-1, -2)).swapaxes(-1, -2)
    return Ad
