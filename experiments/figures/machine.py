"""The machine with its axes, its major and its secondary motions: the README's first picture."""

import mujoco
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from experiments.recording.drawing import View, draw_at_rest
from experiments.study.palette import BLACK, BLUE, VERMILION
from experiments.study.plotting import PAGE_IN, TITLE_PT, new_figure
from sim import Array

MAJOR, SECONDARY = BLUE, VERMILION
_KEY = {
    MAJOR: "major motions: the pointing angles $\\alpha$, $\\beta$, to be tracked exactly",
    SECONDARY: "secondary motions: $\\gamma$, $t_x$, $t_y$, $t_z$, free for other goals",
}
_MOTIONS = (
    ("x", r"\alpha", MAJOR, 0.56, 0.09, (0, 0, 1), (0, 0, -1)),
    ("y", r"\beta", MAJOR, 0.80, 0.22, (-1, 0, 0), (0, 0, -1)),
    ("z", r"\gamma", SECONDARY, 0.46, 0.06, (1, 0, 0), (-1, 0, 0)),
)
"""Of each axis the rotation about it; from the payload's origin its tip and, from there back, the
ring of the rotation [m]; on which sides of the axis the translation and the ring's name stand."""
_RING_M, _SHIFT_M, _BESIDE_M = 0.04, 0.11, 0.08
_TURN = np.deg2rad(np.linspace(-200, 90, 60))
_SIGHT_M = -0.175, -0.27
"""From the detector's top along the payload's z axis."""
_NAMED = {
    "frame12": ("payload", (-0.12, 0.12), -0.26),
    "detector": ("detector", (0.20, 0.06), 0.02),
    "laser": ("laser", (0.17, -0.05), 0.01),
    "base_plate": ("base", (-0.12, -0.10), -0.38),
}
"""Parts that are named where a machine has them: the name, how far from the part, right and up, and
how far right of the part's middle its line begins [m]."""


def figure_machine(model: mujoco.MjModel) -> Figure:
    """The machine at rest; the axes begin at the payload's origin, parallel to the base's.

    Raises:
        sim.ModelError: The machine is not a hexapod.
    """
    figure, view = new_figure(PAGE_IN, 4.4), View()
    axes = figure.add_subplot(aspect="equal")
    axes.axis("off")
    draw_at_rest(axes, model, view)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    origin, turn = data.site("payload").xpos, data.site("base").xmat.reshape(3, 3)
    for k in range(3):
        _axis(axes, view, origin, turn.T, k)
    _arrow(axes, view, origin + np.outer(_SIGHT_M, turn[:, 2]), BLACK)
    _label(axes, view, origin + (_SIGHT_M[1] - 0.03) * turn[:, 2], "line of sight", BLACK)
    _names(axes, view, model, data)
    key = [Line2D([], [], color=color, label=label) for color, label in _KEY.items()]
    figure.legend(handles=key, loc="outside lower center", ncols=2, frameon=False)
    return figure


def _axis(axes: Axes, view: View, origin: Array, frame: Array, k: int) -> None:
    """One axis; around it a rotation, beside it a translation."""
    name, angle, color, reach_m, back_m, beside, named = _MOTIONS[k]
    along, second, third = np.roll(frame, -k, axis=0)
    tip, middle = origin + reach_m * along, origin + (reach_m - back_m) * along
    ring = _RING_M * (np.cos(_TURN)[:, None] * second + np.sin(_TURN)[:, None] * third)
    shift = middle + _BESIDE_M * np.array(beside) @ frame
    axes.plot(*view.on_paper(np.array([origin, tip])).T, color=BLACK, lw=0.6, ls=(0, (4, 2)))
    _arrow(axes, view, np.array([middle - 0.05 * along, tip]), BLACK)
    _arrow(axes, view, middle + ring, color)
    _arrow(axes, view, shift + np.outer([-0.5 * _SHIFT_M, 0.5 * _SHIFT_M], along), SECONDARY)
    _label(axes, view, tip + 0.03 * along, f"${name}_b$", BLACK)
    _label(axes, view, middle + 1.6 * _RING_M * np.array(named) @ frame, f"${angle}$", color)
    _label(axes, view, shift + 0.03 * np.array(beside) @ frame, f"$t_{name}$", SECONDARY)


def _names(axes: Axes, view: View, model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Names beside the machine, each with a line to its part."""
    geoms = {model.geom(k).name: k for k in range(model.ngeom)}
    for geom, (name, offset, right_m) in _NAMED.items():
        if geom in geoms:
            x, y = view.on_paper(data.geom_xpos[geoms[geom]]) + np.array([right_m, 0.0])
            line = {"arrowstyle": "-", "lw": 0.5, "shrinkA": 2, "shrinkB": 0}
            style = {"ha": "center", "va": "center", "fontsize": TITLE_PT}
            axes.annotate(name, (x, y), (x + offset[0], y + offset[1]), arrowprops=line, **style)


def _arrow(axes: Axes, view: View, path: Array, color: str) -> None:
    """A line through points in the world, with a head at its end."""
    paper = view.on_paper(path)
    axes.plot(*paper.T, color=color, lw=1.2)
    head = {"arrowstyle": "-|>", "color": color, "lw": 1.2, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", paper[-1], paper[-2], arrowprops=head)


def _label(axes: Axes, view: View, place: Array, text: str, color: str) -> None:
    x, y = view.on_paper(place)
    axes.text(x, y, text, color=color, ha="center", va="center", fontsize=TITLE_PT)
