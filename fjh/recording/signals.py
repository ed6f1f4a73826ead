"""Signals over time with their events, and the axes on which they are seen."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from fjh.recording import Array
from fjh.recording.file import at_most, log_series, time_column
from fjh.study.palette import FAILED

SIGNALS_HZ = 200
"""Rate of signals over time; every value is a copy of one of the run's."""
_LIMIT = "#787878"
_FLAT = 1e-9

Range = tuple[float, float]


@dataclass(frozen=True)
class Line:
    """An event, drawn as a vertical line in every plot."""

    time_s: float
    name: str
    color: str


@dataclass(frozen=True)
class Plot:
    """k lines over time (T,), values (T, k): where in the recording, and a title for people.

    Attributes:
        entity: Where it is logged.
        title: Of its view.
        names: Of the lines, with units.
        time_s: (T,).
        values: (T, k).
        levels: Limits of the values.
        failed: Columns that are drawn thick, each from a time on.
        note: Of the title, where there is room.
        flat: What changes by less, in its unit or of its size, is constant.
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
        """Whether there is nothing to see."""
        changes = np.ptp(self.values, axis=0)
        sizes = np.maximum(1.0, np.abs(self.values).max(axis=0))
        return bool((changes <= self.flat * sizes).all())

    @property
    def range(self) -> Range:
        """Least and largest of the values, and of the limits that are not far from them."""
        low, high = float(self.values.min()), float(self.values.max())
        near = [level for level in self.levels if 2 * low - high <= level <= 2 * high - low]
        return min([low, *near]), max([high, *near])


def log_plot(recording: rr.RecordingStream, plot: Plot, under: str = "") -> None:
    """Log the lines of a plot, as float64, their entity below another."""
    every, entity = at_most(SIGNALS_HZ, plot.time_s), f"{under}{plot.entity}"
    time_s, values = plot.time_s[every], plot.values[every]
    log_series(recording, time_column(time_s), entity, plot.names, values)
    for column, since_s in plot.failed:
        within, name = time_s >= since_s - 1e-9, f"{plot.names[column]}, failed"
        thick, where = {"color": FAILED, "width": 3.0}, f"{entity}/failed_{column}"
        times = time_column(time_s[within])
        log_series(recording, times, where, [name], values[within, column], **thick)


def log_lines(
    recording: rr.RecordingStream, plot: Plot, lines: Sequence[Line], axis: Range, under: str
) -> None:
    """Log events as vertical lines over the axis of a plot, and the limits within it."""
    entity, (low, high) = f"{under}{plot.entity}", axis
    begin_s, end_s = plot.time_s[[0, -1]]
    within = [line for line in lines if begin_s < line.time_s <= end_s]
    colors = sorted({line.color for line in within})
    for number, color in enumerate(colors):
        first, *more = [line for line in within if line.color == color]
        name = f"{first.name} and {len(more)} more" if more else first.name
        times = time_column(np.repeat([line.time_s for line in (first, *more)], 3))
        values = np.tile([low, high, np.nan], 1 + len(more))  # with a gap after each
        where = f"{entity}/event_{number}"
        log_series(recording, times, where, [name], values, color=color, width=1.0)
    levels = sorted({level for level in plot.levels if low <= level <= high})
    if levels:
        times, values = time_column(np.array([begin_s, end_s])), np.tile(levels, (2, 1))
        names = ["limit"] * len(levels)
        log_series(recording, times, f"{entity}/limits", names, values, color=_LIMIT, width=1.5)


def plot_view(
    plot: Plot, axis: Range, under: str = "", *, legend: bool = True, is_wide: bool = True
) -> rrb.TimeSeriesView:
    """A view of a plot with this axis; where there is room its title states the range of values."""
    low, high = plot.range
    words = [plot.title, f"{low:.3g} to {high:.3g}", plot.note] if is_wide else [plot.title]
    times = [rrb.TimeRangeBoundary.absolute(seconds=float(t)) for t in plot.time_s[[0, -1]]]
    return rrb.TimeSeriesView(
        origin=f"{under}{plot.entity}",
        name=", ".join(filter(None, words)),
        axis_x=rrb.archetypes.TimeAxis(view_range=rr.TimeRange(*times)),
        axis_y=rrb.ScalarAxis(range=axis),
        plot_legend=rrb.PlotLegend(rrb.Corner2D.LeftTop, visible=legend),
    )


def axis_of(low: float, high: float, room: float) -> Range:
    """The axis that holds these values and three ticks at least, with room for so many.

    The viewer puts ticks at multiples of powers of ten.
    """
    span = max(high - low, 1e-12, 1e-9 * abs(high))
    step = 10.0 ** np.ceil(np.log10(span / room) - 1e-9)
    first, last = np.ceil(low / step), np.floor(high / step)
    for _ in range(max(0, round(2 - (last - first)))):  # towards the value that is nearer
        up = (last + 1) * step - high <= low - (first - 1) * step or low >= 0 >= first
        first, last = (first, last + 1) if up else (first - 1, last)
    low, high = min(low, first * step), max(high, last * step)
    margin = 0.04 * (high - low)
    return float(low - margin), float(high + margin)
