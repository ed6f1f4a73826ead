"""Figures of the study of the Jacobian."""

from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from experiments.jacobian.variation import NORMS, VERTICES, relative_change
from experiments.rig.hexapod import paper
from experiments.study.plotting import (
    BLACK,
    BLUE,
    GREEN,
    ORANGE,
    PAGE_IN,
    PURPLE,
    VERMILION,
    new_figure,
)
from experiments.study.results import Picture
from sim import Hexapod, hexapod, load_model


def pictures(summary: dict[str, Any]) -> list[Picture]:
    """The figure of eq. (40), and with the closed-loop runs one of these."""
    caption = "How far the Jacobian departs from its nominal value over the stroke."
    alt = (
        "Left: the change in both norms at the 64 corners of the box of strut lengths, below the "
        "certified bounds and mostly above the paper's values. Right: 2-norm against Frobenius "
        "norm for every reading of eq. (40) that was tried, and the paper's pair."
    )
    draw = partial(figure_variation, hexapod(load_model()), summary)
    found = [Picture("jacobian", caption, alt, draw)]
    if loop := summary.get("loop"):
        alt = (
            "Distance from the optimum of the secondary goal over eq. (40) of the lengths visited, "
            "and of the box: a straight line for the constant Jacobian by geometry; of four forms "
            "of the mapping only the Gauss-Newton step stays at the floor; the loop gain."
        )
        caption = "What a constant Jacobian costs as spiral and stroke grow."
        found.append(Picture("jacobian_loop", caption, alt, partial(figure_loop, loop)))
    return found


def figure_variation(geometry: Hexapod, summary: dict[str, Any]) -> Figure:
    """E at the corners of the box, its certificate, and the search for the paper's numbers."""
    figure = new_figure(PAGE_IN, 3.8)
    figure.suptitle("Eq. (40): how far the Jacobian departs from the nominal one")
    left, right = figure.subplots(1, 2)
    _corners(left, geometry, summary)
    _search(right, summary)
    return figure


def _corners(axes: Axes, geometry: Hexapod, summary: dict[str, Any]) -> None:
    corners_m = summary["stroke_m"] * VERTICES
    names = ("Frobenius", BLUE), ("2-norm", VERMILION)
    for norm, (label, color) in zip(NORMS, names, strict=True):
        one = summary["variation"][norm]
        e = np.sort(relative_change(geometry, corners_m, norm))
        axes.plot(np.arange(1, 65), 1e3 * e, ".", color=color, label=f"{label}, at the corners")
        bound = 1e3 * one["certified_upper_bound"]
        axes.axhline(bound, color=color, lw=1, label=f"{label}, certified bound")
        axes.axhline(1e3 * one["paper"], color=color, lw=1, ls=":", label=f"{label}, paper")
    axes.set(xlabel="64 corners of the box of strut lengths, sorted", ylabel="$e$, $10^{-3}$")
    axes.set(ylim=(0, 4.7), title="change of the Jacobian at the corners")
    axes.legend(ncols=2, loc="upper left")


def _search(axes: Axes, summary: dict[str, Any]) -> None:
    """All readings in one plane, and the surroundings of the paper's values enlarged."""
    enlarged = axes.inset_axes((0.56, 0.07, 0.41, 0.27), xlim=(0.95, 1.5), ylim=(1.4, 2.15))
    half = 1e3 * paper.JACOBIAN_VARIATION_TOLERANCE
    printed = [1e3 * paper.JACOBIAN_VARIATION[norm] for norm in NORMS]
    corner = printed[0] - half, printed[1] - half
    square = {"fc": "white", "ec": BLACK, "lw": 1.2, "zorder": 2.5}
    for each in (axes, enlarged):
        _readings(each, summary["tried"])
        each.add_patch(Rectangle(corner, 2 * half, 2 * half, **square))
    axes.plot(
        [],
        [],
        "s",
        ms=5,
        mfc="white",
        color=BLACK,
        mew=1.2,
        label="the paper's, with their rounding",
    )
    enlarged.set_xticks([1.0, 1.2, 1.4])
    enlarged.set_yticks([1.4, 1.6, 1.8, 2.0])
    axes.indicate_inset_zoom(enlarged, edgecolor=BLACK, lw=0.6)
    axes.plot([], [], "o", color=BLUE, mfc="white", label="another reading")
    axes.plot([], [], "o-", color=GREEN, lw=0.6, mfc="white", label="would fit with another stroke")
    axes.set(xlabel="$e$, Frobenius norm, $10^{-3}$", ylabel="$e$, 2-norm, $10^{-3}$")
    axes.set(xlim=(0, 4.2), ylim=(0, 7.5), title="readings of eq. (40)")
    axes.legend(loc="upper left")


def _readings(axes: Axes, tried: list[dict[str, Any]]) -> None:
    """Each reading; with a line where a part of the stroke would give the paper's two numbers."""
    for one in tried:
        fits = one["stroke_fraction"] is not None
        e = [1e3 * one[norm] for norm in NORMS]
        if fits:
            ray = [0, e[0]], [0, e[1]]
            axes.plot(*ray, "o-", color=GREEN, lw=0.6, mfc="white", markevery=[1])
        else:
            axes.plot(*e, "o", color=BLUE, mfc="white")
        if one["is_the_papers"]:
            axes.plot(*e, "*", ms=7, color=VERMILION, mew=0, zorder=4, label=one["reading"])


def figure_loop(loop: dict[str, Any]) -> Figure:
    """What a constant Jacobian costs, against e of the visited set and e of the box."""
    figure = new_figure(PAGE_IN, 4.0)
    figure.suptitle(
        "Cost of a constant Jacobian: strut 1 locked, $W_e$, spiral and stroke enlarged"
    )
    left, right = figure.subplots(1, 2, sharey=True)
    together = [one for one in loop["growth"] if one["stroke_factor"] == one["spiral_factor"]]
    for axes, growth, key in ((left, loop["growth"], "e_visited"), (right, together, "e_box")):
        e = [one[key]["frobenius"] for one in growth]
        _costs(axes, growth, e)
        axes.set_xlim(e[0] / 2, 4 * e[-1])  # room for what the marks say
    for cost in loop["costs"]:
        _mark(left, cost, cost["e_visited_frobenius"])
        if cost["e_box"] and cost["e_box"]["frobenius"] <= together[-1]["e_box"]["frobenius"]:
            _mark(right, cost, cost["e_box"]["frobenius"])
    left.plot([], [], "D", color=BLACK, mfc="none", ms=4.5, label="1 and 10 %, size of the spiral")
    left.set(xlabel="$e$ of the lengths visited, Frobenius norm", ylabel="cost, %")
    left.set(title="both enlarged alike, then the spiral alone", ylim=(1e-3, 1e3))
    right.set(xlabel="$e$ of the stroke, Frobenius norm", title="both enlarged alike")
    figure.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


_COST_COLORS = {"static_extra_percent": BLUE, "loop_gain_error_percent": PURPLE}


def _mark(axes: Axes, cost: dict[str, Any], e: float) -> None:
    """Where the constant Jacobian begins to cost so much."""
    color = _COST_COLORS[cost["cost"]]
    axes.plot(e, cost["percent"], "D", color=color, ms=4.5, zorder=4)
    goal = cost["cost"] == "static_extra_percent"
    axes.annotate(
        f"$\\times${cost['spiral_factor']:.0f}",
        (e, cost["percent"]),
        (4, 13) if goal else (5, -9),
        textcoords="offset points",
        ha="right" if goal else "left",
        color=color,
    )


def _costs(axes: Axes, growth: list[dict[str, Any]], e: list[float]) -> None:
    styles = {
        "constant": (BLUE, "o", "constant J"),
        "analytic": (VERMILION, "x", "J of each tick"),
        "incremental": (ORANGE, "^", "increments"),
        "relinearized": (GREEN, "s-", "Gauss-Newton step: the floor"),
    }
    static = [one["static_extra_percent"] for one in growth]
    axes.loglog(e, static, color=BLUE, lw=1, label="secondary goal: constant J, by geometry alone")
    for variant, (color, marker, name) in styles.items():
        extra = [one["variants"][variant]["extra_percent"] for one in growth]
        label = f"secondary goal: {name}"
        axes.loglog(e, extra, marker, color=color, mfc="none", lw=0.6, label=label)
    gain = [one["loop_gain_error_percent"] for one in growth]
    axes.loglog(e, gain, color=PURPLE, ls="--", label="loop gain: constant J")
    pointing = [abs(one["variants"]["constant"]["pointing_cost_percent"]) for one in growth]
    axes.loglog(e, pointing, ".", color=BLACK, label="pointing RMS: constant J, magnitude")
