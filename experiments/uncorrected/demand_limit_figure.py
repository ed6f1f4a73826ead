"""The picture of the demand limit: ratios over it, two uncorrected spirals, beam walk."""

from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.palette import BLACK, BLUE, GREEN, PURPLE, VERMILION
from experiments.plotting import PAGE_IN, new_figure
from experiments.run import Trajectory
from experiments.table1.figures import spiral
from experiments.uncorrected.beam_walk import OFFSETS_M
from experiments.uncorrected.candidates import BENCH, CLOCKWISE, RETUNED
from experiments.uncorrected.figure import ANGLES, ratio_bands
from experiments.uncorrected.study import Uncorrected

SPIRALS = {
    (1.0, 1): (BLUE, "the bench's"),
    (1.0, -1): (VERMILION, "clockwise"),
    (0.5, 1): (GREEN, "constant speed"),
    (0.5, -1): (PURPLE, "constant speed, clockwise"),
}
"""Colour and name of each spiral of the map by exponent and direction."""


def figure_demand_limit(study: Uncorrected, summary: dict[str, Any]) -> Figure:
    """Both ratios over the limit, what Fig. 5 would show, and ratios over the detector's offset."""
    figure = new_figure(PAGE_IN, 6.6)
    figure.suptitle(
        "A limit on the pointing that the compensators demand; strut 1 locked, not known to the "
        "mapping"
    )
    grid = figure.add_gridspec(2, 12, height_ratios=[1, 1.15])
    for k, (name, symbol, _) in enumerate(ANGLES):
        axes = figure.add_subplot(grid[0, 6 * k : 6 * k + 6])
        _over_limit(axes, study, k)
        printed = summary["paper"][f"{name}_ratio"]
        axes.axhspan(0.85 * printed, 1.15 * printed, color=BLACK, alpha=0.1, lw=0)
        axes.set(title=f"{symbol}: RMS error over that of the sound machine")
    shown = {BENCH.name: "the bench", CLOCKWISE.name: "demand limit", RETUNED.name: "off centre"}
    for column, (name, title) in enumerate(shown.items()):
        run = study.runs.get(name, {}).get("W_a_uncorrected")
        if isinstance(run, Trajectory):
            spiral(figure.add_subplot(grid[1, 3 * column : 3 * column + 3]), run, title)
    _beam_walk(figure.add_subplot(grid[1, 9:12]), study, summary)
    return figure


def _over_limit(axes: Axes, study: Uncorrected, angle: int) -> None:
    """One line a spiral that starts along alpha; dashed with anti-windup."""
    grid = study.limit_grid
    ratio = study.limit_rad[..., -1, angle] / study.limit_rad[..., 0, angle]
    for i, exponent in enumerate(grid.exponent):
        for j, direction in enumerate(grid.direction):
            color, label = SPIRALS[exponent, direction]
            for held, style in enumerate(("-", "--")):
                axes.plot(
                    grid.limit_over_radius,
                    ratio[i, j, 0, held],
                    style,
                    color=color,
                    label=label if style == "-" else None,
                )
    axes.set(xlabel="limit over radius of the spiral")
    if angle == 0:
        axes.plot([], [], "--", color=BLACK, label="with anti-windup")
        axes.legend()


def _beam_walk(axes: Axes, study: Uncorrected, summary: dict[str, Any]) -> None:
    """Ratios over the place of the detector: errors of the true angle, and of its reading."""
    ratio = study.beam_walk_urad[:, -1] / study.beam_walk_urad[:, 0]
    for k, (_, symbol, color) in enumerate(ANGLES):
        axes.plot(OFFSETS_M, ratio[:, 0, k], "-", color=color, label=f"{symbol}, true")
        axes.plot(OFFSETS_M, ratio[:, 1, k], "--", color=color, label=f"{symbol}, detector")
    ratio_bands(axes, summary, horizontal=True)
    axes.set(title="beam walk", xlabel="detector behind focus, m", ylim=(0.5, 5))
    axes.legend()
