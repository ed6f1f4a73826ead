"""The study's figures: maps, lock sweep, candidates and spirals; and the demand limit."""

from functools import partial
from itertools import product
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle

from experiments.hexapod.plots import spiral
from experiments.hexapod.simulation import Trajectory
from experiments.output.plotting import (
    BLACK,
    BLUE,
    COLOR_MAP,
    GREEN,
    PAGE_IN,
    PURPLE,
    VERMILION,
    new_figure,
)
from experiments.output.results import Picture
from experiments.uncorrected.candidates import BENCH, BENCH_DAMPING, CLOCKWISE, COLUMNS, RETUNED
from experiments.uncorrected.predicted import LOCKS_M
from experiments.uncorrected.runs import Uncorrected
from experiments.uncorrected.stability_map import ROLL_OFF_HZ
from sim import Array

ANGLES = (("alpha", "$\\alpha$", BLUE), ("beta", "$\\beta$", VERMILION))

SPIRALS = {
    (1.0, 1): (BLUE, "the bench's"),
    (1.0, -1): (VERMILION, "clockwise"),
    (0.5, 1): (GREEN, "constant speed"),
    (0.5, -1): (PURPLE, "constant speed, clockwise"),
}
"""Colour and name of each spiral of the map by exponent and direction."""


def pictures(study: Uncorrected, summary: dict[str, Any]) -> list[Picture]:
    """Both figures and their captions."""
    return [
        Picture(
            "uncorrected",
            "Candidate explanations of Table I's last column, beside the paper's ratios.",
            "Maps of both ratios over damping and crossover, hatched where a loop is unstable; "
            "ratios over the place at which strut 1 is locked; candidates beside bands of the "
            "paper's ratios; two uncorrected spirals.",
            partial(figure_uncorrected, study, summary),
        ),
        Picture(
            "demand_limit",
            "A limit on the pointing that the compensators demand explains the last column.",
            "Ratio of alpha and of beta over the limit, a line for each spiral, beside a band of "
            "the paper's. Two uncorrected spirals: the limited one is cut off along alpha in its "
            "outer turns, the one locked off centre begins with a tail.",
            partial(figure_demand_limit, study, summary),
        ),
    ]


def figure_uncorrected(study: Uncorrected, summary: dict[str, Any]) -> Figure:
    """Map of both ratios, ratios over the place of the lock, candidates, two spirals."""
    figure = new_figure(PAGE_IN, 9.6)
    figure.suptitle(
        "Strut 1 locked, mapping not reconfigured: RMS error over that with all struts sound.\n"
        "Shaded: within 15 % of the paper's 4.01 ($\\alpha$) and 1.55 ($\\beta$)"
    )
    grid = figure.add_gridspec(4, 4, height_ratios=[1, 1, 1.45, 1.45])
    for k, roll_off_hz in enumerate(ROLL_OFF_HZ):
        for j, (_, symbol, _) in enumerate(ANGLES):
            axes = figure.add_subplot(grid[k, 2 * j : 2 * j + 2])
            _map(axes, study, k, j)
            axes.set_title(f"{symbol} ratio, roll-off at {roll_off_hz:g} Hz")
    _lock(figure.add_subplot(grid[2, 0:2]), study, summary)
    _candidates(figure.add_subplot(grid[2, 2:4]), summary)
    for column, name in ((slice(0, 2), BENCH.name), (slice(2, 4), summary["best"])):
        title = f"{name.replace('_', ' ')}, $W_a$ uncorrected"
        _spiral(figure.add_subplot(grid[3, column]), study, name, title)
    return figure


def _map(axes: Axes, study: Uncorrected, roll_off: int, angle: int) -> None:
    """Ratio in colour; hatched where a loop is unstable."""
    x, y = _edges(study.grid.alpha_crossover_hz), _edges(study.grid.damping_ratio)
    sound, uncorrected = (study.map_rad[roll_off, :, :, k, angle] for k in (0, 1))
    both = np.isfinite(sound) & np.isfinite(uncorrected)
    ratio = np.divide(uncorrected, sound, out=np.full(sound.shape, np.nan), where=both)
    mesh = axes.pcolormesh(x, y, np.ma.masked_invalid(ratio), cmap=COLOR_MAP, vmin=1.1, vmax=1.4)
    assert axes.figure is not None
    axes.figure.colorbar(mesh, ax=axes, label="uncorrected / sound")
    stable = study.map_poles[roll_off] < 1
    _hatch(axes, x, y, ~stable[..., COLUMNS.index("W_a")], "xxx")
    corrected = stable[..., COLUMNS.index("W_d")] & stable[..., COLUMNS.index("W_e")]
    _hatch(axes, x, y, ~corrected, "...")
    axes.set(xscale="log", yscale="log", xlabel="alpha crossover, Hz", ylabel="damping ratio")
    axes.grid(False)
    axes.set_xticks([3, 5, 10, 20], ["3", "5", "10", "20"])
    axes.minorticks_off()
    axes.plot(BENCH.bench.alpha_crossover_hz, BENCH_DAMPING, "*", ms=8, mfc="white", mec=BLACK)
    if roll_off == 0 and angle == 0:
        axes.legend(handles=_map_legend(), loc="lower left", framealpha=1)


def _hatch(axes: Axes, x: Array, y: Array, where: Array, hatch: str) -> None:
    for row, column in np.argwhere(where):
        left, right = map(float, x[column : column + 2])
        low, high = map(float, y[row : row + 2])
        cell = Rectangle((left, low), right - left, high - low, fill=False, lw=0, hatch=hatch)
        axes.add_patch(cell)


def _edges(centres: Array) -> Array:
    """Borders of cells around evenly spaced logarithms, one more than centres."""
    step = np.sqrt(centres[1] / centres[0])
    return np.append(centres / step, centres[-1] * step)


def _map_legend() -> list[Any]:
    hatched = [("xxx", "sound loop unstable"), ("...", "$W_d$ or $W_e$ unstable")]
    patches = [Patch(fc="white", ec=BLACK, hatch=hatch, label=text) for hatch, text in hatched]
    star = Line2D([], [], marker="*", ls="", ms=7, mfc="white", mec=BLACK, label="the bench")
    blank = Patch(fc="white", ec=BLACK, label="white: uncorrected loop unstable")
    return [star, *patches, blank]


def _lock(axes: Axes, study: Uncorrected, summary: dict[str, Any]) -> None:
    """Ratios over where strut 1 is stuck, the spiral starting at once."""
    _bands(axes, summary, horizontal=True)
    loops = {BENCH.name: ("-", "loops of the bench"), RETUNED.name: ("--", "loops retuned")}
    for name, ratio in study.lock_ratio.items():
        style, label = loops[name]
        for k, (_, symbol, color) in enumerate(ANGLES):
            axes.plot(1e6 * LOCKS_M, ratio[:, k], style, color=color, label=f"{symbol}, {label}")
    axes.set(xlabel="strut 1 locked at, µm", ylabel="uncorrected / sound", ylim=(0.8, 6))
    axes.set_title("Locked off centre, spiral at once")
    axes.legend(loc="upper center")


def _candidates(axes: Axes, summary: dict[str, Any]) -> None:
    """Both ratios of every candidate; filled where the other columns stay Table I's."""
    shown = [one for one in summary["candidates"] if one["ratio"]]
    _bands(axes, summary, horizontal=False)
    for row, one in enumerate(shown):
        for k, (_, _, color) in enumerate(ANGLES):
            face = color if one["meets_w_a"] and one["meets_corrected"] else "white"
            axes.plot(one["ratio"][k], row, "os"[k], color=color, mfc=face, ms=4)
    axes.set_yticks(range(len(shown)), [one["name"].replace("_", " ") for one in shown])
    axes.set(xscale="log", xlabel="uncorrected / sound", ylim=(len(shown) - 0.5, -0.5))
    axes.set_xticks([1, 1.5, 2, 3, 4, 6], ["1", "1.5", "2", "3", "4", "6"])
    axes.minorticks_off()
    axes.set_title("Candidates; hollow: misses $W_a$, $W_d$ or $W_e$")
    for k, (_, symbol, color) in enumerate(ANGLES):
        axes.plot([], [], "os"[k], color=color, label=symbol)
    axes.legend()


def _bands(axes: Axes, summary: dict[str, Any], *, horizontal: bool) -> None:
    tolerance = summary["paper"]["ratio_tolerance"]
    for name, _, color in ANGLES:
        middle = summary["paper"][f"{name}_ratio"]
        span = axes.axhspan if horizontal else axes.axvspan
        span(middle * (1 - tolerance), middle * (1 + tolerance), color=color, alpha=0.15, lw=0)


def figure_demand_limit(study: Uncorrected, summary: dict[str, Any]) -> Figure:
    """Both ratios over the limit, and what Fig. 5 would show of it and of a lock off centre."""
    figure = new_figure(PAGE_IN, 6.8)
    figure.suptitle(
        "Strut 1 locked, not known to the mapping, and a limit on the pointing that the "
        "compensators demand.\nShaded: within 15 % of the paper's 4.01 ($\\alpha$) and 1.55 "
        "($\\beta$)"
    )
    grid = figure.subplots(2, 2, height_ratios=[1, 1.3])
    for k, (name, symbol, _) in enumerate(ANGLES):
        axes, printed = grid[0, k], summary["paper"][f"{name}_ratio"]
        _over_limit(axes, study, k)
        axes.axhspan(0.85 * printed, 1.15 * printed, color=BLACK, alpha=0.1, lw=0)
        axes.set(title=f"{symbol}: RMS error over that of the sound machine")
    shown = {CLOCKWISE.name: "demand limit of 95 µrad", RETUNED.name: "locked 125 µm off centre"}
    for axes, (name, title) in zip(grid[1], shown.items(), strict=True):
        _spiral(axes, study, name, title)
    return figure


def _spiral(axes: Axes, study: Uncorrected, name: str, title: str) -> None:
    """The uncorrected run of a candidate, if there is one."""
    run = study.runs.get(name, {}).get("W_a_uncorrected")
    if isinstance(run, Trajectory):
        spiral(axes, run, title)
    else:
        axes.set_axis_off()


def _over_limit(axes: Axes, study: Uncorrected, angle: int) -> None:
    """One line a spiral that starts along alpha; dashed with anti-windup."""
    grid = study.limit_grid
    ratio = study.limit_rad[..., -1, angle] / study.limit_rad[..., 0, angle]
    spirals = product(grid.exponent, grid.direction)
    for lines, spiral_of in zip(ratio[:, :, 0].reshape(-1, *ratio.shape[3:]), spirals, strict=True):
        color, label = SPIRALS[spiral_of]
        axes.plot(grid.limit_over_radius, lines[0], "-", color=color, label=label)
        axes.plot(grid.limit_over_radius, lines[1], "--", color=color)
    axes.set(xlabel="limit over radius of the spiral")
    if angle == 0:
        axes.plot([], [], "--", color=BLACK, label="with anti-windup")
        axes.legend()
