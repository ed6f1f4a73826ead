"""Targets of a frame, in the forms in which users have them."""

from typing import Any, TypeAlias

from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform

import argument_checks as check
from sim.array import Array
from sim.kinematics.pose import Pose
from sim.kinematics.rigid import checked_rotation, rigid_motion, rotation_of

Target: TypeAlias = Pose | RigidTransform | tuple[ArrayLike, ArrayLike] | ArrayLike
"""A pose in any of its forms, or a position alone."""


def target_pose(name: str, target: Target) -> Pose | Array:
    """The one pose that a target is, or the position (3,) where it is no more.

    Args:
        name: Of the argument.
        target: A pose; a homogeneous matrix (4, 4); a pair of a position (3,) and a quaternion
            (w, x, y, z); a `RigidTransform`; or a position (3,).

    Raises:
        ValueError: Another shape, numbers that are not finite, a matrix that is no rigid motion,
            or a quaternion of zeros.
    """
    if isinstance(target, Pose):
        R = check.exactly(f"{name}.rotation", target.rotation, 3, 3)
        check.exactly(f"{name}.translation_m", target.translation_m, 3)
        checked_rotation(f"{name}.rotation", R)
        return target
    if isinstance(target, list | tuple) and len(target) == 2:
        position_m, quat_wxyz = target
        quat_wxyz = check.exactly(f"the quaternion of {name}", quat_wxyz, 4)
        position_m = check.exactly(f"the position of {name}", position_m, 3)
        return Pose(rotation_of(f"the quaternion of {name}", quat_wxyz), position_m)
    given: Any = target  # pyright knows no classes of scipy
    A = check.real(name, given.as_matrix() if isinstance(given, RigidTransform) else given)
    if A.ndim == 1:
        return check.frozen(check.exactly(name, A, 3))
    if A.shape != (4, 4):
        turn = ": a rotation R alone is Pose(R, position)" if A.shape == (3, 3) else ""
        raise ValueError(
            f"{name} must be a position (3,), a Pose, a matrix (4, 4), a pair of position and "
            f"quaternion or a RigidTransform, got shape {A.shape}{turn}"
        )
    return Pose(*rigid_motion(name, A))
