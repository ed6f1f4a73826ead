"""Geoms of an MJCF as closed surfaces of small faces, to be drawn."""

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from sim import Array

_STEP_M = 0.025
"""Faces are no longer: what is nearer is decided face by face."""
_QUARTER = np.linspace(0, np.pi / 2, 5)
_CORNERS = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T


@dataclass(frozen=True)
class Solid:
    """One geom in the axes of its body; a triangle is a quadrilateral that repeats a point."""

    points_m: Array  # (V, 3)
    faces: NDArray[np.intp]  # (F, 4), counter-clockwise from outside

    def lengthened(self, by_m: float) -> "Solid":
        """The same, stretched along z until its lower end is so much lower."""
        height = self.points_m[:, 2]
        below = (height.max() - height) / np.ptp(height)
        return Solid(self.points_m - by_m * np.outer(below, [0, 0, 1]), self.faces)

    @property
    def edges(self) -> NDArray[np.intp]:
        """Pairs of points, (E, 2), in the order of `beside`."""
        return self._meetings[:, :2]

    @property
    def beside(self) -> NDArray[np.intp]:
        """The two faces that meet at each edge, (E, 2)."""
        return self._meetings[:, 2:]

    @cached_property
    def _meetings(self) -> NDArray[np.intp]:
        """Points and faces of each edge: the surface is closed, so that each has two faces."""
        ends = np.stack([self.faces, np.roll(self.faces, -1, axis=1)], axis=-1).reshape(-1, 2)
        face = np.repeat(np.arange(len(self.faces)), 4)
        real = ends[:, 0] != ends[:, 1]
        ends, face = np.sort(ends[real], axis=1), face[real]
        order = np.lexsort((ends[:, 0], ends[:, 1]))
        ends, face = ends[order], face[order]
        return np.hstack([ends[::2], face.reshape(-1, 2)])


def solid_of(model: mujoco.MjModel, geom: int) -> Solid | None:
    """A geom, a mesh as its convex hull; None for those without end, planes and height fields."""
    size, kind = model.geom_size[geom], mujoco.mjtGeom
    match model.geom_type[geom]:
        case kind.mjGEOM_SPHERE:
            solid = _revolved(_ball(0.0), size[0])
        case kind.mjGEOM_ELLIPSOID:
            ball = _revolved(_ball(0.0), 1.0)
            solid = Solid(size * ball.points_m, ball.faces)
        case kind.mjGEOM_CAPSULE:
            solid = _revolved(_ball(size[1] / size[0]), size[0])
        case kind.mjGEOM_CYLINDER:
            radius, half = size[:2]
            solid = _revolved(np.array([(0, -half), (radius, -half), (radius, half), (0, half)]), 1)
        case kind.mjGEOM_BOX:
            solid = _hull(size * _CORNERS)
        case kind.mjGEOM_MESH:
            mesh = model.geom_dataid[geom]
            first, number = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
            solid = _hull(model.mesh_vert[first : first + number].astype(float))
        case _:
            return None
    turn = np.empty(9)
    mujoco.mju_quat2Mat(turn, model.geom_quat[geom])
    return Solid(solid.points_m @ turn.reshape(3, 3).T + model.geom_pos[geom], solid.faces)


def _ball(half: float) -> Array:
    """Radius and height of a ball of radius 1 whose halves are pulled apart, from pole to pole."""
    lower = np.column_stack([np.sin(_QUARTER), -half - np.cos(_QUARTER)])
    upper = [1, -1] * lower[::-1]
    return np.vstack([lower, upper if half else upper[1:]])


def _revolved(profile: Array, scale: float) -> Solid:
    """The surface of revolution about z of a profile [radius, height] from pole to pole."""
    outline = _stepped(scale * profile)
    around = int(np.clip(np.ceil(2 * np.pi * outline[:, 0].max() / _STEP_M), 24, 72))
    turn = 2 * np.pi * np.arange(around) / around
    radius, height = outline.T
    x, y = radius[:, None] * np.cos(turn), radius[:, None] * np.sin(turn)
    points = np.stack([x, y, np.broadcast_to(height[:, None], x.shape)], axis=-1)
    number = np.arange(x.size).reshape(x.shape)
    number[[0, -1]] = number[[0, -1], :1]  # a pole is one point
    after = np.roll(number, -1, axis=1)
    faces = np.stack([number[:-1], after[:-1], after[1:], number[1:]], axis=-1)
    return Solid(points.reshape(-1, 3), faces.reshape(-1, 4))


def _stepped(profile: Array) -> Array:
    """The same polygon with more corners, none farther apart than a step; none twice."""
    pieces = []
    for start, end in pairwise(profile):
        steps = int(np.ceil(np.linalg.norm(end - start) / _STEP_M))
        share = np.arange(steps)[:, None] / max(steps, 1)
        pieces.append(start + share * (end - start))
    return np.vstack([*pieces, profile[-1:]])


def _hull(points: Array) -> Solid:
    """The convex hull of points, its triangles turned outwards."""
    hull = ConvexHull(points)
    corners = points[hull.simplices]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inward = (normal * hull.equations[:, :3]).sum(axis=1) < 0
    triangles = np.where(inward[:, None], hull.simplices[:, ::-1], hull.simplices)
    return Solid(points, triangles[:, [0, 1, 2, 2]])
