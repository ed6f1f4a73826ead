"""Figures of the study of the Jacobian."""

from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from experiments.hexapod import paper
from experiments.jacobian.variation import NORMS, VERTICES, relative_change
from experiments.output.plotting import (
    BLACK,
    BLUE,
    GREEN,
    ORANGE,
    PAGE_IN,
    PURPLE,
    VERMILION,
    new_figure,
)
from experiments.output.results import Picture
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
    figure = new_figure(PAGE_IN, 3.3)
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
    axes.set(xlabel="64 corners of the box of strut lengths, sorted", ylabel="e, 1e-3")
    axes.set_ylim(0, 4.6)
    axes.legend(ncols=2, loc="upper left")


def _search(axes: Axes, summary: dict[str, Any]) -> None:
    for one in summary["tried"]:
        fits = one["stroke_fraction"] is not None
        e = [1e3 * one[norm] for norm in NORMS]
        axes.plot(*e, "o", ms=3.5, color=GREEN if fits else BLUE, mfc="none")
        if fits:
            axes.plot([0, e[0]], [0, e[1]], color=GREEN, lw=0.6)
        if one["is_the_papers"]:
            axes.plot(*e, "*", ms=8, color=VERMILION, mec="white", zorder=4, label=one["reading"])
    half = 1e3 * paper.JACOBIAN_VARIATION_TOLERANCE
    corner = [1e3 * paper.JACOBIAN_VARIATION[norm] - half for norm in NORMS]
    axes.add_patch(Rectangle((corner[0], corner[1]), 2 * half, 2 * half, color=BLACK, zorder=3))
    axes.plot([], [], "s", color=BLACK, label="paper, with its rounding")
    axes.plot([], [], "o", color=BLUE, mfc="none", label="a reading of (40)")
    axes.plot([], [], "o-", color=GREEN, mfc="none", label="fits on a part of the stroke or more")
    axes.set(xlabel="e, Frobenius norm, 1e-3", ylabel="e, 2-norm, 1e-3", xlim=(0, 4.2))
    axes.set_ylim(0, 6)
    axes.legend(loc="upper left")


def figure_loop(loop: dict[str, Any]) -> Figure:
    """What a constant Jacobian costs, against e of the visited set and e of the box."""
    figure = new_figure(PAGE_IN, 3.9)
    figure.suptitle("When eq. (40) may be trusted: strut 1 locked, $W_e$, spiral and stroke grown")
    left, right = figure.subplots(1, 2, sharey=True)
    together = [one for one in loop["growth"] if one["stroke_factor"] == one["spiral_factor"]]
    for axes, growth, key in ((left, loop["growth"], "e_visited"), (right, together, "e_box")):
        _costs(axes, growth, [one[key]["frobenius"] for one in growth])
    for cost in loop["costs"]:
        _mark(left, cost, cost["e_visited_frobenius"])
        if cost["e_box"] is not None:
            _mark(right, cost, cost["e_box"]["frobenius"])
    left.set(xlabel="e of the visited set, Frobenius norm", ylabel="off by, %", ylim=(1e-3, 1e3))
    left.set_title("stroke and spiral alike, then the spiral alone")
    right.set(xlabel="e of the box, Frobenius norm", title="stroke and spiral alike")
    figure.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return figure


_COST_COLORS = {"static_extra_percent": BLUE, "loop_gain_error_percent": PURPLE}


def _mark(axes: Axes, cost: dict[str, Any], e: float) -> None:
    """Where the constant Jacobian begins to cost so much."""
    color = _COST_COLORS[cost["cost"]]
    axes.plot(e, cost["percent"], "D", color=color, ms=4.5, zorder=4)
    goal = cost["cost"] == "static_extra_percent"
    axes.annotate(
        f"spiral x{cost['spiral_factor']:.0f}",
        (e, cost["percent"]),
        (-6, 8) if goal else (6, -14),
        textcoords="offset points",
        ha="right" if goal else "left",
        color=color,
    )


def _costs(axes: Axes, growth: list[dict[str, Any]], e: list[float]) -> None:
    styles = {
        "constant": (BLUE, "o"),
        "analytic": (VERMILION, "x"),
        "incremental": (ORANGE, "^"),
        "relinearized": (GREEN, "s-"),
    }
    static = [one["static_extra_percent"] for one in growth]
    axes.loglog(e, static, color=BLUE, lw=1, label="goal, constant J, geometry alone")
    for variant, (color, marker) in styles.items():
        extra = [one["variants"][variant]["extra_percent"] for one in growth]
        label = f"goal, {variant}" + (": the floor" if variant == "relinearized" else "")
        axes.loglog(e, extra, marker, color=color, mfc="none", lw=0.6, label=label)
    gain = [one["loop_gain_error_percent"] for one in growth]
    axes.loglog(e, gain, color=PURPLE, ls="--", label="loop gain, constant J")
    pointing = [abs(one["variants"]["constant"]["pointing_cost_percent"]) for one in growth]
    axes.loglog(e, pointing, ".", color=BLACK, label="pointing RMS, constant J")
