"""The payload of a plant: where it is, seen from the base, and what pushes it."""

from dataclasses import dataclass

import mujoco
import numpy as np

import argument_checks as check
from kernels import lib, pointer
from sim.array import Array
from sim.kinematics.pose import Pose
from sim.mjcf.frame import Located

_WORLD = check.frozen(np.eye(3))


@dataclass(frozen=True)
class Payload:
    """A task frame, the one whose axes express its motion, and its nominal pose in the world.

    Attributes:
        frame: The task frame.
        base: The frame that gives the axes; None is the world.
        origin_m: Nominal position, shape (3,).
        world_to_frame: Nominal rotation from world axes to those of the frame, shape (3, 3).
    """

    frame: Located
    base: Located | None
    origin_m: Array
    world_to_frame: Array

    @classmethod
    def at_rest(cls, data: mujoco.MjData, frame: Located, base: Located | None) -> "Payload":
        """The payload whose nominal pose is the present one."""
        return cls(frame, base, frame.position_m(data).copy(), frame.rotation(data).T.copy())

    def axes(self, data: mujoco.MjData) -> Array:
        """Present axes of the base in the world as columns, shape (3, 3)."""
        return _WORLD if self.base is None else self.base.rotation(data)

    def pose(self, data: mujoco.MjData) -> Pose:
        """Motion from the nominal pose, in base axes: rotation R_now R_nominal^T."""
        rotation, translation_m = np.empty((3, 3)), np.empty(3)
        lib.seen_from(*map(pointer, (*self.frames(data).values(), rotation, translation_m)))
        return check.computed(Pose, rotation=rotation, translation_m=translation_m)

    def frames(self, data: mujoco.MjData) -> dict[str, Array]:
        """What the compiled code takes to see this motion, by names of kernels.h.

        It is good as long as `data` is.
        """
        return {
            "xmat": self.frame.rotation(data),
            "xpos": self.frame.position_m(data),
            "base_xmat": self.axes(data),
            "R_0": self.world_to_frame,
            "p_0": self.origin_m,
        }

    def force_at_centre_of_mass(self, data: mujoco.MjData, wrench: Array) -> Array:
        """[force; moment] in world axes, as `xfrc_applied`, of [moment; force] (6,) at it."""
        axes = self.axes(data)
        moment, force = axes @ wrench[:3], axes @ wrench[3:]
        arm = self.frame.position_m(data) - data.xipos[self.frame.body]
        return np.array([*force, *(moment + np.cross(arm, force))])
