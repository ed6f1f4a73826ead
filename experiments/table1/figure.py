"""Figures 4, 5 and 6 of the paper, in its arrangement, from the runs of Table I."""

from functools import partial

from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure

from experiments.hexapod.plots import spiral
from experiments.hexapod.simulation import Trajectory
from experiments.output.plotting import COLUMN_IN, DESIRED, MEASURED, PAGE_IN, new_figure
from experiments.output.results import Picture

SECONDARY = [("$t_x$, µm", 1), ("$t_y$, µm", 2), ("$t_z$, µm", 3), ("$\\gamma$, µrad", 0)]
"""Label and column of `Trajectory.secondary`, in the order of the paper's weights."""


def pictures(runs: dict[str, Trajectory]) -> list[Picture]:
    """Figures 4 to 6 with their captions."""
    return [
        Picture(
            "figure4",
            "The paper's Fig. 4: spirals and strut inputs, weighted strut displacements minimized.",
            "Three rows, W_a, W_b and W_c: on the left the same spiral each time, on the right six "
            "strut inputs; small are under W_b those of struts 1, 3, 5, under W_c of 2, 4, 6.",
            partial(figure_4, runs),
        ),
        Picture(
            "figure5",
            "The paper's Fig. 5: strut 1 locked, mapping not reconfigured.",
            "A spiral of the detector reading, distorted by the locked strut, beside the desired.",
            partial(figure_5, runs),
        ),
        Picture(
            "figure6",
            "The paper's Fig. 6: strut 1 locked, mapping reconfigured, secondary motion minimized.",
            "Two spirals that track as well as with six struts; under W_e the translations t_x and "
            "t_y almost vanish, under W_d their amplitude is about ten micrometres.",
            partial(figure_6, runs),
        ),
    ]


def figure_4(runs: dict[str, Trajectory]) -> Figure:
    """A row for each of W_a, W_b, W_c: tracking spiral on the left, strut inputs on the right."""
    names = ["W_a", "W_b", "W_c"]
    figure = new_figure(PAGE_IN, 8.2)
    limit_percent = 1.1 * max(abs(runs[name].strut_input_percent).max() for name in names)
    grid = figure.add_gridspec(len(names), 2, width_ratios=[1, 1.5])
    for row, name in enumerate(names):
        spiral(figure.add_subfigure(grid[row, 0]).subplots(), runs[name], _weight(name))
        _inputs(figure.add_subfigure(grid[row, 1]), runs[name], limit_percent)
    return figure


def figure_5(runs: dict[str, Trajectory]) -> Figure:
    """Tracking spiral with strut 1 locked and the mapping of six struts."""
    figure = new_figure(COLUMN_IN, 3.5)
    spiral(figure.subplots(), runs["W_a_uncorrected"], "strut 1 locked, no correction")
    return figure


def figure_6(runs: dict[str, Trajectory]) -> Figure:
    """Columns W_d and W_e: tracking spiral above SDOF displacements, strut 1 locked and known."""
    names = ["W_d", "W_e"]
    figure = new_figure(PAGE_IN, 7.2)
    halves = figure.add_gridspec(2, 1, height_ratios=[1, 1.1])
    spirals = figure.add_subfigure(halves[0]).subplots(1, len(names))
    motions = figure.add_subfigure(halves[1])
    grid = motions.subplots(len(SECONDARY), len(names), sharex=True, sharey=True)
    for name, axes, below in zip(names, spirals, grid.T, strict=True):
        run = runs[name]
        spiral(axes, run, _weight(name))
        for panel, (label, column) in zip(below, SECONDARY, strict=True):
            for motion, style in (
                (run.secondary, {"color": MEASURED, "label": "true"}),
                (run.secondary_estimated, {"color": DESIRED, "ls": "--", "label": "estimated"}),
            ):
                panel.plot(run.time_s, 1e6 * motion[:, column], lw=0.8, **style)
            panel.set_ylabel(label)
            _whole_run(panel, run)
        below[-1].set_xlabel("time, s")
    grid[0, 0].legend(loc="upper left", ncols=2)
    return figure


def _inputs(figure: SubFigure, run: Trajectory, limit_percent: float) -> None:
    """Normalized currents of struts 1 to 6; W_b keeps the odd ones, on the left, small."""
    grid = figure.subplots(3, 2, sharex=True, sharey=True)
    for k, axes in enumerate(grid.flat):
        axes.plot(run.time_s, run.strut_input_percent[:, k], color=MEASURED, lw=0.6)
        axes.set(ylabel=f"Input {k + 1}, %", ylim=(-limit_percent, limit_percent))
        _whole_run(axes, run)
    for axes in grid[-1]:
        axes.set_xlabel("time, s")


def _whole_run(axes: Axes, run: Trajectory) -> None:
    end_s = round(float(run.time_s[-1]))
    axes.set(xlim=(0, end_s), xticks=range(0, end_s + 1, 2))


def _weight(name: str) -> str:
    return f"$W_{name[-1]}$"
