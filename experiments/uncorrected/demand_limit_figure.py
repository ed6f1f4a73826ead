"""The picture of the demand limit: ratios over it, and two uncorrected spirals."""

from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.hexapod.plots import spiral
from experiments.hexapod.simulation import Trajectory
from experiments.output.palette import BLACK, BLUE, GREEN, PURPLE, VERMILION
from experiments.output.plotting import PAGE_IN, new_figure
from experiments.uncorrected.candidates import CLOCKWISE, RETUNED
from experiments.uncorrected.figure import ANGLES
from experiments.uncorrected.study import Uncorrected

SPIRALS = {
    (1.0, 1): (BLUE, "the bench's"),
    (1.0, -1): (VERMILION, "clockwise"),
    (0.5, 1): (GREEN, "constant speed"),
    (0.5, -1): (PURPLE, "constant speed, clockwise"),
}
"""Colour and name of each spiral of the map by exponent and direction."""


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
        run = study.runs.get(name, {}).get("W_a_uncorrected")
        if isinstance(run, Trajectory):
            spiral(axes, run, title)
        else:
            axes.set_axis_off()
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
