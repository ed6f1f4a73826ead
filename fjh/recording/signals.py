"""Plots of signals over time, with events, axes and views."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from fjh.recording import Array
from fjh.recording.file import at_most, log_series, time_column
from fjh.study.palette import FAILED

SIGNALS_HZ = 200
"""Rate [Hz] of logged signals, which are samples of the run without interpolation."""
_LIMIT = "#787878"
_FLAT = 1e-9

Range = tuple[float, float]


@dataclass(frozen=True)
class Line:
    """Event as a vertical line in every plot."""

    time_s: float
    name: str
    color: str


@dataclass(frozen=True)
class Plot:
    """Plot of k lines over time, with its entity in the recording and its title.

    Attributes:
        entity: Entity of the recording.
        title: Title of the view.
        names: Names of the lines, with units.
        time_s: Times (T,).
        values: Values (T, k).
        levels: Limits of the values, plotted as horizontal lines.
        failed: Columns of failed actuators, with the onsets [s] from which their lines are thick.
        note: Addition to the title of a wide view.
        flat: Largest change of a constant signal, in its unit or relative to its size.
    """

    entity: str
    title: str
    names: Sequence[str]
    time_s: Array
    values: Array
    levels: Sequence[float] = ()
    failed: Sequence[tuple[int, float]] = ()
    note: str = ""
    flat: float = _FLAT

    @property
    def is_constant(self) -> bool:
        """True if no value changes by more than `flat`."""
        changes = np.ptp(self.values, axis=0)
        sizes = np.maximum(1.0, np.abs(self.values).max(axis=0))
        return bool((changes <= self.flat * sizes).all())

    @property
    def range(self) -> Range:
        """Smallest and largest of the values and of limits near them."""
        low, high = float(self.values.min()), float(self.values.max())
        near = [level for level in self.levels if 2 * low - high <= level <= 2 * high - low]
        return min([low, *near]), max([high, *near])


def log_plot(recording: rr.RecordingStream, plot: Plot, under: str = "") -> None:
    """Log the lines of a plot in float64, below the entity `under`."""
    every, entity = at_most(SIGNALS_HZ, plot.time_s), f"{under}{plot.entity}"
    time_s, values = plot.time_s[every], plot.values[every]
    log_series(recording, time_column(time_s), entity, plot.names, values)
    for column, since_s in plot.failed:
        since, name = time_s >= since_s - 1e-9, f"{plot.names[column]}, failed"
        thick, where = {"color": FAILED, "width": 3.0}, f"{entity}/failed_{column}"
        times = time_column(time_s[since])
        log_series(recording, times, where, [name], values[since, column], **thick)


def log_lines(
    recording: rr.RecordingStream, plot: Plot, lines: Sequence[Line], axis: Range, under: str
) -> None:
    """Log events as vertical lines over the axis of a plot, and limits as horizontal ones."""
    entity, (low, high) = f"{under}{plot.entity}", axis
    start_s, end_s = plot.time_s[[0, -1]]
    visible = [line for line in lines if start_s < line.time_s <= end_s]
    colors = sorted({line.color for line in visible})
    for number, color in enumerate(colors):
        first, *more = [line for line in visible if line.color == color]
        name = f"{first.name} and {len(more)} more" if more else first.name
        times = time_column(np.repeat([line.time_s for line in (first, *more)], 3))
        values = np.tile([low, high, np.nan], 1 + len(more))  # NaN: a gap between lines
        where = f"{entity}/event_{number}"
        log_series(recording, times, where, [name], values, color=color, width=1.0)
    levels = sorted({level for level in plot.levels if low <= level <= high})
    if levels:
        times, values = time_column(np.array([start_s, end_s])), np.tile(levels, (2, 1))
        names = ["limit"] * len(levels)
        log_series(recording, times, f"{entity}/limits", names, values, color=_LIMIT, width=1.5)


def plot_view(
    plot: Plot, axis: Range, under: str = "", *, legend: bool = True, is_wide: bool = True
) -> rrb.TimeSeriesView:
    """Return a view of a plot with this axis; the title of a wide view has the range of values."""
    low, high = plot.range
    parts = [plot.title, f"{low:.3g} to {high:.3g}", plot.note] if is_wide else [plot.title]
    times = [rrb.TimeRangeBoundary.absolute(seconds=float(t)) for t in plot.time_s[[0, -1]]]
    return rrb.TimeSeriesView(
        origin=f"{under}{plot.entity}",
        name=", ".join(filter(None, parts)),
        axis_x=rrb.archetypes.TimeAxis(view_range=rr.TimeRange(*times)),
        axis_y=rrb.ScalarAxis(range=axis),
        plot_legend=rrb.PlotLegend(rrb.Corner2D.LeftTop, visible=legend),
    )


def axis_of(low: float, high: float, ticks: float) -> Range:
    """Return an axis that contains two values and at least three of the viewer's ticks.

    The viewer puts up to `ticks` ticks at multiples of powers of ten.
    """
    span = max(high - low, 1e-12, 1e-9 * abs(high))
    step = 10.0 ** np.ceil(np.log10(span / ticks) - 1e-9)
    first, last = np.ceil(low / step), np.floor(high / step)
    for _ in range(max(0, round(2 - (last - first)))):  # extend to the nearer side
        up = (last + 1) * step - high <= low - (first - 1) * step or low >= 0 >= first
        first, last = (first, last + 1) if up else (first - 1, last)
    low, high = min(low, first * step), max(high, last * step)
    margin = 0.04 * (high - low)
    return float(low - margin), float(high + margin)
