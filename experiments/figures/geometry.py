"""Figure 2 of the paper: top view and front view of the hexapod, drawn from its MJCF."""

from collections import defaultdict
from typing import Any

import mujoco
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from experiments.figures.outline import FRONT, TOP, Frame, Part, Side, frames, parts
from experiments.output.plotting import BLACK, BLUE, GREEN, PAGE_IN, PURPLE, VERMILION, new_figure
from sim import Array, Hexapod, hexapod

NAMED = {"laser": (-52, 14), "telescope": (-62, 42), "detector": (24, 3), "base_plate": (30, -18)}
"""Parts that are named where a machine has them, and where their names stand, in points."""
_AXIS_M = 0.1
_ARROW = {"arrowstyle": "-|>", "lw": 1, "color": BLACK, "shrinkA": 0, "shrinkB": 0}
_PAPER = {"fc": "white", "alpha": 0.8, "lw": 0, "pad": 0.5}
_FILL = {"base": "0.95", "payload": "0.88", "strut": "0.75"}


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
    x = left - 0.075
    style = _ARROW | {"arrowstyle": "<|-|>", "lw": 0.6}
    axes.annotate("", (x, low), (x, high), arrowprops=style)
    size = f"{high - low:.4f} m"
    middle = (x, (low + high) / 2)
    _label(axes, size, middle, (-2, 0), rotation="vertical", ha="right", va="center")


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
