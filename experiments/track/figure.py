"""The figure of `fjh track`: the path, the error over time, and the actuators."""

from textwrap import fill
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.rig.run import Run
from experiments.rig.units import ROWS, prefixed
from experiments.study.controllers import controller_label
from experiments.study.plotting import (
    BLACK,
    BLUE,
    GREEN,
    PAGE_IN,
    PURPLE,
    VERMILION,
    new_figure,
    one_legend,
)
from experiments.track.runs import Tracked
from sim import Array

ALT = (
    "Left: the desired path and the true one, with the places of failure and diagnosis. Right: the "
    "size of the error over time; below, a row for each actuator with its displacement, failing "
    "ones red."
)
"""What there is to see."""

_FAILED, _NAMED = VERMILION, GREEN
_ROW_IN = 0.2
"""Height of an actuator's row."""


def figure_track(tracked: Tracked, summary: dict[str, Any]) -> Figure:
    """Path, errors, actuators."""
    units = list(dict.fromkeys(summary["units"]))
    heights = [1.5] * len(units) + [0.4 + _ROW_IN * len(tracked.rig.actuators)]
    figure = new_figure(PAGE_IN, max(3.4, 0.9 + sum(heights)))
    figure.suptitle(fill(summary["verdict"], 110))
    grid = figure.add_gridspec(len(heights), 2, width_ratios=[0.8, 1], height_ratios=heights)
    _path(figure.add_subplot(grid[:, 0]), tracked, summary)
    over_time = [figure.add_subplot(grid[k, 1]) for k in range(len(heights))]
    for axes, unit in zip(over_time, units, strict=False):
        _error(axes, tracked, [u == unit for u in summary["units"]], unit)
    _actuators(over_time[-1], tracked, summary)
    for axes in over_time:
        _events(axes, summary)
        axes.set(xlim=(tracked.run.time_s[0], tracked.run.time_s[-1]))
    over_time[-1].set_xlabel("time, s")
    one_legend(figure, 4)
    return figure


def _path(axes: Axes, tracked: Tracked, summary: dict[str, Any]) -> None:
    """The first two major rows, or the only one over time."""
    run, names = tracked.run, [ROWS[row] for row in tracked.rig.major]
    factor, prefix = prefixed(float(np.abs(run.desired).max()))
    labels = [f"{n}, {prefix}{u}" for n, u in zip(names, summary["units"], strict=True)]
    is_plane = len(names) > 1

    def drawn(signal: Array) -> tuple[Array, Array]:
        first = factor * signal[:, 0]
        return (first, factor * signal[:, 1]) if is_plane else (run.time_s, first)

    axes.plot(*drawn(run.true), color=BLUE, label="true")
    if tracked.other is not None:
        label = controller_label(tracked.other.name)
        axes.plot(*drawn(tracked.other.run.true), color=PURPLE, lw=0.6, label=label)
    axes.plot(*drawn(run.desired), color=BLACK, ls="--", lw=0.6, label="desired")
    struck = [*summary["failures"], *summary["events"]]
    for entries, color in ((struck, _FAILED), (summary["diagnoses"], _NAMED)):
        ticks = np.searchsorted(run.time_s, [one["time_s"] for one in entries])
        x, y = drawn(run.true[np.minimum(ticks, len(run.time_s) - 1)]) if is_plane else ((), ())
        axes.plot(x, y, "o", color=color)
    axes.set(title="Path", xlabel=labels[0] if is_plane else "time, s")
    axes.set_ylabel(labels[int(is_plane)])
    if is_plane and summary["units"][0] == summary["units"][1]:
        axes.set_aspect("equal", adjustable="datalim")


def _error(axes: Axes, tracked: Tracked, rows: list[bool], unit: str) -> None:
    """Size of desired minus true, of the major rows of one unit together."""
    flown: list[tuple[Run, str]] = [(tracked.run, BLUE)]
    if tracked.other is not None:
        flown.insert(0, (tracked.other.run, PURPLE))
    sizes = [np.linalg.norm((run.desired - run.true)[:, rows], axis=1) for run, _ in flown]
    factor, prefix = prefixed(float(np.max(sizes)))
    for size, (run, color) in zip(sizes, flown, strict=True):
        axes.plot(run.time_s, factor * size, color=color, lw=0.8)
    major = zip(tracked.rig.major, rows, strict=True)
    names = ", ".join(ROWS[row] for row, shown in major if shown)
    axes.set(title=f"Error of {names}", ylabel=f"error, {prefix}{unit}")
    axes.tick_params(labelbottom=False)


def _actuators(axes: Axes, tracked: Tracked, summary: dict[str, Any]) -> None:
    """A row for each, from its place at the start; all of one unit on the same scale."""
    rig, run = tracked.rig, tracked.run
    broken = {one["actuator"] for one in (*summary["failures"], *summary["events"])}
    units = rig.units
    spans = {
        unit: 2 * float(np.abs(run.displacement[:, [u == unit for u in units]]).max())
        for unit in dict.fromkeys(units)
    }
    for k, unit in enumerate(units):
        style = (
            {"lw": 1.4, "color": _FAILED}
            if rig.actuators[k] in broken
            else {"lw": 0.8, "color": "0.4"}
        )
        axes.plot(run.time_s, k - run.displacement[:, k] / (spans[unit] or 1.0), **style)
    heights = ((*prefixed(span), span, unit) for unit, span in spans.items())
    row = " or ".join(f"{f * span:.3g} {prefix}{unit}" for f, prefix, span, unit in heights)
    axes.set_yticks(range(len(units)), rig.actuators)
    axes.set(title=f"Displacement of each actuator:\na row is {row} high")
    axes.invert_yaxis()


def _events(axes: Axes, summary: dict[str, Any]) -> None:
    """Lines where an actuator failed, where something else happened, and where one was named."""
    for one in summary["failures"]:
        axes.axvline(one["time_s"], color=_FAILED, lw=0.8, label="failure")
    for one in summary["events"]:
        axes.axvline(one["time_s"], color=_FAILED, lw=0.8, ls=":", label="event")
    for one in summary["diagnoses"]:
        axes.axvline(one["time_s"], color=_NAMED, lw=0.8, ls="--", label="diagnosis")
