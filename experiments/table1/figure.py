"""Figures 4, 5 and 6 of the paper, with the errors; and the result at a glance."""

from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.recording.plots import spiral
from experiments.rig.hexapod.columns import secondary
from experiments.rig.run import Run
from experiments.study.palette import BLACK, BLUE, GREEN, ORANGE, PURPLE, SKY, VERMILION
from experiments.study.plotting import COLUMN_IN, PAGE_IN, new_figure, one_legend
from experiments.study.results import Picture
from sim import Array

SECONDARY = [
    ("$t_x$, µm", 1, BLUE),
    ("$t_y$, µm", 2, SKY),
    ("$t_z$, µm", 3, ORANGE),
    ("$\\gamma$, µrad", 0, PURPLE),
]
"""Label and column of `secondary`, in the order of the paper's weights, and colour."""
ERROR = "error: desired minus true"
ERRORS = "$\\alpha$ error, µrad", "$\\beta$ error, µrad"


def pictures(runs: dict[str, Run]) -> list[Picture]:
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
            "The paper's Fig. 4: weighted strut displacements minimized. Above the pointing error, "
            "desired minus true, drawn as beta over alpha; below the strut inputs.",
            "Columns W_a, W_b and W_c. Above, the same small spiral of the pointing error each "
            "time. Below, six strut inputs over time: those of struts 1, 3, 5 are small under W_b, "
            "those of 2, 4, 6 under W_c.",
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
            "The paper's Fig. 6: strut 1 locked, mapping reconfigured, secondary motion minimized. "
            "On the left the pointing error, desired minus true, drawn as beta over alpha.",
            "Rows W_d and W_e. The spiral of the pointing error is the same in both. Under W_e the "
            "translations t_x and t_y almost vanish, and t_z and gamma are larger than under W_d.",
            partial(figure_6, runs),
        ),
    ]


def figure_result(runs: dict[str, Run]) -> Figure:
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
        rms_urad = np.linalg.norm(1e6 * run.rms())
        left.plot(run.time_s, size_urad, label=f"{said}: RMS {rms_urad:.1f} µrad", **style)
        _whole_run(left, run)
    radius_urad = 1e6 * np.linalg.norm(runs["W_a"].desired, axis=1).max()
    left.set_title(f"Major task: pointing along a spiral of {radius_urad:.0f} µrad")
    left.set_ylabel("pointing error, µrad")
    for name, color, said in (
        ("W_d", ORANGE, "$W_d$, all secondary motions weighted alike"),
        ("W_e", BLUE, "$W_e$, $t_x$ and $t_y$ weighted ten times"),
    ):
        run = runs[name]
        peak_um = 1e6 * abs(secondary(run)[:, 1]).max()
        label = f"{said}: peak {peak_um:.3g} µm"
        right.plot(run.time_s, 1e6 * secondary(run)[:, 1], color=color, label=label)
        _whole_run(right, run)
    right.set(title="Secondary motion, strut 1 locked")
    right.set_ylabel("translation $t_x$, µm")
    for axes in (left, right):
        axes.set_xlabel("time, s")
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.2), frameon=False)
    return figure


def figure_4(runs: dict[str, Run]) -> Figure:
    """A column for each of W_a, W_b, W_c: the pointing error, and the strut inputs."""
    names = ["W_a", "W_b", "W_c"]
    peaks = {name: abs(runs[name].inputs).max(axis=0) for name in names}
    figure = new_figure(PAGE_IN, 4.6)
    figure.suptitle(
        f"$W_b$ takes the largest input of struts 1, 3, 5 from {peaks['W_a'][::2].max():.1f} to "
        f"{peaks['W_b'][::2].max():.1f} %, $W_c$ that of struts 2, 4, 6 from "
        f"{peaks['W_a'][1::2].max():.1f} to {peaks['W_c'][1::2].max():.1f} %;\n"
        f"the RMS pointing errors are {_rms_said([runs[name] for name in names])} each time"
    )
    errors, inputs = figure.subplots(2, len(names), height_ratios=[1.2, 1], sharey="row")
    limit_urad = _limit_urad([runs[name] for name in names])
    errors[0].set_ylabel(ERRORS[1])
    for name, plane, axes in zip(names, errors, inputs, strict=True):
        _error_plane(plane, runs[name], limit_urad, _weight(name))
        for k, current in enumerate(runs[name].inputs.T):
            label, color = ("struts 2, 4, 6", ORANGE) if k % 2 else ("struts 1, 3, 5", BLUE)
            axes.plot(runs[name].time_s, current, lw=0.6, color=color, label=label)
        axes.set(xlabel="time, s")
        _whole_run(axes, runs[name])
    inputs[0].set_ylabel("strut input, %")
    one_legend(figure, 3)
    return figure


def figure_5(runs: dict[str, Run]) -> Figure:
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


def figure_6(runs: dict[str, Run]) -> Figure:
    """Rows W_d and W_e: the pointing error and the secondary motion; strut 1 locked and known."""
    names = ["W_d", "W_e"]
    sideways_um = {name: 1e6 * abs(secondary(runs[name])[:, 1:3]).max() for name in names}
    figure = new_figure(PAGE_IN, 4.4)
    figure.suptitle(
        f"With strut 1 locked, $t_x$ and $t_y$ are up to {sideways_um['W_d']:.3g} µm under $W_d$ "
        f"and {sideways_um['W_e']:.2g} µm under $W_e$;\n"
        f"the RMS pointing errors are {_rms_said([runs[name] for name in names])} both times"
    )
    grid = figure.subplots(len(names), 3, width_ratios=[0.8, 1, 1])
    limit_urad = _limit_urad([runs[name] for name in names])
    largest = 1.1e6 * max(abs(secondary(runs[name])).max() for name in names)
    for name, (plane, *panels) in zip(names, grid, strict=True):
        run = runs[name]
        _error_plane(plane, run, limit_urad, f"{_weight(name)}, strut 1 locked")
        plane.set_ylabel(ERRORS[1])
        panels[0].set_ylabel("displacement, µm")
        panels[1].set_ylabel("displacement, µm or µrad")
        for panel, shown in zip(panels, (SECONDARY[:2], SECONDARY[2:]), strict=True):
            for label, column, color in shown:
                panel.plot(run.time_s, 1e6 * secondary(run)[:, column], color=color, label=label)
            panel.set(title=_weight(name), ylim=(-largest, largest), xlabel="time, s")
            _whole_run(panel, run)
    one_legend(figure, 5)
    return figure


def _error_plane(axes: Axes, run: Run, limit_urad: float, title: str) -> None:
    """The error of beta over that of alpha: at the scale of the path both would be one line."""
    axes.plot(*_error_urad(run).T, color=GREEN, lw=0.6, label=ERROR)
    axes.set(title=title, xlabel=ERRORS[0], aspect="equal")
    axes.set(xlim=(-limit_urad, limit_urad), ylim=(-limit_urad, limit_urad))


def _rms_said(runs: list[Run]) -> str:
    """RMS of both angles, the same or from the least to the largest of the runs."""
    rms_urad = np.array([1e6 * run.rms() for run in runs])
    ends = [
        (f"{low:.2f}", f"{high:.2f}")
        for low, high in zip(rms_urad.min(0), rms_urad.max(0), strict=True)
    ]
    alpha, beta = (low if low == high else f"{low} to {high}" for low, high in ends)
    return f"{alpha} and {beta} µrad"


def _error_urad(run: Run) -> Array:
    """Desired minus true (alpha, beta), shape (N, 2)."""
    return 1e6 * run.error


def _limit_urad(runs: list[Run]) -> float:
    return 1.1 * max(abs(_error_urad(run)).max() for run in runs)


def _errors(panels: list[Axes], run: Run, limit_urad: float) -> None:
    """Desired minus true alpha and beta, each in a panel with its RMS."""
    rms_urad = 1e6 * run.rms()
    for k, (axes, label) in enumerate(zip(panels, ERRORS, strict=True)):
        axes.plot(run.time_s, _error_urad(run)[:, k], color=GREEN, lw=0.8, label=ERROR)
        axes.set(ylabel=label, ylim=(-limit_urad, limit_urad))
        axes.set_title(f"RMS {rms_urad[k]:.2f} µrad", loc="left")
        _whole_run(axes, run)


def _whole_run(axes: Axes, run: Run) -> None:
    end_s = round(float(run.time_s[-1]))
    axes.set(xlim=(0, end_s), xticks=range(0, end_s + 1, 4 if end_s > 8 else 1))


def _weight(name: str) -> str:
    return f"$W_{name[-1]}$"
