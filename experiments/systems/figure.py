"""The figure of `fjh systems`: each mechanism's major task in every condition."""

from functools import partial
from itertools import cycle

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from experiments.study.palette import BLACK, LINES
from experiments.study.plotting import PAGE_IN, new_figure
from experiments.study.results import Picture
from experiments.systems.probe import CORNERS
from experiments.systems.runs import Mechanism, Probing, Systems
from sim import Array

_REST_PT, _WAY_PT = (3.4, 0.8), 0.4
"""Widths of lines: at rest, from the first condition to the last so that lines upon each other all
show; and on the way."""

_LEGEND = (
    Line2D([], [], color=BLACK, marker="o", ls="", ms=3, label="commanded corners"),
    Line2D([], [], color=BLACK, lw=2, label="simulated: at rest at each corner, joined"),
    Line2D([], [], color=BLACK, lw=2, ls="--", label="the same, task lost as classified"),
    Line2D([], [], color=BLACK, lw=_WAY_PT, label="simulated: on the way; whiskers: overshoot"),
)


def pictures(systems: Systems) -> list[Picture]:
    """The study's figure and its caption."""
    caption = (
        "Each mechanism's major task around an octagon, sound and failed, in simulation. Each "
        "corner is commanded as a step, so that the task overshoots it before it comes to rest "
        "(thin lines). The runs end at the eighth corner: the last side has no thin lines."
    )
    alt = (
        "A panel for each mechanism: at rest its task is at every corner of the octagon, but for "
        "the dashed lines, whose task is lost as classified."
    )
    return [Picture("systems", caption, alt, partial(figure_systems, systems))]


def figure_systems(systems: Systems) -> Figure:
    """Each mechanism's major task around a polygon, in every condition."""
    examined = systems.examinations
    rows = -(-len(examined) // 2)
    figure = new_figure(PAGE_IN, 2.6 * rows + 0.4)
    figure.suptitle("Major task around an octagon, sound and with failed actuators, simulated")
    panels = list(figure.subplots(rows, 2, squeeze=False).flat)
    for axes, (mechanism, ours) in zip(panels, examined.items(), strict=False):
        _polygons(axes, mechanism, ours)
    for axes in panels[len(examined) :]:
        axes.remove()
    figure.legend(handles=_LEGEND, loc="outside lower center", ncols=2)
    return figure


def _polygons(axes: Axes, mechanism: Mechanism, ours: list[Probing]) -> None:
    widths = np.linspace(*_REST_PT, len(ours))
    for one, color, width in zip(ours, cycle(LINES), widths, strict=False):
        style = "--" if one.report.unstable_major or one.report.unmanipulable else "-"
        at_rest, on_the_way = (1e6 * points.T for points in _around(one.polygon.reached))
        axes.plot(*at_rest, style, color=color, lw=width, label=one.in_words)
        axes.plot(*on_the_way, style, color=color, lw=_WAY_PT)
    corners, _ = _around(ours[0].polygon.desired)
    axes.plot(*1e6 * corners.T, "o", color=BLACK, ms=3)
    first, second = (f"{name}, µ{mechanism.major_unit}" for name in mechanism.major_names[:2])
    axes.set(title=mechanism.title, xlabel=first, ylabel=second)
    axes.set_aspect("equal", adjustable="datalim")
    axes.legend(title="failed actuators", loc="upper left", bbox_to_anchor=(1.0, 1.0))


def _around(path: Array) -> tuple[Array, Array]:
    """Where each corner's time ends, closed, (CORNERS + 1, 2); the way from the first of them."""
    also = 2 * (path.shape[1] - 2)  # corners aside, along further major directions
    held = len(path) // (CORNERS + also)
    octagon = path[held - 1 : CORNERS * held, :2]
    return np.vstack([octagon[::held], octagon[:1]]), octagon
