"""An MJCF model seen from one side: the outlines of its geoms, and its two frames."""

from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.spatial import ConvexHull

from sim import Array, element_id

_TURN = np.linspace(0, 2 * np.pi, 48, endpoint=False)
_RING = np.column_stack([np.cos(_TURN), np.sin(_TURN)])
_BALL = np.vstack(
    [
        np.column_stack([_RING * np.cos(tilt), np.full(len(_RING), np.sin(tilt))])
        for tilt in np.linspace(-np.pi / 2, np.pi / 2, 25)
    ]
)
_CORNERS = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T


@dataclass(frozen=True)
class Side:
    """A direction of sight, along one of the base's axes.

    Base axis `across`, 0..2, points right and `down` points down: the side to which the other
    turns, as a view from behind would be mirrored.
    """

    name: str
    across: int
    down: int

    @property
    def plane(self) -> list[int]:
        """Base axes on the paper."""
        return [self.across, self.down]

    @property
    def away(self) -> Array:
        """Unit vector from the reader into the paper, base axes."""
        return np.cross(np.eye(3)[self.across], np.eye(3)[self.down])


TOP, FRONT = Side("top", across=0, down=1), Side("front", across=0, down=2)


@dataclass(frozen=True)
class Part:
    """One geom; `surface_m`: points whose convex hull it is, as :class:`Frame`, shape (k, 3)."""

    name: str
    belongs_to: str  # "base", "payload" or "strut"
    surface_m: Array

    def outline_m(self, side: Side) -> Array:
        """Convex polygon seen from that side, shape (., 2)."""
        flat = self.surface_m[:, side.plane]
        return flat[ConvexHull(flat).vertices]


@dataclass(frozen=True)
class Frame:
    """A coordinate frame of the paper's Fig. 2, in base axes, from the payload origin.

    The unit vectors x, y, z are the rows of `axes`, shape (3, 3).
    """

    subscript: str  # "" for the payload, "_b" for the base
    origin_m: Array
    axes: Array


def frames(model: mujoco.MjModel) -> list[Frame]:
    """Frames of the payload and the base at the nominal pose."""
    data, origin, to_base = _nominal(model)
    return [
        Frame(
            subscript,
            to_base @ (data.site_xpos[site] - origin),
            (to_base @ data.site_xmat[site].reshape(3, 3)).T,
        )
        for subscript, site in (("", _site(model, "payload")), ("_b", _site(model, "base")))
    ]


def parts(model: mujoco.MjModel) -> list[Part]:
    """All geoms with a finite extent, at the nominal pose."""
    data, origin, to_base = _nominal(model)
    bodies = {model.site_bodyid[_site(model, name)]: name for name in ("base", "payload")}
    found = []
    for geom in range(model.ngeom):
        surface = _surface(model, geom)
        if surface is not None:
            world = surface @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]
            belongs_to = bodies.get(model.geom_bodyid[geom], "strut")
            found.append(Part(model.geom(geom).name, belongs_to, (world - origin) @ to_base.T))
    return found


def _nominal(model: mujoco.MjModel) -> tuple[mujoco.MjData, Array, Array]:
    """The machine at its nominal pose, its payload origin, and what turns the world to the base."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    to_base = data.site_xmat[_site(model, "base")].reshape(3, 3).T
    return data, data.site_xpos[_site(model, "payload")], to_base


def _site(model: mujoco.MjModel, name: str) -> int:
    return element_id(model, "site", name)


def _surface(model: mujoco.MjModel, geom: int) -> Array | None:
    """Points on a geom in its own axes; None for those without end, planes and height fields."""
    size, kind = model.geom_size[geom], mujoco.mjtGeom
    match model.geom_type[geom]:
        case kind.mjGEOM_SPHERE:
            return size[0] * _BALL
        case kind.mjGEOM_ELLIPSOID:
            return size * _BALL
        case kind.mjGEOM_BOX:
            return size * _CORNERS
        case kind.mjGEOM_CAPSULE:
            return size[0] * _BALL + np.sign(_BALL[:, 2:]) * [0, 0, size[1]]
        case kind.mjGEOM_CYLINDER:
            rim = size[0] * _RING
            return np.vstack([np.c_[rim, np.full(len(rim), end)] for end in (-size[1], size[1])])
        case kind.mjGEOM_MESH:
            first = model.mesh_vertadr[model.geom_dataid[geom]]
            return model.mesh_vert[first : first + model.mesh_vertnum[model.geom_dataid[geom]]]
    return None
