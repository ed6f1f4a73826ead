"""Signals over time, and the notes beside them."""

from collections.abc import Sequence
from dataclasses import dataclass

import rerun as rr
import rerun.blueprint as rrb

from experiments.output.recording.file import log_series, time_column
from sim import Array


@dataclass(frozen=True)
class Plot:
    """Lines over time.

    Attributes:
        entity: Where in the recording.
        title: What a person reads.
        names: Of the lines, with their units.
        time_s: Shape (T,).
        values: Shape (T, k).
    """

    entity: str
    title: str
    names: Sequence[str]
    time_s: Array
    values: Array


def log_plots(recording: rr.RecordingStream, plots: Sequence[Plot], under: str = "") -> None:
    """Log the lines of each plot, as float64, their entities below another."""
    for plot in plots:
        time = time_column(plot.time_s)
        log_series(recording, time, f"{under}{plot.entity}", plot.names, plot.values)


def plot_views(
    plots: Sequence[Plot], under: str = "", ranges: Sequence[tuple[float, float]] = ()
) -> list[rrb.TimeSeriesView]:
    """A view of each; its title says from where to where the values go, or the ranges given."""
    spans = ranges or [(float(plot.values.min()), float(plot.values.max())) for plot in plots]
    return [
        rrb.TimeSeriesView(
            origin=f"{under}{plot.entity}",
            name=f"{plot.title}, {low:.3g} to {high:.3g}",
            axis_y=rrb.ScalarAxis(range=(low, high)) if high > low else None,
        )
        for plot, (low, high) in zip(plots, spans, strict=True)
    ]


def notes_view() -> rrb.TextDocumentView:
    """What the recording says of itself."""
    return rrb.TextDocumentView(origin="notes", name="Notes")
