"""Poses of frames."""

import math
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform, Rotation

import argument_checks as check
from kernels import lib, pointer
from sim.array import Array
from sim.kinematics.rigid import adjoint, homogeneous, rigid_motion, rotation_of
from sim.mjcf.frame import one_half_turn

_Kind = TypeVar("_Kind")
_CLEARLY_LESS_RAD = 3.14
"""Than half a turn."""


@dataclass(frozen=True)
class Pose:
    """A rotation and a translation, or a batch of them.

    Of a plant's payload from its nominal pose, in base axes; of :func:`pose_of` in the axes given.

    Attributes:
        rotation: Shape (..., 3, 3).
        translation_m: Shape (..., 3).

    Raises:
        ValueError: Another shape, or numbers that are not finite.
    """

    rotation: Array
    translation_m: Array

    def __post_init__(self) -> None:
        """Check the arguments, and keep read-only copies."""
        check.keep(self, "rotation", 3, 3)
        check.keep(self, "translation_m", 3)
        _ = self.lead  # raises where there is none

    def moved(self, twist: Array) -> "Pose":
        """The pose after a displacement [rotation vector; translation] (..., 6), base axes.

        Raises:
            ValueError: Another shape, or numbers that are not finite.
        """
        twist = check.shaped("twist", twist, 6)
        lead = self.lead
        if twist.ndim > 1:
            lead = check.common_axes({"the pose": lead, "twist": twist.shape[:-1]})
        rotation, translation_m = np.empty((*lead, 3, 3)), np.empty((*lead, 3))
        lib.move(
            math.prod(lead),
            pointer(check.flat(self.rotation, 2, lead)),
            pointer(check.flat(self.translation_m, 1, lead)),
            pointer(check.flat(twist, 1, lead)),
            pointer(rotation),
            pointer(translation_m),
        )
        return check.computed(Pose, rotation=rotation, translation_m=translation_m)

    def displacement(self) -> Array:
        """[rotation vector; translation], shape (..., 6)."""
        known = vars(self).get("_displacement")  # of a pose that compiled code has read
        if known is not None:
            return known.copy()
        lead = self.lead
        rotation, translation_m = (
            check.flat(self.rotation, 2, lead),
            check.flat(self.translation_m, 1, lead),
        )
        displacement = np.empty((*lead, 6))
        given = map(pointer, (rotation, translation_m, displacement))
        principal(lib.displacements(math.prod(lead), *given), displacement)
        return displacement

    @classmethod
    def from_matrix(cls, T: ArrayLike) -> "Pose":
        """The pose of homogeneous matrices (..., 4, 4).

        Raises:
            ValueError: Another shape, a last row that is not 0 0 0 1, or no rotation matrix.
        """
        return cls(*rigid_motion("T", T))

    @classmethod
    def from_quaternion(cls, translation_m: ArrayLike, quat_wxyz: ArrayLike) -> "Pose":
        """The pose of translations (..., 3) and quaternions (..., 4), of any length but zero.

        Raises:
            ValueError: Another shape, numbers that are not finite, or a quaternion of zeros.
        """
        return cls(rotation_of("quat_wxyz", quat_wxyz), check.real("translation_m", translation_m))

    def matrix(self) -> Array:
        """Homogeneous matrices, shape (..., 4, 4)."""
        return homogeneous(self.rotation, self.translation_m, self.lead)

    def quat_wxyz(self) -> Array:
        """Unit quaternions, the real part first and not negative, shape (..., 4)."""
        quat_wxyz = self._batch(self.lead).rotation.as_quat(canonical=True, scalar_first=True)
        return quat_wxyz.reshape(*self.lead, 4)

    def transform(self) -> RigidTransform:
        """The same in scipy, whose logarithm [rotation vector; V^-1 translation] is as_exp_coords.

        Before scipy 1.17 a batch has one leading axis there.
        """
        batch = self._batch(self.lead)
        return batch if len(self.lead) == 1 else RigidTransform.from_matrix(self.matrix())

    def inverse(self) -> "Pose":
        """The outer frame as seen from this one."""
        return _of_batch(self._batch(self.lead).inv(), self.lead)

    def __matmul__(self, other: "Pose") -> "Pose":
        """A pose seen from this one, as seen from the outer frame; batch axes broadcast."""
        check.instance("other", other, Pose)
        lead = check.common_axes({"the pose": self.lead, "other": other.lead})
        return _of_batch(self._batch(lead) * other._batch(lead), lead)

    def adjoint(self) -> Array:
        """Takes twists [angular; linear] seen from this frame to the one that it is seen from.

        Shape (..., 6, 6). Of T = `matrix()`: T exp(twist) T^-1 is exp(adjoint @ twist).
        """
        return adjoint(self.rotation, self.translation_m, self.lead)

    def _batch(self, lead: tuple[int, ...]) -> RigidTransform:
        """Broadcast to batch axes and then as one batch."""
        rotation = Rotation.from_matrix(check.flat(self.rotation, 2, lead))
        return RigidTransform.from_components(check.flat(self.translation_m, 1, lead), rotation)

    @property
    def lead(self) -> tuple[int, ...]:
        """Batch axes of rotation and translation together."""
        axes, others = self.rotation.shape[:-2], self.translation_m.shape[:-1]
        if axes == others:
            return axes
        return check.common_axes({"rotation": axes, "translation_m": others})


def _of_batch(batch: RigidTransform, lead: tuple[int, ...]) -> Pose:
    rotation, translation_m = batch.rotation.as_matrix(), batch.translation
    return check.computed(
        Pose,
        rotation=rotation.reshape(*lead, 3, 3),
        translation_m=translation_m.reshape(*lead, 3),
    )


def way_between(rotation: Array, position_m: Array, to_rotation: Array, to_m: Array) -> Array:
    """[rotation vector; translation] (6,) from one pose to another, in the axes of both.

    The vector is that of :func:`rotation_vector`, at every tick.
    """
    way = np.empty(6)
    principal(lib.way(*map(pointer, (rotation, position_m, to_rotation, to_m, way))), way)
    return way


def principal(largest_rad: float, twists: Array) -> None:
    """Make rotation vectors, the first of twists (..., 6), one of two at half a turn.

    Compiled code has written them, and said the largest angle.
    """
    if largest_rad > _CLEARLY_LESS_RAD:
        twists[..., :3] = one_half_turn(twists[..., :3])


NOMINAL = Pose(np.eye(3), np.zeros(3))
