"""The payload of a plant: where it is, seen from the base, and what pushes it."""

from dataclasses import dataclass

import mujoco
import numpy as np

import argument_checks as check
from sim.array import Array
from sim.model import element_id
from sim.pose import Pose, computed

_WORLD = check.frozen(np.eye(3))


@dataclass(frozen=True)
class Payload:
    """A task site, the site whose axes express its motion, and its nominal pose in the world.

    Attributes:
        site: Id of the task site.
        body: Id of the body that it belongs to.
        base: Id of the site that gives the axes; None is the world.
        origin_m: Nominal position, shape (3,).
        world_to_site: Nominal rotation from world axes to those of the site, shape (3, 3).
    """

    site: int
    body: int
    base: int | None
    origin_m: Array
    world_to_site: Array

    @classmethod
    def at_rest(
        cls, model: mujoco.MjModel, data: mujoco.MjData, site: int, base: int | None
    ) -> "Payload":
        """The payload whose nominal pose is the present one."""
        to_site = data.site_xmat[site].reshape(3, 3).T.copy()
        return cls(site, int(model.site_bodyid[site]), base, data.site_xpos[site].copy(), to_site)

    def axes(self, data: mujoco.MjData) -> Array:
        """Present axes of the base in the world as columns, shape (3, 3)."""
        return _WORLD if self.base is None else data.site_xmat[self.base].reshape(3, 3)

    def pose(self, data: mujoco.MjData) -> Pose:
        """Motion from the nominal pose, in base axes: rotation R_now R_nominal^T."""
        axes = self.axes(data)
        to_base = axes.T
        turned = to_base.dot(data.site_xmat[self.site].reshape(3, 3))
        rotation = turned.dot(self.world_to_site.dot(axes))
        shift = data.site_xpos[self.site] - self.origin_m
        return computed(Pose, rotation=rotation, translation_m=to_base.dot(shift))

    def force_at_centre_of_mass(self, data: mujoco.MjData, wrench: Array) -> Array:
        """[force; moment] in world axes, as `xfrc_applied`, of [moment; force] (6,) at the site."""
        axes = self.axes(data)
        moment, force = axes @ wrench[:3], axes @ wrench[3:]
        arm = data.site_xpos[self.site] - data.xipos[self.body]
        return np.array([*force, *(moment + np.cross(arm, force))])


def site_id(model: mujoco.MjModel, argument: str, name: str) -> int:
    """Id of the site that an argument names.

    Raises:
        ModelError: There is no site of that name.
        TypeError: The argument is no name.
    """
    return element_id(model, "site", check.instance(argument, name, str))
