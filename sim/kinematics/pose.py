"""Poses of frames: representation, conversion and differences."""

import math
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform, Rotation

import argument_checks as check
from kernels import lib, pointer
from sim.array import Array
from sim.mjcf.frame import one_half_turn

_CLEARLY_LESS_RAD = 3.14
"""Rotation angle [rad] clearly below half a turn."""
_ROTATION_ERROR = 1e-6
"""Tolerance of the entries of rotation and homogeneous matrices."""


@dataclass(frozen=True)
class Pose:
    """Rotation (..., 3, 3) and translation [m] (..., 3) of one frame or a batch of frames.

    A plant's payload pose is relative to nominal, in base axes; :func:`pose_of` uses its `axes`.
    """

    rotation: Array
    translation_m: Array

    def __post_init__(self) -> None:
        """Check the arguments and store read-only copies."""
        check.freeze_field(self, "rotation", 3, 3)
        check.freeze_field(self, "translation_m", 3)
        _ = self.lead  # raises if the batch axes do not broadcast

    @classmethod
    def from_matrix(cls, T: ArrayLike) -> "Pose":
        """Create a pose from homogeneous matrices (..., 4, 4)."""
        return _of_matrix("T", T)

    def moved(self, twist: Array) -> "Pose":
        """Return the pose after a displacement [rotation vector; translation] (..., 6)."""
        twist, lead = check.array("twist", twist, ..., 6), self.lead
        if twist.ndim > 1:
            lead = check.common_axes({"the pose": lead, "twist": twist.shape[:-1]})
        rotation, translation_m = np.empty((*lead, 3, 3)), np.empty((*lead, 3))
        given = *self._flat(lead), check.flat(twist, 1, lead), rotation, translation_m
        lib.move(math.prod(lead), *map(pointer, given))
        rotation, translation_m = check.read_only(rotation), check.read_only(translation_m)
        return check.unchecked_record(Pose, rotation=rotation, translation_m=translation_m)

    def displacement(self) -> Array:
        """Return the displacement [rotation vector; translation], shape (..., 6)."""
        computed = vars(self).get("_displacement")  # of a pose that compiled code has read
        if computed is not None:
            return computed.copy()
        lead = self.lead
        given = *self._flat(lead), (displacement := np.empty((*lead, 6)))
        principal(lib.displacements(math.prod(lead), *map(pointer, given)), displacement)
        return displacement

    def matrix(self) -> Array:
        """Return the homogeneous matrices, shape (..., 4, 4)."""
        T = np.zeros((*self.lead, 4, 4))
        T[..., :3, :3], T[..., :3, 3], T[..., 3, 3] = self.rotation, self.translation_m, 1.0
        return T

    def transform(self) -> RigidTransform:
        """Return the pose as a scipy `RigidTransform`, for products, inverses and logarithms.

        Before scipy 1.17 at most one batch axis is allowed.
        """
        return RigidTransform.from_matrix(self.matrix())

    @property
    def lead(self) -> tuple[int, ...]:
        """Batch axes of rotation and translation together."""
        axes, others = self.rotation.shape[:-2], self.translation_m.shape[:-1]
        if axes == others:
            return axes
        return check.common_axes({"rotation": axes, "translation_m": others})

    def _flat(self, lead: tuple[int, ...]) -> tuple[Array, Array]:
        """Return rotations and translations, broadcast to batch axes and flattened to one."""
        return check.flat(self.rotation, 2, lead), check.flat(self.translation_m, 1, lead)


NOMINAL = Pose(np.eye(3), np.zeros(3))

Target: TypeAlias = Pose | RigidTransform | tuple[ArrayLike, ArrayLike] | ArrayLike
"""Types that describe a target pose, or a position alone."""


def target_pose(name: str, target: Target) -> Pose | Array:
    """Convert a target to a :class:`Pose`, or to a position (3,) if it has no rotation.

    A target is a pose; a homogeneous matrix (4, 4); a pair of a position (3,) and a quaternion
    (w, x, y, z); a `RigidTransform`; or a position (3,).
    """
    if isinstance(target, Pose):
        R = check.array(f"{name}.rotation", target.rotation, 3, 3)
        check.array(f"{name}.translation_m", target.translation_m, 3)
        _check_rotations(f"{name}.rotation", R)
        return target
    if isinstance(target, list | tuple) and len(target) == 2:
        quat_wxyz = check.array(f"the quaternion of {name}", target[1], 4)
        position_m = check.array(f"the position of {name}", target[0], 3)
        if not (largest := np.abs(quat_wxyz).max()):
            got = check.short_repr(quat_wxyz.tolist())
            raise ValueError(f"the quaternion of {name} must not be zero, got {got}")
        unit = quat_wxyz / largest  # otherwise squares of small numbers underflow
        return Pose(Rotation.from_quat(unit, scalar_first=True).as_matrix(), position_m)
    given: Any = target  # scipy has no type stubs
    matrix = given.as_matrix() if isinstance(given, RigidTransform) else given
    A = check.array(name, matrix, copy=True)
    if A.ndim == 1:
        return check.frozen(check.array(name, A, 3))
    if A.shape != (4, 4):
        turn = ": a rotation R alone is Pose(R, position)" if A.shape == (3, 3) else ""
        raise ValueError(
            f"{name} must be a position (3,), a Pose, a matrix (4, 4), a pair of position and "
            f"quaternion or a RigidTransform, got shape {A.shape}{turn}"
        )
    return _of_matrix(name, A)


def pose_difference(rotation: Array, position_m: Array, to_rotation: Array, to_m: Array) -> Array:
    """Return [rotation vector; translation] (6,) from one pose to another, in common axes."""
    twist = np.empty(6)
    principal(lib.way(*map(pointer, (rotation, position_m, to_rotation, to_m, twist))), twist)
    return twist


def principal(largest_rad: float, twists: Array) -> None:
    """Make the rotation vectors of twists (..., 6) unique at half a turn, in place.

    `largest_rad` is their largest angle, as returned by compiled code.
    """
    if largest_rad > _CLEARLY_LESS_RAD:
        twists[..., :3] = one_half_turn(twists[..., :3])


def _of_matrix(name: str, T: ArrayLike) -> Pose:
    A = check.array(name, check.array(name, T, copy=True), ..., 4, 4)
    if (np.abs(A[..., 3, :] - [0.0, 0.0, 0.0, 1.0]) > _ROTATION_ERROR).any():
        raise ValueError(
            f"{name} must have the last row 0 0 0 1, got {check.short_repr(A.tolist())}"
        )
    _check_rotations(name, A[..., :3, :3])
    return Pose(A[..., :3, :3], A[..., :3, 3])


def _check_rotations(name: str, R: Array) -> None:
    """Check that all matrices (..., 3, 3) are rotations."""
    error = np.abs(R @ R.swapaxes(-1, -2) - np.eye(3)).max(initial=0.0)
    if error > _ROTATION_ERROR or (np.linalg.det(R) < 0.0).any():
        raise ValueError(f"{name} must be a rotation matrix, got {check.short_repr(R.tolist())}")
