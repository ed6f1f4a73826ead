"""Figures of the study of the Jacobian."""

from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from experiments.jacobian.variation import NORMS, VERTICES, relative_change
from experiments.rig.hexapod import paper
from experiments.study.palette import BLACK, BLUE, GREEN, ORANGE, VERMILION
from experiments.study.plotting import COLUMN_IN, PAGE_IN, logarithmic, new_figure, one_legend
from experiments.study.results import Picture
from sim import Hexapod, hexapod, load_model

_OURS: dict[str, Any] = {"color": BLUE, "label": "computed: 64 corners, and readings"}
_PAPER: dict[str, Any] = {"color": VERMILION, "alpha": 0.6, "label": "the paper, with its rounding"}


def pictures(summary: dict[str, Any]) -> list[Picture]:
    """The figure of eq. (40), and with the closed-loop runs one of these."""
    caption = (
        "How far the Jacobian departs from its nominal value over the stroke, eq. (40): at the "
        "corners of the box of strut lengths, and in all readings of the equation that were tried."
    )
    alt = (
        "Left: the change in both norms at the 64 corners, up to the proven bounds and mostly "
        "above the paper's values. Right: 2-norm against Frobenius norm of each reading of eq. "
        "(40); one lies within the paper's pair."
    )
    draw = partial(figure_variation, hexapod(load_model()), summary)
    found = [Picture("jacobian", caption, alt, draw)]
    if loop := summary.get("loop"):
        alt = (
            "Deviation of the secondary motion from its optimum over the size of the spiral: "
            "it rises for increments, to a seventh of that for a constant and for a re-evaluated "
            "Jacobian alike, and stays at one percent for the Gauss-Newton step."
        )
        caption = (
            "Strut 1 locked, weights of W_e. Marks are simulated, the line is of the constant "
            "Jacobian by geometry alone. Beyond 100 times the spiral grows alone, the stroke not."
        )
        found.append(Picture("jacobian_loop", caption, alt, partial(figure_loop, loop)))
    return found


def figure_variation(geometry: Hexapod, summary: dict[str, Any]) -> Figure:
    """E at the corners of the box, its certificate, and the search for the paper's numbers."""
    figure = new_figure(PAGE_IN, 3.2)
    left, right = figure.subplots(1, 2)
    _corners(left, geometry, summary)
    _readings(right, summary["tried"])
    one_legend(figure, 4)
    return figure


def _corners(axes: Axes, geometry: Hexapod, summary: dict[str, Any]) -> None:
    """A row for each norm, in percent."""
    corners_m = summary["stroke_m"] * VERTICES
    half = 100 * paper.JACOBIAN_VARIATION_TOLERANCE
    bounds = []
    for row, norm in enumerate(NORMS):
        e = 100 * relative_change(geometry, corners_m, norm)
        bounds.append(100 * summary["variation"][norm]["certified_upper_bound"])
        axes.plot(e, np.full(64, row), "o", mfc="none", **_OURS)
        bound = {"color": BLACK, "ms": 16, "mew": 1.5, "label": "proven upper bound"}
        axes.plot(bounds[-1], row, "|", **bound)
        low = 100 * paper.JACOBIAN_VARIATION[norm] - half
        axes.add_patch(Rectangle((low, row - 0.2), 2 * half, 0.4, lw=0, **_PAPER))
    # A bound is rounded up.
    most = np.ceil(1e3 * max(bounds)) / 1e3
    axes.set_title(f"The Jacobian changes by at most {most:.3f} %\nover the stroke: proven")
    axes.set_yticks(range(len(NORMS)), ["Frobenius\nnorm", "2-norm"])
    axes.set(xlabel="change of the Jacobian, eq. (40), %", ylim=(1.6, -0.6))
    axes.set_xlim(0, 1.05 * max(bounds))


def _readings(axes: Axes, tried: list[dict[str, Any]]) -> None:
    """All readings in one plane, and the paper's pair."""
    half = 100 * paper.JACOBIAN_VARIATION_TOLERANCE
    corner = [100 * paper.JACOBIAN_VARIATION[norm] - half for norm in NORMS]
    axes.add_patch(Rectangle((corner[0], corner[1]), 2 * half, 2 * half, lw=0, **_PAPER))
    for one in tried:
        axes.plot(*(100 * one[norm] for norm in NORMS), "o", mfc="none", **_OURS)
    ours = [one["reading"].split("; ")[-1] for one in tried if one["is_the_papers"]]
    axes.set_title(
        f"The paper's pair results from {len(ours)} of {len(tried)} readings:\n{' and '.join(ours)}"
    )
    axes.set(xlabel="Frobenius norm, %", ylabel="2-norm, %")
    axes.set(xscale="log", yscale="log")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_ticks([0.1, 0.2, 0.3, 0.4, 0.6], ["0.1", "0.2", "0.3", "0.4", "0.6"])
    axes.minorticks_off()


def figure_loop(loop: dict[str, Any]) -> Figure:
    """What each form of the mapping costs the secondary goal, over the size of the spiral."""
    figure = new_figure(COLUMN_IN, 3.5)
    axes = figure.subplots()
    size = [one["spiral_factor"] for one in loop["growth"]]
    static = [one["static_extra_percent"] for one in loop["growth"]]
    axes.plot(size, static, color=BLUE, label="constant Jacobian: geometry alone")
    for variant, color, marker, label in (
        ("incremental", ORANGE, "^", "increments"),
        ("analytic", VERMILION, "x", "Jacobian of each tick"),
        ("constant", BLUE, "o", "constant Jacobian"),
        ("relinearized", GREEN, "s-", "Gauss-Newton step"),
    ):
        extra = [one["variants"][variant]["extra_percent"] for one in loop["growth"]]
        axes.plot(size, extra, marker, color=color, mfc="none", label=label)
    costs = [cost for cost in loop["costs"] if cost["cost"] == "static_extra_percent"]
    sizes, percents = ([at[key] for at in costs] for key in ("spiral_factor", "percent"))
    axes.plot(sizes, percents, "D", color=BLACK, label="1 and 10 % by geometry")
    reached = ",\n".join(f"{at['percent']:g} % at {at['spiral_factor']:.0f} times" for at in costs)
    axes.set_title(f"A constant Jacobian costs {reached} the spiral of Table I")
    axes.set(xlabel="size of the spiral, 1: that of Table I")
    axes.set(ylabel="secondary goal: deviation from optimum, %")
    logarithmic(axes, "xy")
    one_legend(figure, 2)
    return figure
