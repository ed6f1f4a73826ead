"""Figures 4, 5 and 6 of the paper, from the runs of Table I."""

from collections.abc import Sequence
from typing import Any

import matplotlib

matplotlib.use("Agg")

from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure

from experiments.run import Trajectory

# Okabe and Ito's palette: told apart by colour-blind readers and in grey print.
DESIRED, MEASURED, START, INPUT = "#000000", "#0072B2", "#D55E00", "#0072B2"
LIMIT_URAD = 125


def figure_4(runs: dict[str, Trajectory]) -> Figure:
    """Spirals and strut inputs when weighted strut displacements are minimized."""
    return _spirals_and_inputs(runs, ["W_a", "W_b", "W_c"], "Fig. 4: joint displacements minimized")


def figure_5(runs: dict[str, Trajectory]) -> Figure:
    """Spiral with strut 1 locked and nothing done about it."""
    figure = Figure(figsize=(5, 5), layout="constrained")
    figure.suptitle("Fig. 5: strut 1 locked, no correction")
    _spiral(figure.add_subplot(), runs["W_a_uncorrected"])
    return figure


def figure_6(runs: dict[str, Trajectory]) -> Figure:
    """Spirals and secondary motion with strut 1 locked and the mapping reconfigured."""
    figure = Figure(figsize=(10, 9), layout="constrained")
    figure.suptitle("Fig. 6: strut 1 locked, mapping reconfigured")
    top, bottom = figure.subfigures(2, 1, height_ratios=[1.1, 1])
    names = ["W_d", "W_e"]
    for axes, name in zip(top.subplots(1, 2), names, strict=True):
        _spiral(axes, runs[name])
        axes.set_title(_weight(name))
    labels = ["$t_x$, µm", "$t_y$, µm", "$t_z$, µm", "$\\gamma$, µrad"]
    for column, name in enumerate(names):
        run = runs[name]
        for row, (label, index) in enumerate(zip(labels, [1, 2, 3, 0], strict=True)):
            axes = bottom.add_subplot(4, 2, 2 * row + column + 1)
            axes.plot(run.time_s, 1e6 * run.secondary[:, index], color=MEASURED, lw=1)
            axes.set_ylabel(label)
            axes.set_ylim(-26, 26)
            axes.grid(alpha=0.3)
            axes.tick_params(labelbottom=row == 3)
        axes.set_xlabel("time, s")
    return figure


def _spirals_and_inputs(runs: dict[str, Trajectory], names: Sequence[str], title: str) -> Figure:
    figure = Figure(figsize=(11, 4.2 * len(names)), layout="constrained")
    figure.suptitle(title)
    rows = figure.subfigures(len(names), 1)
    for row, name in zip(rows, names, strict=True):
        left, right = row.subfigures(1, 2, width_ratios=[1, 1.5])
        axes = left.subplots()
        _spiral(axes, runs[name])
        axes.set_title(_weight(name))
        _inputs(right, runs[name])
    return figure


def _spiral(axes: Axes, run: Trajectory) -> None:
    desired, measured = 1e6 * run.desired_rad, 1e6 * run.measured_rad
    axes.plot(*measured.T, color=MEASURED, lw=0.8, label="detector")
    axes.plot(*desired.T, color=DESIRED, lw=0.8, ls="--", label="desired")
    axes.plot(*desired[0], "o", color=START, ms=6, label="start")
    axes.set(
        xlabel="$\\alpha$, µrad",
        ylabel="$\\beta$, µrad",
        xlim=(-LIMIT_URAD, LIMIT_URAD),
        ylim=(-LIMIT_URAD, LIMIT_URAD),
        aspect="equal",
    )
    axes.grid(alpha=0.3)
    axes.legend(loc="upper right", fontsize="small", ncols=3)


def _inputs(figure: SubFigure, run: Trajectory) -> None:
    grid: Any = figure.subplots(6, 1, sharex=True, sharey=True)
    for k, axes in enumerate(grid):
        axes.plot(run.time_s, run.strut_input_percent[:, k], color=INPUT, lw=0.8)
        axes.set_ylabel(f"{k + 1}", rotation=0, va="center")
        axes.set_ylim(-5, 5)
        axes.grid(alpha=0.3)
    grid[0].set_title("strut inputs, % of the largest DAC input")
    grid[-1].set_xlabel("time, s")


def _weight(name: str) -> str:
    return f"$W_{name[-1]}$"
