"""Poses of frames."""

from dataclasses import dataclass
from functools import cache
from typing import Any, TypeVar

import numpy as np
from scipy.spatial.transform import Rotation

import argument_checks as check
from sim.array import Array, lock
from sim.mjcf.frame import one_half_turn

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
        """Check the arguments, and keep read-only copies."""
        keep(self, "rotation", 3, 3)
        keep(self, "translation_m", 3)
        _ = self.lead  # raises where there is none

    def moved(self, twist: Array) -> "Pose":
        """The pose after a displacement [rotation vector; translation] (..., 6), base axes.

        Raises:
            ValueError: Another shape, or numbers that are not finite.
        """
        twist = check.shaped("twist", twist, 6)
        lead = check.common_axes({"the pose": self.lead, "twist": twist.shape[:-1]})
        rotation, translation_m = np.empty((*lead, 3, 3)), np.empty((*lead, 3))
        compiled().move(
            flat(self.rotation, 2, lead),
            flat(self.translation_m, 1, lead),
            flat(twist, 1, lead),
            rotation.reshape(-1, 3, 3),
            translation_m.reshape(-1, 3),
        )
        return computed(Pose, rotation=rotation, translation_m=translation_m)

    def displacement(self) -> Array:
        """[rotation vector; translation], shape (..., 6)."""
        turn = Rotation.from_matrix(self.rotation.reshape(-1, 3, 3)).as_rotvec()
        turn = one_half_turn(turn.reshape(*self.rotation.shape[:-2], 3))
        return np.concatenate([turn, self.translation_m], axis=-1)

    @property
    def lead(self) -> tuple[int, ...]:
        """Batch axes of rotation and translation together."""
        axes, others = self.rotation.shape[:-2], self.translation_m.shape[:-1]
        if axes == others:
            return axes
        return check.common_axes({"rotation": axes, "translation_m": others})


@cache
def compiled() -> Any:
    """The compiled code, loaded when first needed: the compiler takes some 0.3 s."""
    from sim import _tick

    return _tick


def flat(A: Array, own: int, lead: tuple[int, ...]) -> Array:
    """Arrays of so many axes of their own, broadcast to batch axes and then as one batch."""
    if not lead:
        return A[None]
    shape = A.shape[A.ndim - own :]
    return np.broadcast_to(A, (*lead, *shape)).reshape(-1, *shape)


def computed(kind: type[_Kind], **fields: Any) -> _Kind:
    """A frozen record of new arrays that come from checked ones, at every tick: locked alone."""
    record = object.__new__(kind)
    record.__dict__.update(fields)
    lock(record)
    return record


def keep(frozen: object, name: str, *shape: int) -> None:
    """Check an array of a frozen dataclass, and keep a read-only copy."""
    A = check.frozen(check.shaped(name, getattr(frozen, name), *shape))
    object.__setattr__(frozen, name, A)


NOMINAL = Pose(np.eye(3), np.zeros(3))
