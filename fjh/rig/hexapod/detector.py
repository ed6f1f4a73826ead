"""Position-sensitive detector behind the telescope."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

import argument_checks as check
from kernels import lib, pointer
from sim import Array
from sim.mjcf import one_half_turn


def pointing_angles(rotation: Array) -> Array:
    """Return angles (alpha, beta) of the payload's z axis about x_b and y_b, (..., 2), [rad].

    Args:
        rotation: Payload axes in base axes, shape (..., 3, 3).
    """
    rotation = check.array("rotation", rotation, ..., 3, 3)
    x, y, z = np.moveaxis(rotation[..., 2], -1, 0)
    return np.stack([np.arctan2(-y, z), np.arctan2(x, z)], axis=-1)


def secondary_motion(rotation: Array, translation_m: Array) -> Array:
    """Return the motion that the detector does not measure: [gamma, t_x, t_y, t_z], (..., 4).

    Args:
        rotation: Payload axes in base axes, shape (..., 3, 3).
        translation_m: Payload origin in base axes, shape (..., 3).

    Raises:
        ValueError: A shape is wrong, a number is not finite, or `rotation` is no rotation.
    """
    rotation = check.array("rotation", rotation, ..., 3, 3)
    translation_m = check.array("translation_m", translation_m, ..., 3)
    if rotation.shape[:-2] != translation_m.shape[:-1]:
        raise ValueError(
            f"translation_m must have the batch axes of rotation, {rotation.shape[:-2]}, "
            f"got shape {translation_m.shape}"
        )
    off = rotation @ rotation.swapaxes(-1, -2) - np.eye(3)
    if not (np.abs(off).max(initial=0.0) < 1e-6 and (np.linalg.det(rotation) > 0).all()):
        raise ValueError("rotation must hold right-handed orthonormal axes, got others")
    gamma = one_half_turn(Rotation.from_matrix(rotation).as_rotvec())[..., 2:]
    return np.concatenate([gamma, translation_m], axis=-1)


@dataclass(frozen=True)
class Detector:
    """Detector on the payload that measures a laser spot from the base (section 4.1).

    Attributes:
        focal_length_m: Effective focal length of the telescope.
        half_width_m: Half the detector's side; the spot saturates there.
        noise_m: Standard deviation of the spot position, each axis, each sample.

    Raises:
        ValueError: A length is not positive, or the noise is negative.
    """

    focal_length_m: float
    half_width_m: float
    noise_m: float

    def __post_init__(self) -> None:
        check.number("focal_length_m", self.focal_length_m, check.SMALLEST)
        check.number("half_width_m", self.half_width_m, check.SMALLEST)
        check.number("noise_m", self.noise_m, 0.0)

    def read(self, rotation: Array, rng: np.random.Generator) -> Array:
        """Return the measured (alpha, beta), shape (2,), [rad], by small-angle optics.

        Args:
            rotation: Payload axes in base axes, shape (3, 3).
            rng: Source of the noise; two normal numbers are sampled.
        """
        rotation = check.array("rotation", rotation, 3, 3)
        check.instance("rng", rng, np.random.Generator)
        # The beam, along z_b, in payload axes is the third row.
        if rotation.item(8) == 0.0:
            raise ValueError("rotation must not put the payload at right angles to the beam")
        optics, angles = (self.focal_length_m, self.half_width_m, self.noise_m), np.empty(2)
        seen, noise = pointer(np.ascontiguousarray(rotation)), pointer(rng.standard_normal(2))
        lib.spot(seen, *optics, noise, pointer(angles))
        return angles
