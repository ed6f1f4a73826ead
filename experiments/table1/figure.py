"""Figures 4, 5 and 6 of the paper, with the errors; and the result at a glance."""

from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure

from experiments.recording.plots import spiral
from experiments.rig.hexapod.metrics import pointing_rms_urad
from experiments.rig.hexapod.simulation import Trajectory
from experiments.study.plotting import (
    BLACK,
    BLUE,
    COLUMN_IN,
    GREEN,
    ORANGE,
    PAGE_IN,
    PURPLE,
    VERMILION,
    new_figure,
    one_legend,
)
from experiments.study.results import Picture
from sim import Array

SECONDARY = [("$t_x$, µm", 1), ("$t_y$, µm", 2), ("$t_z$, µm", 3), ("$\\gamma$, µrad", 0)]
"""Label and column of `Trajectory.secondary`, in the order of the paper's weights."""
ERROR = "error: desired minus true"
ERRORS = "$\\alpha$ error, µrad", "$\\beta$ error, µrad"


def pictures(runs: dict[str, Trajectory]) -> list[Picture]:
    """The result at a glance and Figures 4 to 6, with their captions."""
    return [
        Picture(
            "result",
            "What reconfiguring is worth, and what the secondary weights do, in simulation.",
            "Pointing error over time: with strut 1 locked and the mapping reconfigured it is that "
            "of six sound struts, not reconfigured it is larger. Translation t_x with strut 1 "
            "locked: ten micrometres under equal weights, almost none where it has ten times the "
            "weight.",
            partial(figure_result, runs),
        ),
        Picture(
            "figure4",
            "The paper's Fig. 4: spirals and strut inputs, weighted strut displacements minimized; "
            "errors are desired minus true.",
            "Three rows, W_a, W_b and W_c: on the left the same spiral and the same errors each "
            "time, on the right six strut inputs; small are under W_b those of struts 1, 3, 5, "
            "under W_c of 2, 4, 6.",
            partial(figure_4, runs),
        ),
        Picture(
            "figure5",
            "The paper's Fig. 5: strut 1 locked, mapping not reconfigured; errors are desired "
            "minus true.",
            "A spiral of the detector reading beside the desired one; below, the errors of both "
            "angles, larger than those of six sound struts.",
            partial(figure_5, runs),
        ),
        Picture(
            "figure6",
            "The paper's Fig. 6: strut 1 locked, mapping reconfigured, secondary motion minimized; "
            "errors are desired minus true.",
            "Two spirals that track as well as with six struts, and their errors; under W_e the "
            "translations t_x and t_y almost vanish, under W_d their amplitude is about ten "
            "micrometres.",
            partial(figure_6, runs),
        ),
    ]


def figure_result(runs: dict[str, Trajectory]) -> Figure:
    """Size of the pointing error over time, and t_x under two weights."""
    figure = new_figure(PAGE_IN, 3.0)
    left, right = figure.subplots(1, 2)
    for name, said, style in (
        ("W_a_uncorrected", "strut 1 locked, mapping not reconfigured", {"color": VERMILION}),
        ("W_a", "six sound struts", {"color": BLACK, "lw": 1.4}),
        ("W_e", "strut 1 locked, mapping reconfigured", {"color": BLUE, "ls": "--"}),
    ):
        run = runs[name]
        size_urad = np.linalg.norm(_error_urad(run), axis=1)
        rms_urad = np.linalg.norm(pointing_rms_urad(run))
        left.plot(run.time_s, size_urad, label=f"{said}: RMS {rms_urad:.1f} µrad", **style)
        _whole_run(left, run)
    radius_urad = 1e6 * np.linalg.norm(runs["W_a"].desired_rad, axis=1).max()
    left.set_title(f"Major task: pointing along a spiral of {radius_urad:.0f} µrad")
    left.set_ylabel("pointing error, µrad")
    for name, color, said in (
        ("W_d", ORANGE, "$W_d$, all secondary motions weighted alike"),
        ("W_e", BLUE, "$W_e$, $t_x$ and $t_y$ weighted ten times"),
    ):
        run = runs[name]
        peak_um = 1e6 * abs(run.secondary[:, 1]).max()
        label = f"{said}: peak {peak_um:.3g} µm"
        right.plot(run.time_s, 1e6 * run.secondary[:, 1], color=color, label=label)
        _whole_run(right, run)
    right.set(title="Secondary motion, strut 1 locked")
    right.set_ylabel("translation $t_x$, µm")
    for axes in (left, right):
        axes.set_xlabel("time, s")
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.2), frameon=False)
    return figure


def figure_4(runs: dict[str, Trajectory]) -> Figure:
    """A row for each of W_a, W_b, W_c: tracking spiral, its errors, strut inputs."""
    names = ["W_a", "W_b", "W_c"]
    figure = new_figure(PAGE_IN, 7.2)
    limit_percent = 1.1 * max(abs(runs[name].strut_input_percent).max() for name in names)
    grid = figure.add_gridspec(len(names), 3, width_ratios=[1, 0.75, 1.5])
    for row, name in enumerate(names):
        tracking = figure.add_subfigure(grid[row, 0]).subplots()
        spiral(tracking, runs[name], _weight(name), legend=False)
        errors = figure.add_subfigure(grid[row, 1]).subplots(2, 1, sharex=True, sharey=True)
        _errors(errors, runs[name], _limit_urad([runs[name] for name in names]))
        errors[-1].set_xlabel("time, s")
        _inputs(figure.add_subfigure(grid[row, 2]), runs[name], limit_percent)
    one_legend(figure, 4)
    return figure


def figure_5(runs: dict[str, Trajectory]) -> Figure:
    """Tracking spiral with strut 1 locked and the mapping of six struts; its errors."""
    run, sound = runs["W_a_uncorrected"], runs["W_a"]
    figure = new_figure(COLUMN_IN, 5.4)
    tracking, *errors = figure.subplots(3, 1, height_ratios=[2.6, 1, 1])
    spiral(tracking, run, "strut 1 locked, no correction", legend=False)
    limit_urad = _limit_urad([run, sound])
    _errors(errors, run, limit_urad)
    for axes, error in zip(errors, _error_urad(sound).T, strict=True):
        axes.plot(sound.time_s, error, color=BLACK, lw=0.6, ls=":", label="six sound struts, $W_a$")
    errors[-1].set_xlabel("time, s")
    one_legend(figure, 2)
    return figure


def figure_6(runs: dict[str, Trajectory]) -> Figure:
    """Columns W_d and W_e: spiral, errors, SDOF displacements; strut 1 locked and known."""
    names = ["W_d", "W_e"]
    figure = new_figure(PAGE_IN, 8.6)
    halves = figure.add_gridspec(2, 1, height_ratios=[1, 1.75])
    spirals = figure.add_subfigure(halves[0]).subplots(1, len(names))
    lower = figure.add_subfigure(halves[1])
    grid = lower.subplots(2 + len(SECONDARY), len(names), sharex=True, sharey="row")
    limit_urad = _limit_urad([runs[name] for name in names])
    largest = 1.1e6 * max(abs(runs[name].secondary).max() for name in names)
    for name, axes, panels in zip(names, spirals, grid.T, strict=True):
        run = runs[name]
        spiral(axes, run, f"{_weight(name)}, strut 1 locked", legend=False)
        _errors(panels[:2], run, limit_urad)
        for panel, (label, column) in zip(panels[2:], SECONDARY, strict=True):
            panel.plot(
                run.time_s, 1e6 * run.secondary[:, column], color=PURPLE, lw=1.4, label="true"
            )
            estimated = 1e6 * run.secondary_estimated[:, column]
            panel.plot(run.time_s, estimated, color=BLACK, lw=0.8, ls=":", label="estimated")
            panel.set(ylabel=label, ylim=(-largest, largest))
            _whole_run(panel, run)
        panels[-1].set_xlabel("time, s")
    for panel in grid[:, 1]:  # as on its left
        panel.set_ylabel("")
    one_legend(figure, 6)
    return figure


def _error_urad(run: Trajectory) -> Array:
    """Desired minus true (alpha, beta), shape (N, 2)."""
    return 1e6 * (run.desired_rad - run.true_rad)


def _limit_urad(runs: list[Trajectory]) -> float:
    return 1.1 * max(abs(_error_urad(run)).max() for run in runs)


def _errors(panels: list[Axes], run: Trajectory, limit_urad: float) -> None:
    """Desired minus true alpha and beta, each in a panel with its RMS."""
    rms_urad = pointing_rms_urad(run)
    for k, (axes, label) in enumerate(zip(panels, ERRORS, strict=True)):
        axes.plot(run.time_s, _error_urad(run)[:, k], color=GREEN, lw=0.8, label=ERROR)
        axes.set(ylabel=label, ylim=(-limit_urad, limit_urad))
        axes.set_title(f"RMS {rms_urad[k]:.2f} µrad", loc="left")
        _whole_run(axes, run)


def _inputs(figure: SubFigure, run: Trajectory, limit_percent: float) -> None:
    """Normalized currents of struts 1 to 6; W_b keeps the odd ones, on the left, small."""
    grid = figure.subplots(3, 2, sharex=True, sharey=True)
    for k, axes in enumerate(grid.flat):
        axes.plot(run.time_s, run.strut_input_percent[:, k], lw=0.6, color=BLUE)
        axes.set(ylabel=f"Input {k + 1}, %", ylim=(-limit_percent, limit_percent))
        _whole_run(axes, run)
    for axes in grid[-1]:
        axes.set_xlabel("time, s")


def _whole_run(axes: Axes, run: Trajectory) -> None:
    end_s = round(float(run.time_s[-1]))
    axes.set(xlim=(0, end_s), xticks=range(0, end_s + 1, 4 if end_s > 8 else 1))


def _weight(name: str) -> str:
    return f"$W_{name[-1]}$"
