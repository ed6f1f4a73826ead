"""The machine in 3D on paper: solids of its MJCF, shaded and outlined, what is behind hidden."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgb
from numpy.typing import NDArray

from experiments.recording.motion import Motion, hexapod_mover
from experiments.recording.solids import Solid, solid_of
from experiments.rig.bodies import body_name
from experiments.study.palette import BLACK, SKY
from sim import NOMINAL, Array, element_id

COLORS = {"base": "0.85", "payload": "0.7", "strut": SKY, "flexure": "0.4"}
"""Of parts of the machine; a strut is its housing and its stem."""
_PLAIN = "0.8"
"""Of any other."""

_LIGHT = np.array([-0.45, 0.75, 0.6])
"""Where the light comes from: right, up, towards the reader."""
_AMBIENT, _PALE = 0.65, 0.15
_EDGE, _EDGE_PT = "0.25", 0.5
_NEAR_M = 0.05
_INSIDE_M = 0.08
"""Stems are so much longer than in the MJCF, in their housings: a magnified stroke has no gap."""
_NUMBERED_AT = 0.43
"""Of the way from the bottom node to the top node."""
_DIGITS = "123456"
_SHARP = np.cos(np.deg2rad(40))


@dataclass(frozen=True)
class View:
    """A direction of sight from far away; the azimuth turns the eye about the vertical [deg]."""

    azimuth_deg: float = -82.0  # -90: along MuJoCo's y axis, x to the right
    elevation_deg: float = 15.0

    @cached_property
    def axes(self) -> Array:
        """Unit vectors right, up and towards the reader, rows, in MuJoCo's world."""
        turn, lift = np.deg2rad([self.azimuth_deg, self.elevation_deg])
        right = np.array([-np.sin(turn), np.cos(turn), 0.0])
        level = np.array([np.cos(turn), np.sin(turn), 0.0])
        towards = np.cos(lift) * level + np.sin(lift) * np.array([0.0, 0.0, 1.0])
        return np.array([right, np.cross(towards, right), towards])

    def on_paper(self, points_m: Array) -> Array:
        """Points (..., 3) as they are drawn, right and up, shape (..., 2)."""
        return points_m @ self.axes[:2].T


@dataclass(frozen=True)
class Machine:
    """The surface of all geoms: quadrilaterals between points that each move with one body.

    Edges are pairs of points, `beside` the two faces that meet there.
    """

    points_m: Array  # (V, 3), in the axes of their bodies
    bodies: NDArray[np.intp]  # (V,)
    faces: NDArray[np.intp]  # (F, 4), counter-clockwise from outside; triangles repeat a point
    edges: NDArray[np.intp]  # (E, 2)
    beside: NDArray[np.intp]  # (E, 2)
    parts: tuple[str, ...]  # (F,): "base", "payload", "flexure", "strut1" to "strut6"

    def placed(self, motion: Motion, at: int) -> Array:
        """The points in MuJoCo's world at one of the times of a motion, shape (V, 3)."""
        turned = motion.rotation[at, self.bodies] @ self.points_m[..., None]
        return motion.position_m[at, self.bodies] + turned[..., 0]


def machine(model: mujoco.MjModel) -> Machine:
    """The solids of a hexapod's MJCF; geoms without an end, planes, are left out."""
    found = []
    for geom, solid in _solids(model):
        is_stem = model.body(model.geom_bodyid[geom]).name.startswith("stem")
        drawn = solid.lengthened(_INSIDE_M) if is_stem else solid
        found.append((geom, drawn, _part(model, geom)))
    return _joined(model, found)


def robot(model: mujoco.MjModel) -> Machine:
    """The solids of any MJCF but its planes; each body is a part, by its name."""
    body = [body_name(model, int(k)) for k in model.geom_bodyid]
    return _joined(model, [(geom, solid, body[geom]) for geom, solid in _solids(model)])


def _solids(model: mujoco.MjModel) -> Iterator[tuple[int, Solid]]:
    for geom in range(model.ngeom):
        if (solid := solid_of(model, geom)) is not None:
            yield geom, solid


def _joined(model: mujoco.MjModel, found: Sequence[tuple[int, Solid, str]]) -> Machine:
    """Geoms, each with its part, as one surface."""
    solids = [solid for _, solid, _ in found]
    points = np.cumsum([0, *(len(solid.points_m) for solid in solids)])
    faces = np.cumsum([0, *(len(solid.faces) for solid in solids)])
    return Machine(
        points_m=np.vstack([solid.points_m for solid in solids]),
        bodies=np.repeat([int(model.geom_bodyid[geom]) for geom, *_ in found], np.diff(points)),
        faces=np.vstack([s.faces + first for s, first in zip(solids, points, strict=False)]),
        edges=np.vstack([s.edges + first for s, first in zip(solids, points, strict=False)]),
        beside=np.vstack([s.beside + first for s, first in zip(solids, faces, strict=False)]),
        parts=tuple(np.repeat([part for *_, part in found], np.diff(faces)).tolist()),
    )


def _part(model: mujoco.MjModel, geom: int) -> str:
    body = model.body(model.geom_bodyid[geom]).name
    if body[:-1] in ("housing", "stem", "tip"):
        is_tube = model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_CYLINDER
        return f"strut{body[-1]}" if is_tube else "flexure"
    payload = model.site_bodyid[element_id(model, "site", "payload")]
    return "payload" if model.geom_bodyid[geom] == payload else "base"


def draw_machine(
    axes: Axes, machine: Machine, points_m: Array, view: View, colors: Mapping[str, str] = COLORS
) -> None:
    """Draw the machine with its points placed in the world, (V, 3); far faces first.

    A part takes its own colour, or that of its kind: "strut1" or "strut"; a robot's is grey.
    """
    corners = points_m[machine.faces]
    normals = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    seen = normals @ view.axes[2] > 0
    lines = points_m[machine.edges[_drawn_edges(machine, normals, seen)]][:, [0, 1, 1, 0]]
    kinds = np.array(machine.parts)[seen]
    paint = {
        part: to_rgb(colors.get(part, colors.get(part.rstrip(_DIGITS), _PLAIN)))
        for part in set(kinds)
    }
    faces = _shaded(np.array([paint[part] for part in kinds]), normals[seen] @ view.axes.T)
    # Of what lies nearly as near: the floor comes first, an edge after the faces that meet there.
    is_floor = (kinds == "base") & (normals[seen, 2] > 1 - 1e-6)
    drawn_after_m = np.concatenate([np.where(is_floor, -_NEAR_M, 0), np.full(len(lines), 2e-3)])
    shapes = np.concatenate([corners[seen], lines])
    order = np.argsort(shapes.mean(axis=1) @ view.axes[2] + drawn_after_m, kind="stable")
    fills = np.concatenate([faces, np.full((len(lines), 3), to_rgb(_EDGE))])[order]
    # A face is outlined in its own colour, so that no seam shows between two.
    widths = np.repeat([0.4, _EDGE_PT], [len(faces), len(lines)])[order]
    shown = view.on_paper(shapes[order])
    surface = PolyCollection(list(shown), rasterized=True, linewidths=widths)
    surface.set(facecolors=fills, edgecolors=fills)
    axes.add_collection(surface)
    axes.update_datalim(shown.reshape(-1, 2))


def draw_at_rest(axes: Axes, model: mujoco.MjModel, view: View) -> None:
    """Draw the machine at its nominal pose, its struts numbered."""
    motion, drawn = hexapod_mover(model)(NOMINAL.moved(np.zeros((1, 6)))), machine(model)
    draw_machine(axes, drawn, drawn.placed(motion, 0), view)
    number_struts(axes, motion, 0, view)


def number_struts(axes: Axes, motion: Motion, at: int, view: View) -> None:
    """Write 1 to 6 on the housings, on top of all: those behind are numbered too."""
    place = {name: k for k, name in enumerate(motion.names)}
    badge = {"boxstyle": "circle,pad=0.15", "fc": "white", "ec": BLACK, "lw": 0.5}
    for k in range(1, 7):
        bottom, top = (motion.position_m[at, place[f"{name}{k}"]] for name in ("housing", "tip"))
        x, y = view.on_paper(bottom + _NUMBERED_AT * (top - bottom))
        axes.text(x, y, str(k), ha="center", va="center", bbox=badge, color=BLACK)


def _drawn_edges(machine: Machine, normals: Array, seen: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Outlines, where a face in sight meets one out of sight, and sharp edges in sight."""
    one, other = machine.beside.T
    is_sharp = (normals[one] * normals[other]).sum(axis=1) < _SHARP
    return (seen[one] != seen[other]) | (is_sharp & seen[one])


def _shaded(base: Array, normals: Array) -> Array:
    """Colours of faces (F, 3) with their normals, in the axes of the view: lit from one side."""
    light = np.clip(normals @ (_LIGHT / np.linalg.norm(_LIGHT)), 0, 1)[:, None]
    return np.clip(base * (_AMBIENT + (1 - _AMBIENT) * light), 0, 1) * (1 - _PALE) + _PALE
