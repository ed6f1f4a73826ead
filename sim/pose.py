"""Poses of frames."""

from dataclasses import dataclass
from typing import Any, TypeVar

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

import argument_checks as check
from sim.array import Array

_Kind = TypeVar("_Kind")


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
        """Take what numbers can be had as arrays."""
        keep(self, "rotation", 3, 3)
        keep(self, "translation_m", 3)
        axes, others = self.rotation.shape[:-2], self.translation_m.shape[:-1]
        if axes != others:
            check.common_axes({"rotation": axes, "translation_m": others})

    def moved(self, twist: Array) -> "Pose":
        """The pose after a displacement [rotation vector; translation] (..., 6), base axes.

        Raises:
            ValueError: Another shape, or numbers that are not finite.
        """
        twist = check.shaped("twist", twist, 6)
        if twist.ndim == 1 and self.rotation.ndim == 2:
            turned = _turn(twist[:3]).dot(self.rotation)
            return computed(Pose, rotation=turned, translation_m=self.translation_m + twist[3:])
        check.common_axes({"the pose": self.rotation.shape[:-2], "twist": twist.shape[:-1]})
        turn = Rotation.from_rotvec(twist[..., :3].reshape(-1, 3)).as_matrix()
        turn = turn.reshape(*twist.shape[:-1], 3, 3)
        return Pose(turn @ self.rotation, self.translation_m + twist[..., 3:])


def _turn(rotation_vector: Array) -> Array:
    """Matrix of one rotation: MuJoCo takes a tenth of scipy's time, which is made for batches."""
    quat_wxyz, matrix = np.array([1.0, 0.0, 0.0, 0.0]), np.empty(9)
    mujoco.mju_quatIntegrate(quat_wxyz, rotation_vector, 1.0)
    mujoco.mju_quat2Mat(matrix, quat_wxyz)
    return matrix.reshape(3, 3)


def computed(kind: type[_Kind], **fields: Any) -> _Kind:
    """A frozen record of arrays that come from checked ones, at every tick: not checked again."""
    record = object.__new__(kind)
    record.__dict__.update(fields)
    return record


def keep(frozen: object, name: str, *shape: int) -> None:
    """Check an array of a frozen dataclass, and keep it as one."""
    value = getattr(frozen, name)
    if (A := check.shaped(name, value, *shape)) is not value:
        object.__setattr__(frozen, name, A)


NOMINAL = Pose(np.eye(3), np.zeros(3))
