"""Figure 2 of the paper: the hexapod in 3D, from the top and the front, drawn from its MJCF."""

from collections import defaultdict
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from scipy.spatial import ConvexHull

from argument_checks.ties import ascending
from experiments.recording.drawing import View, draw_at_rest
from experiments.recording.solids import solid_of
from experiments.study.palette import BLACK, BLUE, GREEN, PURPLE, VERMILION
from experiments.study.plotting import PAGE_IN, new_figure
from sim import Array, Hexapod, element_id, hexapod

_NAMED = {
    "detector": ("detector", (-62, 24), (0.0, 0.0)),
    "telescope": ("telescope", (80, 40), (0.03, 0.12)),
    "laser": ("laser", (80, -64), (0.0, 0.0)),
    "base_plate": ("base plate", (-40, -30), (-0.36, 0.0)),
}
"""Parts that are named where a machine has them: the name, where it stands in 3D, in points from
where its line begins, and that from the part's middle, right and up [m]."""
_TIP_M = np.array([0.47, 0.47, 0.37])
"""Coordinates of the axes' tips: beyond the machine."""
_ARROW = {"arrowstyle": "-|>", "lw": 0.8, "color": BLACK, "shrinkA": 0, "shrinkB": 0}
_LINE = {"arrowstyle": "-", "lw": 0.4, "color": BLACK, "shrinkA": 0, "shrinkB": 2}
_FILL = {"base": "0.95", "payload": "0.88", "strut": "0.75"}
_NODE = {"p": GREEN, "q": PURPLE}
_NODES_3D = {
    **{"p1": (13, 3), "p2": (-13, 3), "p3": (-12, -34)},
    **{"q1": (9, 19), "q2": (-20, 6), "q3": (19, 8)},
}
"""Where their names stand, in points; farther away ones have a line."""
_FAR_PT = 20.5
_OUT_PT = 22, 13
"""In the top view, how far outwards stand names of nodes from them, numbers from their struts."""
_BELOW = {1: (8, -26), 2: (-8, -26), 3: (-14, 0), 4: (0, -26), 5: (0, -26), 6: (14, 0)}
"""Where numbers stand in the front view, in points from their struts."""


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
    figure = new_figure(PAGE_IN, 6.8)
    grid = figure.add_gridspec(2, 2, height_ratios=[1, 1.05])
    _in_3d(figure.add_subplot(grid[0, :]), model, geometry)
    figure.suptitle(headline(geometry))
    top = figure.add_subplot(grid[1, 0])
    for axes, side in ((top, TOP), (figure.add_subplot(grid[1, 1], sharex=top), FRONT)):
        _outlines(axes, side, seen)
        _struts(axes, side, geometry)
        _nodes(axes, side, geometry)
        hidden = _frames(axes, side, frames(model))
        _dimension(axes, side, geometry)
        across, down = (f"${'xyz'[axis]}_b$, m" for axis in side.plane)
        title = f"{side.name} view: {hidden}"
        axes.set(title=title, xlabel=across, ylabel=down, aspect="equal")
        axes.invert_yaxis()
    figure.supxlabel("Coordinates along the base's axes, from the payload's origin.")
    return figure


def _in_3d(axes: Axes, model: mujoco.MjModel, geometry: Hexapod) -> None:
    """The machine at rest, its nodes and parts named beside it."""
    view, data = View(), mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    origin, to_world = data.site("payload").xpos, data.site("base").xmat.reshape(3, 3)
    draw_at_rest(axes, model, view)
    for name, node in node_names(geometry).items():
        x, y = view.on_paper(origin + to_world @ node)
        axes.plot(x, y, "o", color=_NODE[name[0]], mec=BLACK, mew=0.5, ms=4)
        away = _NODES_3D.get(name, (10, 10))
        line = {"arrowprops": _LINE} if np.hypot(*away) > _FAR_PT else {}
        _label(axes, f"${name[0]}_{name[1]}$", (x, y), away, **line)
    for geom in range(model.ngeom):
        if named := _NAMED.get(model.geom(geom).name):
            name, away, begin_m = named
            x, y = view.on_paper(data.geom_xpos[geom]) + begin_m
            _label(axes, name, (x, y), away, arrowprops=_LINE)
    axes.set(aspect="equal")
    axes.axis("off")


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
    nearness_m = [-(part.surface_m @ side.away).mean() for part in seen]
    for part in (seen[k] for k in ascending(nearness_m, zero=1e-9)):
        edge = VERMILION if part.name == "beam" else "0.5"
        axes.add_patch(Polygon(part.outline_m(side), fc=_FILL[part.belongs_to], ec=edge, lw=0.4))


def _struts(axes: Axes, side: Side, geometry: Hexapod) -> None:
    """From q to p, the way in which they grow; the number stands nearer to q, off the strut."""
    ends = np.stack([geometry.bottom_m, geometry.top_m], axis=1)[..., side.plane]
    for k, (bottom, top) in enumerate(ends, 1):
        third, middle, beyond = bottom + np.array([[0.3], [0.6], [0.72]]) * (top - bottom)
        axes.plot(*ends[k - 1].T, color=BLUE, lw=1.2, gid=f"{side.name}-strut{k}")
        axes.annotate("", beyond, middle, arrowprops=_ARROW | {"color": BLUE})
        away = _outwards((bottom + top) / 2, _OUT_PT[1]) if side is TOP else _BELOW[k]
        line = {"arrowprops": _LINE} if np.hypot(*away) > _FAR_PT else {}
        _label(axes, str(k), (third[0], third[1]), away, color=BLUE, **line)


def _outwards(place: Array, points: float) -> tuple[float, float]:
    """From the middle of the top view, right and up."""
    right, down = points * place / np.linalg.norm(place)
    # On the vertical axis, beside its arrow.
    return (right, -down) if abs(right) > 1 else (0.6 * points, -0.8 * down)


def _nodes(axes: Axes, side: Side, geometry: Hexapod) -> None:
    """Named in the top view, where none hides another."""
    for name, node in node_names(geometry).items():
        x, y = node[side.plane]
        style = {"color": _NODE[name[0]], "mec": BLACK, "mew": 0.5, "ms": 5}
        axes.plot(x, y, "o", gid=f"{side.name}-{name}", **style)
        if side is TOP:
            away = _outwards(node[side.plane], _OUT_PT[0])
            _label(axes, f"${name[0]}_{name[1]}$", (x, y), away)


def _frames(axes: Axes, side: Side, shown: list[Frame]) -> str:
    """Draw both frames; return which of their axes are a dot, towards the reader, or a cross."""
    labels: dict[tuple[float, ...], list[str]] = defaultdict(list)
    hidden: dict[str, list[str]] = defaultdict(list)
    for frame in shown:
        for letter, axis, tip_m in zip("xyz", frame.axes, _TIP_M, strict=True):
            (x, y), away = frame.origin_m[side.plane], axis @ side.away
            name = f"${letter}{frame.subscript}$"
            if abs(away) > 0.99:
                mark, size = ("x", 5) if away > 0 else (".", 3)
                axes.plot(x, y, "o", ms=7, mfc="white", mec=BLACK, mew=0.8)
                axes.plot(x, y, mark, ms=size, color=BLACK, mew=0.8)
                hidden["away from" if away > 0 else "towards"].append(name)
            else:
                reach_m = tip_m - axis @ frame.origin_m
                tip = np.array([x, y]) + reach_m * axis[side.plane]
                axes.annotate("", tip, (x, y), arrowprops=_ARROW)
                right, down = 9 * axis[side.plane]
                axes.update_datalim([tip + 0.05 * axis[side.plane]])
                labels[(*np.round(tip, 6), *np.round([right, -down], 1))].append(name)
    for (x, y, right, up), alike in labels.items():
        _label(axes, ", ".join(alike), (x, y), (right, up))
    return "; ".join(f"{' and '.join(names)} {where} the reader" for where, names in hidden.items())


def _label(
    axes: Axes, text: str, place: tuple[float, float], offset: tuple[float, float], **style: Any
) -> None:
    """A name beside what it names, its middle offset in points."""
    style = {"ha": "center", "va": "center", "textcoords": "offset points"} | style
    axes.annotate(text, place, offset, **style)


def _dimension(axes: Axes, side: Side, geometry: Hexapod) -> None:
    """How far the nodes reach: across in the top view, from plane to plane in the front view."""
    nodes = np.vstack([geometry.bottom_m, geometry.top_m])[:, side.plane]
    (left, low), (_, high) = nodes.min(axis=0), nodes.max(axis=0)
    x, middle = left - 0.17, (low + high) / 2
    axes.annotate("", (x, low), (x, high), arrowprops=_ARROW | {"arrowstyle": "<|-|>", "lw": 0.6})
    axes.update_datalim([(x - 0.06, low), (x, high)])
    _label(axes, f"{high - low:.4f} m", (x, middle), (-6, 0), rotation="vertical")


def headline(geometry: Hexapod) -> str:
    """What the views foreshorten: strut lengths, and the angle at which two struts meet."""
    struts = geometry.top_m - geometry.bottom_m
    lengths = np.linalg.norm(struts, axis=1)
    low, high = f"{lengths.min():.4f}", f"{lengths.max():.4f}"
    angle = np.rad2deg(np.arccos(struts[0] @ struts[1] / (lengths[0] * lengths[1])))
    return (
        f"The struts are {low if low == high else f'{low} to {high}'} m long; "
        f"struts 1 and 2 meet at {angle:.1f}°."
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
        solid, body = solid_of(model, geom), model.geom_bodyid[geom]
        if solid is not None:
            world = solid.points_m @ data.xmat[body].reshape(3, 3).T + data.xpos[body]
            belongs_to = bodies.get(body, "strut")
            found.append(Part(model.geom(geom).name, belongs_to, (world - origin) @ to_base.T))
    return found


def _nominal(model: mujoco.MjModel) -> tuple[mujoco.MjData, Array, Array]:
    """The machine at its nominal pose, its payload origin, and what turns the world to the base."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    base, payload = (element_id(model, "site", name) for name in ("base", "payload"))
    return data, data.site_xpos[payload], data.site_xmat[base].reshape(3, 3).T
