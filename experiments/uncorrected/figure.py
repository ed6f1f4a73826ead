"""The study's figures: candidates, map and lock sweep; and spirals."""

from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from experiments.recording.plots import spiral
from experiments.rig.hexapod.simulation import Trajectory
from experiments.study.plotting import (
    BLUE,
    PAGE_IN,
    VERMILION,
    name_rows,
    new_figure,
)
from experiments.study.results import Picture
from experiments.uncorrected.candidates import BENCH, CLOCKWISE, RETUNED
from experiments.uncorrected.predicted import LOCKS_M
from experiments.uncorrected.runs import Uncorrected
from experiments.uncorrected.stability_map import ROLL_OFF_HZ

ANGLES = (("alpha", "$\\alpha$", BLUE), ("beta", "$\\beta$", VERMILION))

MARKERS = {"alpha": "o", "beta": "s"}
BAND = 0.15
"""Opacity of what lies within the tolerance."""
RATIO = "uncorrected / all struts sound"

SHOWN = {CLOCKWISE.name: "demand limit of 95 µrad", RETUNED.name: "locked 125 µm off centre"}
"""Candidates whose uncorrected spiral is drawn."""


def pictures(study: Uncorrected, summary: dict[str, Any]) -> list[Picture]:
    """The figures and their captions; that of the spirals where their candidates were run."""
    candidates = Picture(
        "uncorrected",
        "Candidate explanations of Table I's last column, beside the paper's ratios. Damping "
        "and crossover do not change the ratios; where strut 1 is locked does.",
        "Above, both ratios of each candidate beside bands of the paper's ratios: only limits "
        "on the demand, and one lock off centre, lie in both bands. Below, the ratios at every "
        "stable point of the maps, on two levels far below the band of alpha; and the ratios "
        "over the place at which strut 1 is locked, two bowls that rise into the bands.",
        partial(figure_uncorrected, study, summary),
    )
    spirals = Picture(
        "demand_limit",
        "What Fig. 5 would show of a limit on the pointing that the compensators demand, and of "
        "a lock off centre: strut 1 locked, not known to the mapping.",
        "Two uncorrected spirals: the limited one is cut off along alpha in its outer turns, the "
        "one locked off centre begins with a tail.",
        partial(figure_demand_limit, study.runs),
    )
    return [candidates, spirals] if SHOWN.keys() <= study.runs.keys() else [candidates]


def figure_uncorrected(study: Uncorrected, summary: dict[str, Any]) -> Figure:
    """Candidates, and below them both ratios over the loops and over the place of the lock."""
    figure = new_figure(PAGE_IN, 7.0)
    figure.suptitle("Strut 1 locked, mapping not reconfigured: RMS error over that of $W_a$")
    names, candidates, loops, lock = figure.subplots(2, 2, height_ratios=[1.9, 1]).flat
    names.set_axis_off()  # the room for those of the candidates
    _candidates(candidates, summary)
    _loops(loops, study)
    _lock(lock, study)
    for axes in (loops, lock):
        _bands(axes, summary, horizontal=True)
        axes.set(ylim=(0.8, 7.4), ylabel=RATIO)
    figure.legend(handles=_legend(summary), loc="outside lower center", ncols=4)
    return figure


def _legend(summary: dict[str, Any]) -> list[Line2D | Patch]:
    tolerance = f"within {100 * summary['paper']['ratio_tolerance']:.0f} % of the paper's"
    points, bands = [], []
    for name, symbol, color in ANGLES:
        printed = f"{tolerance} {summary['paper'][f'{name}_ratio']:.2f}"
        points.append(Line2D([], [], ls="", marker=MARKERS[name], color=color, label=symbol))
        bands.append(Patch(color=color, alpha=BAND, lw=0, label=f"{symbol}: {printed}"))
    return [*points, *bands]


def _candidates(axes: Axes, summary: dict[str, Any]) -> None:
    """Both ratios of every candidate; filled where the other columns stay Table I's."""
    shown = [one for one in summary["candidates"] if one["ratio"]]
    _bands(axes, summary, horizontal=False)
    for row, one in enumerate(shown):
        for (name, _, color), ratio in zip(ANGLES, one["ratio"], strict=True):
            face = color if one["meets_w_a"] and one["meets_corrected"] else "white"
            axes.plot(ratio, row, MARKERS[name], color=color, mfc=face, ms=4.5)
    mark = {True: "  ✓", False: ""}
    words = [one["what"].replace("W_a", "$W_a$") + mark[one["explains"]] for one in shown]
    name_rows(axes, words)
    axes.set_yticks(range(len(shown)), [""] * len(shown))
    axes.set(xscale="log", xlabel=RATIO, ylim=(len(shown) - 0.5, -0.5), xlim=(1, 6))
    axes.set_xticks([1, 1.5, 2, 3, 4, 6], ["1", "1.5", "2", "3", "4", "6"])
    axes.minorticks_off()
    axes.set_title("✓ meets all of Table I\nhollow: $W_a$, $W_d$ or $W_e$ is off")


def _loops(axes: Axes, study: Uncorrected) -> None:
    """Ratios at the stable points of the map over damping, crossover and roll-off."""
    sound, uncorrected = study.map_rad[..., 0, :], study.map_rad[..., 1, :]
    stable = np.isfinite(sound) & np.isfinite(uncorrected)
    ratio = np.divide(uncorrected, sound, out=np.full(sound.shape, np.nan), where=stable)
    crossover_hz = np.broadcast_to(study.grid.alpha_crossover_hz, ratio.shape[:-1])
    for k, (name, _, color) in enumerate(ANGLES):
        axes.plot(crossover_hz.ravel(), ratio[..., k].ravel(), MARKERS[name], color=color, ms=2.5)
    low, high = study.grid.damping_ratio[[0, -1]]
    axes.set(xscale="log", xlabel="crossover of the $\\alpha$ loop, Hz")
    axes.set_xticks([3, 5, 10, 20], ["3", "5", "10", "20"])
    axes.minorticks_off()
    axes.set_title(
        f"Stable loops, damping ratio {low:g} to {high:g},\nroll-off "
        f"{' or '.join(f'{hz:g}' for hz in ROLL_OFF_HZ)} Hz"
    )


def _lock(axes: Axes, study: Uncorrected) -> None:
    """Ratios over where strut 1 is stuck, the spiral starting at once."""
    styles = {BENCH.name: ("-", "loops of the testbed"), RETUNED.name: ("--", "loops retuned")}
    for name, ratio in study.lock_ratio.items():
        style, label = styles[name]
        for k, (_, symbol, color) in enumerate(ANGLES):
            axes.plot(1e6 * LOCKS_M, ratio[:, k], style, color=color, label=f"{symbol}, {label}")
    axes.set(xlabel="displacement at which strut 1 is locked, µm")
    axes.set_title("Locked off centre, spiral at once")
    axes.legend(loc="upper center")


def _bands(axes: Axes, summary: dict[str, Any], *, horizontal: bool) -> None:
    tolerance = summary["paper"]["ratio_tolerance"]
    for name, _, color in ANGLES:
        middle = summary["paper"][f"{name}_ratio"]
        span = axes.axhspan if horizontal else axes.axvspan
        span(middle * (1 - tolerance), middle * (1 + tolerance), color=color, alpha=BAND, lw=0)


def figure_demand_limit(runs: dict[str, dict[str, Trajectory | float]]) -> Figure:
    """What Fig. 5 would show of a limit on the demand, and of a lock off centre."""
    figure = new_figure(PAGE_IN, 3.8)
    for axes, (name, title) in zip(figure.subplots(1, 2), SHOWN.items(), strict=True):
        run = runs[name]["W_a_uncorrected"]
        if isinstance(run, Trajectory):
            spiral(axes, run, title)
    return figure
