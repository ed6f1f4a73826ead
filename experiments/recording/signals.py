"""Signals over time with their events, and the axes on which they are seen."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from experiments.recording import Array
from experiments.recording.file import at_most, log_series, rgb, time_column
from experiments.study.palette import BLACK, FAILED

SIGNALS_HZ = 200
"""Of signals over time; every value is a copy of one of the run's."""
_LIMIT = "#787878"
_WHITE = [240, 240, 240]
_FLAT = 1e-9
_TICKS_PX, _TIMES_PX = 24.0, 66.0
"""Pixels that the viewer wants between the ticks of an axis, which stand at powers of ten."""
_WASTE = 1.35
"""Up to so many times its length a time axis is extended to have a third tick."""
_WIDE_PX = 300
"""A narrower view has room for a short title only."""
_SERIES = 8
"""More names than these hide the plot."""

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
        """Of the values, and of the limits that are not far from them."""
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
        _log_line(recording, f"{entity}/failed_{column}", [name], FAILED, 3.0,
                  time_s[within], values[within, column])  # fmt: skip


def log_lines(
    recording: rr.RecordingStream, plot: Plot, lines: Sequence[Line], limits: Range, under: str
) -> None:
    """Log events as vertical lines over the range of a plot's axis, and the limits within it."""
    entity, (low, high) = f"{under}{plot.entity}", limits
    begin_s, end_s = plot.time_s[[0, -1]]
    struck = [line for line in lines if begin_s < line.time_s <= end_s]
    for number, (color, each) in enumerate(
        groupby(sorted(struck, key=lambda line: line.color), key=lambda line: line.color)
    ):
        first, *more = each
        name = f"{first.name} and {len(more)} more" if more else first.name
        times = np.repeat([line.time_s for line in (first, *more)], 3)
        values = np.tile([low, high, np.nan], 1 + len(more))  # with a gap after each
        _log_line(recording, f"{entity}/event_{number}", [name], color, 1.0, times, values)
    levels = sorted({level for level in plot.levels if low <= level <= high})
    if levels:
        names, times = ["limit"] * len(levels), np.array([begin_s, end_s])
        values = np.tile(levels, (2, 1))
        _log_line(recording, f"{entity}/limits", names, _LIMIT, 1.5, times, values)


def _log_line(
    recording: rr.RecordingStream,
    entity: str,
    names: Sequence[str],
    color: str,
    width: float,
    time_s: Array,
    values: Array,
) -> None:
    shown = _WHITE if color == BLACK else rgb(color)  # on the viewer's dark background
    style = rr.SeriesLines(
        names=names,
        colors=[shown] * len(names),
        widths=[width] * len(names),
        aggregation_policy=rr.components.AggregationPolicy.Off,
    )
    recording.log(entity, style, static=True)
    recording.send_columns(entity, [time_column(time_s)], rr.Scalars.columns(scalars=values))


def plot_view(
    plot: Plot, limits: Range, under: str = "", *, width_px: float = 480, legend: bool = True
) -> rrb.TimeSeriesView:
    """A view of a plot whose axis has this range; its title states that of the values."""
    low, high = plot.range
    span = f"{low:.3g} to {high:.3g}"
    words = [plot.title, span, plot.note] if width_px > _WIDE_PX else [plot.title]
    end_s = _axis_end(plot.time_s, width_px)
    times = (rrb.TimeRangeBoundary.absolute(seconds=t) for t in (float(plot.time_s[0]), end_s))
    off = rrb.PlotLegend(visible=False)
    if legend and len(plot.names) <= _SERIES:
        share = float(np.ptp(plot.time_s)) / (end_s - float(plot.time_s[0]))
        off = legend_off(plot.values, *limits, share)
    return rrb.TimeSeriesView(
        origin=f"{under}{plot.entity}",
        name=", ".join(filter(None, words)),
        axis_x=rrb.archetypes.TimeAxis(view_range=rr.TimeRange(*times)),
        axis_y=rrb.ScalarAxis(range=limits),
        plot_legend=off,
    )


def axis_range(low: float, high: float, height_px: float) -> Range:
    """The range of an axis so high that holds these values and has three ticks at least."""
    span = max(high - low, 1e-12, 1e-9 * abs(high))
    step = 10.0 ** np.floor(np.log10(span) - 1)
    while span / step > max(2.0, height_px / _TICKS_PX):
        step *= 10
    first, last = np.ceil(low / step), np.floor(high / step)
    for _ in range(max(0, round(2 - (last - first)))):  # towards the value that is nearer
        up = (last + 1) * step - high <= low - (first - 1) * step or low >= 0 >= first
        first, last = (first, last + 1) if up else (first - 1, last)
    low, high = min(low, first * step), max(high, last * step)
    margin = 0.04 * (high - low)
    return float(low - margin), float(high + margin)


def _axis_end(time_s: Array, width_px: float) -> float:
    """The end of a run, or the third tick of its axis if that is not far beyond [s]."""
    begin_s, end_s = map(float, time_s[[0, -1]])
    step = 10.0 ** np.floor(np.log10(end_s - begin_s) - 1)
    while (end_s - begin_s) / step > max(2.0, width_px / _TIMES_PX):
        step *= 10
    third_s = step * (np.ceil(begin_s / step - 1e-9) + 2.08)
    beyond = end_s < third_s <= begin_s + _WASTE * (end_s - begin_s)
    return float(third_s) if beyond else end_s


def legend_off(values: Array, low: float, high: float, share: float = 1.0) -> rrb.PlotLegend:
    """A legend in the corner where it hides least of k lines (T, k), in a plot from low to high.

    It is taken to be as wide as a quarter of the plot, and a fourteenth as high for each. The lines
    take a share of the plot's width, the first.
    """
    quarter = max(1, round(len(values) / 4 / share))
    last = max(1, quarter - round(len(values) * (1 / share - 1)))
    depth = values.shape[1] / 14 * (high - low)
    parts = {"Left": values[:quarter], "Right": values[-last:]}
    hidden = {
        f"{side}{edge}": np.count_nonzero(beyond)
        for side, part in parts.items()
        for edge, beyond in (("Top", part > high - depth), ("Bottom", part < low + depth))
    }
    return rrb.PlotLegend(rrb.Corner2D[min(hidden, key=hidden.__getitem__)])
