"""Figure 2 of the paper: top view and front view of the hexapod, drawn from its MJCF."""

from collections import defaultdict
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from scipy.spatial import ConvexHull

from experiments.output.plotting import BLACK, BLUE, GREEN, PAGE_IN, PURPLE, VERMILION, new_figure
from sim import Array, Hexapod, element_id, hexapod

NAMED = {"laser": (-52, 14), "telescope": (-62, 42), "detector": (24, 3), "base_plate": (30, -18)}
"""Parts that are named where a machine has them, and where their names stand, in points."""
_AXIS_M = 0.1
_ARROW = {"arrowstyle": "-|>", "lw": 1, "color": BLACK, "shrinkA": 0, "shrinkB": 0}
_PAPER = {"fc": "white", "alpha": 0.8, "lw": 0, "pad": 0.5}
_FILL = {"base": "0.95", "payload": "0.88", "strut": "0.75"}

_TURN = np.linspace(0, 2 * np.pi, 48, endpoint=False)
_RING = np.column_stack([np.cos(_TURN), np.sin(_TURN)])
_TILTS = np.linspace(-np.pi / 2, np.pi / 2, 25)
_BALL = np.vstack([np.c_[_RING * np.cos(t), np.full(len(_RING), np.sin(t))] for t in _TILTS])
_CORNERS = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T


@dataclass(frozen=True)
class Side:
    """A direction of sight; base axis `across`, 0..2, points right, `down` down: not mirrored."""

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
    """One geom, the convex hull of points on its surface, in base axes, from the payload origin."""

    name: str
    belongs_to: str  # "base", "payload" or "strut"
    surface_m: Array  # (k, 3)

    def outline_m(self, side: Side) -> Array:
        """Convex polygon seen from that side, shape (., 2)."""
        flat = self.surface_m[:, side.plane]
        return flat[ConvexHull(flat).vertices]


@dataclass(frozen=True)
class Frame:
    """A coordinate frame of the paper's Fig. 2, in base axes, from the payload origin."""

    subscript: str  # "" for the payload, "_b" for the base
    origin_m: Array
    axes: Array  # rows: unit vectors x, y, z


def figure_2(model: mujoco.MjModel) -> Figure:
    """Nodes, struts and frames over the outlines of all parts; coordinates of the base's axes.

    They are measured from the payload's origin, as those of :class:`sim.Hexapod`.

    Raises:
        sim.ModelError: The machine is not a hexapod.
    """
    geometry, seen = hexapod(model), parts(model)
    figure = new_figure(PAGE_IN, 3.9)
    for axes, side in zip(figure.subplots(1, 2, sharex=True), (TOP, FRONT), strict=True):
        _outlines(axes, side, seen)
        _struts(axes, side, geometry)
        _nodes(axes, side, geometry)
        _frames(axes, side, frames(model))
        _dimension(axes, side, geometry)
        across, down = (f"${'xyz'[axis]}_b$, m" for axis in side.plane)
        axes.set(title=f"{side.name} view", xlabel=across, ylabel=down, aspect="equal")
        axes.invert_yaxis()
    figure.supxlabel(f"{_caption(geometry)} Along the base's axes, from the payload's origin.")
    return figure


def node_names(geometry: Hexapod) -> dict[str, Array]:
    """Nodes q1, q2, ... and p1, p2, ... in the order in which struts 1 to 6 come to them."""
    found = {}
    for letter, nodes in (("q", geometry.bottom_m), ("p", geometry.top_m)):
        distinct: list[Array] = []
        for node in nodes:
            if not any(np.allclose(node, other, atol=1e-6) for other in distinct):
                distinct.append(node)
        found |= {f"{letter}{k}": node for k, node in enumerate(distinct, 1)}
    return found


def _outlines(axes: Axes, side: Side, seen: list[Part]) -> None:
    for part in sorted(seen, key=lambda part: -(part.surface_m @ side.away).mean()):
        edge = VERMILION if part.name == "beam" else "0.5"
        axes.add_patch(Polygon(part.outline_m(side), fc=_FILL[part.belongs_to], ec=edge, lw=0.4))
        if side is FRONT and part.name in NAMED:
            axes.annotate(
                part.name.replace("_", " "),
                part.surface_m[:, side.plane].mean(axis=0),
                NAMED[part.name],
                textcoords="offset points",
                arrowprops={"arrowstyle": "-", "lw": 0.4},
                zorder=4,
            )


def _struts(axes: Axes, side: Side, geometry: Hexapod) -> None:
    """From q to p, the way in which they grow; the number stands nearer to q."""
    number = {"color": "white", "bbox": {"boxstyle": "circle,pad=0.2", "fc": BLUE, "lw": 0}}
    ends = np.stack([geometry.bottom_m, geometry.top_m], axis=1)[..., side.plane]
    for k, (bottom, top) in enumerate(ends, 1):
        third, middle, beyond = bottom + np.array([[0.3], [0.6], [0.72]]) * (top - bottom)
        axes.plot(*ends[k - 1].T, color=BLUE, lw=1.2, gid=f"{side.name}-strut{k}")
        axes.annotate("", beyond, middle, arrowprops=_ARROW | {"color": BLUE})
        axes.text(third[0], third[1], str(k), ha="center", va="center", **number)


def _nodes(axes: Axes, side: Side, geometry: Hexapod) -> None:
    names: dict[tuple[float, ...], list[str]] = defaultdict(list)
    for name, node in node_names(geometry).items():
        x, y = node[side.plane]
        color = GREEN if name[0] == "p" else PURPLE
        axes.plot(x, y, "o", color=color, mec=BLACK, mew=0.5, ms=5, gid=f"{side.name}-{name}")
        names[tuple(np.round([x, y], 4))].append(f"${name[0]}_{name[1]}$")
    for (x, y), alike in names.items():
        out = 12 * (-1 if x < -1e-6 else 1), 7 * (-1 if y > 0 else 1)
        _label(axes, ", ".join(alike), (x, y), out, ha="center", va="center")


def _frames(axes: Axes, side: Side, shown: list[Frame]) -> None:
    """Axes of both frames; those that point at the reader are a dot, away from him a cross."""
    labels: dict[tuple[float, ...], list[str]] = defaultdict(list)
    for frame in shown:
        for letter, axis in zip("xyz", frame.axes, strict=True):
            drawn = [*frame.origin_m[side.plane], *axis[side.plane], axis @ side.away]
            labels[tuple(np.round(drawn, 6) + 0.0)].append(f"${letter}{frame.subscript}$")
    for (x, y, right, down, away), alike in labels.items():
        label = ", ".join(alike)
        if abs(away) > 0.99:
            mark, size = ("x", 5) if away > 0 else (".", 3)
            axes.plot(x, y, "o", ms=7, mfc="white", mec=BLACK, mew=0.8)
            axes.plot(x, y, mark, ms=size, color=BLACK, mew=0.8)
            _label(axes, label, (x, y), (-7, 6), ha="right")
        else:
            tip = x + _AXIS_M * right, y + _AXIS_M * down
            axes.annotate("", tip, (x, y), arrowprops=_ARROW)
            axes.update_datalim([tip])
            _label(axes, label, tip, (4, 3))


def _label(
    axes: Axes, text: str, place: tuple[float, float], offset: tuple[float, float], **style: Any
) -> None:
    """A name beside what it names, offset in points, on paper that keeps lines out of it."""
    axes.annotate(text, place, offset, textcoords="offset points", bbox=_PAPER, **style)


def _dimension(axes: Axes, side: Side, geometry: Hexapod) -> None:
    """How far the nodes reach: across in the top view, from plane to plane in the front view."""
    nodes = np.vstack([geometry.bottom_m, geometry.top_m])[:, side.plane]
    (left, low), (_, high) = nodes.min(axis=0), nodes.max(axis=0)
    x, middle = left - 0.075, (low + high) / 2
    axes.annotate("", (x, low), (x, high), arrowprops=_ARROW | {"arrowstyle": "<|-|>", "lw": 0.6})
    style = {"rotation": "vertical", "ha": "right", "va": "center"}
    _label(axes, f"{high - low:.4f} m", (x, middle), (-2, 0), **style)


def _caption(geometry: Hexapod) -> str:
    """What the views foreshorten: strut lengths, and the angle at which two struts meet."""
    struts = geometry.top_m - geometry.bottom_m
    lengths = np.linalg.norm(struts, axis=1)
    low, high = f"{lengths.min():.4f}", f"{lengths.max():.4f}"
    angle = np.rad2deg(np.arccos(struts[0] @ struts[1] / (lengths[0] * lengths[1])))
    return (
        f"Strut length {low if low == high else f'{low} to {high}'} m; "
        f"struts 1 and 2 stand at {angle:.1f}° to each other."
    )


# The model seen from one side: the outlines of its geoms, and its two frames.


def frames(model: mujoco.MjModel) -> list[Frame]:
    """Frames of the payload and the base at the nominal pose."""
    data, origin, to_base = _nominal(model)
    found = []
    for subscript, name in (("", "payload"), ("_b", "base")):
        site = element_id(model, "site", name)
        axes = (to_base @ data.site_xmat[site].reshape(3, 3)).T
        found.append(Frame(subscript, to_base @ (data.site_xpos[site] - origin), axes))
    return found


def parts(model: mujoco.MjModel) -> list[Part]:
    """All geoms with a finite extent, at the nominal pose."""
    data, origin, to_base = _nominal(model)
    sites = {name: element_id(model, "site", name) for name in ("base", "payload")}
    bodies = {model.site_bodyid[site]: name for name, site in sites.items()}
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
    base, payload = (element_id(model, "site", name) for name in ("base", "payload"))
    return data, data.site_xpos[payload], data.site_xmat[base].reshape(3, 3).T


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
            mesh = model.geom_dataid[geom]
            return model.mesh_vert[model.mesh_vertadr[mesh] :][: model.mesh_vertnum[mesh]]
    return None
