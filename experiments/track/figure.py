"""The figure of `fjh track`: the path, the error over time, and the actuators."""

from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.study.controllers import controller_label
from experiments.study.plotting import (
    BLACK,
    BLUE,
    LINES,
    PAGE_IN,
    PURPLE,
    VERMILION,
    new_figure,
)
from experiments.study.results import Picture
from experiments.track.runs import Tracked
from experiments.track.words import ROWS

_PREFIXES = {1.0: "", 1e3: "m", 1e6: "u", 1e9: "n"}


def pictures(tracked: Tracked, summary: dict[str, Any]) -> list[Picture]:
    """The study's figure and its caption."""
    alt = (
        "Left: the desired path and the true one, before and after the failure. Right: the error "
        "of each major row over time, with the failure and its diagnosis; below, how far each "
        "actuator has moved."
    )
    draw = partial(figure_track, tracked, summary)
    return [Picture("track", summary["verdict"], alt, draw)]


def figure_track(tracked: Tracked, summary: dict[str, Any]) -> Figure:
    """Path, errors, actuators."""
    figure = new_figure(PAGE_IN, 4.2)
    figure.suptitle(f"{tracked.rig.title}: path with failures in flight")
    grid = figure.add_gridspec(2, 2, width_ratios=[0.8, 1])
    _path(figure.add_subplot(grid[:, 0]), tracked, summary)
    error = figure.add_subplot(grid[0, 1])
    _errors(error, tracked, summary)
    actuators = figure.add_subplot(grid[1, 1], sharex=error)
    _actuators(actuators, tracked)
    for axes in (error, actuators):
        _events(axes, summary)
    handles, labels = error.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4)
    return figure


def prefixed(size: float) -> tuple[float, str]:
    """A factor and its prefix, such that numbers of this size are from 1 to 1000."""
    large = (each for each in _PREFIXES.items() if size * each[0] >= 1.0)
    return next(large, list(_PREFIXES.items())[-1])


def _path(axes: Axes, tracked: Tracked, summary: dict[str, Any]) -> None:
    run, units = tracked.run, summary["units"]
    factor, prefix = prefixed(float(np.abs(run.desired).max()))
    names = _names(tracked)
    struck = run.time_s >= (tracked.failures[0].time_s if tracked.failures else np.inf)
    for signal, color, style in ((run.desired, BLACK, "--"), (run.true, BLUE, "-")):
        x, y = _plane(run.time_s, factor * signal)
        axes.plot(x, y, color=color, ls=style, lw=0.8)
    if tracked.other is not None:
        x, y = _plane(run.time_s, factor * tracked.other.run.true)
        axes.plot(x, y, color=PURPLE, lw=0.6)
    x, y = _plane(run.time_s, factor * run.true)
    axes.plot(x[struck], y[struck], color=VERMILION, lw=0.8)
    if run.desired.shape[1] == 1:
        axes.set(xlabel="time, s", ylabel=f"{names[0]}, {prefix}{units[0]}")
    else:
        axes.set(xlabel=f"{names[0]}, {prefix}{units[0]}", ylabel=f"{names[1]}, {prefix}{units[1]}")
        axes.set_aspect("equal", adjustable="datalim")
    axes.set_title("Desired (dashed), true before and after the failure")


def _plane(time_s: Any, signal: Any) -> tuple[Any, Any]:
    """Two rows against each other, or the only one over time."""
    return (signal[:, 0], signal[:, 1]) if signal.shape[1] > 1 else (time_s, signal[:, 0])


def _errors(axes: Axes, tracked: Tracked, summary: dict[str, Any]) -> None:
    run = tracked.run
    error = run.desired - run.true
    factor, prefix = prefixed(float(np.abs(error).max()))
    for k, name in enumerate(_names(tracked)):
        label = f"{name}, {prefix}{summary['units'][k]}"
        axes.plot(run.time_s, factor * error[:, k], color=LINES[k % len(LINES)], label=label)
    if tracked.other is not None:
        theirs = np.linalg.norm(tracked.other.run.desired - tracked.other.run.true, axis=1)
        label = f"{controller_label(tracked.other.name)}, norm"
        axes.plot(run.time_s, factor * theirs, color=PURPLE, lw=0.6, label=label)
    axes.set(title="Desired minus true", ylabel="error")
    axes.tick_params(labelbottom=False)


def _actuators(axes: Axes, tracked: Tracked) -> None:
    run = tracked.run
    factor, prefix = prefixed(float(np.abs(run.displacement).max()))
    broken = {failure.actuator for failure in tracked.failures}
    for k, name in enumerate(tracked.rig.actuators):
        style = {"lw": 1.8, "color": VERMILION} if k in broken else {"lw": 0.7, "color": "0.5"}
        axes.plot(run.time_s, factor * run.displacement[:, k], **style, label=name)
    axes.set(
        title="Actuators, from the start; failing ones red",
        xlabel="time, s",
        ylabel=f"displacement, {prefix}rad or {prefix}m",
    )


def _events(axes: Axes, summary: dict[str, Any]) -> None:
    for failure in summary["failures"]:
        label = f"{failure['actuator']} {failure['kind']}"
        axes.axvline(failure["time_s"], color=BLACK, lw=0.8, ls=":", label=label)
    for found in summary["diagnoses"]:
        label = f"named {found['actuator']} {found['kind']}"
        axes.axvline(found["time_s"], color=BLUE, lw=0.8, ls="-.", label=label)


def _names(tracked: Tracked) -> list[str]:
    return [ROWS[row] for row in tracked.rig.major]
