"""What every Rerun recording shares: opening, time, lines, and a screen with nothing but views."""

from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from sim import Array

# Okabe and Ito's palette.
COLORS = [
    [0, 114, 178],
    [213, 94, 0],
    [0, 158, 115],
    [204, 121, 167],
    [230, 159, 0],
    [86, 180, 233],
]


def write_series(
    path: Path,
    recording_id: str,
    name: str,
    runs: dict[str, tuple[Array, list[str], Array]],
    notes: str,
    properties: dict[str, Any],
) -> None:
    """Write named time series as an `.rrd` file, one plot each.

    Args:
        path: File to write.
        recording_id: What tells it from all others.
        name: What a person reads.
        runs: Times [s] (T,), names of the lines with their units, and values (T, k), by the title
            of their plot; they become the entities run_0, run_1, ...
        notes: Markdown shown beside the plots.
        properties: Recording properties.

    Raises:
        Exception: Whatever the writer complains of; it runs in strict mode.
    """
    entities = {title: f"run_{k}" for k, title in enumerate(runs)}
    plots = [rrb.TimeSeriesView(origin=entity, name=title) for title, entity in entities.items()]
    views = rrb.Horizontal(
        rrb.TextDocumentView(origin="notes", name="Run"),
        rrb.Grid(*plots),
        column_shares=[1, 3],
    )
    recording = open_recording(path, recording_id, name, notes, properties, screen(views))
    for title, (time_s, names, values) in runs.items():
        log_series(recording, time_column(time_s), entities[title], names, values)
    recording.disconnect()


def open_recording(
    path: Path,
    recording_id: str,
    name: str,
    notes: str,
    properties: dict[str, Any],
    blueprint: rrb.Blueprint,
) -> rr.RecordingStream:
    """A recording that goes to a file, with its blueprint, properties and notes inside."""
    rr.set_strict_mode(True)
    recording = rr.RecordingStream("fjh", recording_id=recording_id, send_properties=False)
    recording.save(path, default_blueprint=blueprint)
    recording.set_log_time_enabled(False)
    recording.send_recording_name(name)
    recording.send_property("run", rr.AnyValues(**properties))
    document = rr.TextDocument(notes, media_type=rr.MediaType.MARKDOWN)
    recording.log("notes", document, static=True)
    return recording


def time_column(time_s: Array) -> rr.TimeColumn:
    """Simulation time in whole nanoseconds."""
    return rr.TimeColumn("sim_time", duration=np.rint(time_s * 1e9).astype("timedelta64[ns]"))


def log_series(
    recording: rr.RecordingStream,
    time: rr.TimeColumn,
    entity: str,
    names: list[str],
    values: Array,
) -> None:
    """Log one line for each column of `values`, as float64; names carry the units."""
    style = rr.SeriesLines(names=names, colors=COLORS[: len(names)])
    recording.log(entity, style, static=True)
    columns = rr.Scalars.columns(scalars=values)
    recording.send_columns(entity, indexes=[time], columns=columns)


def screen(views: rrb.Horizontal) -> rrb.Blueprint:
    """The views alone, on simulation time."""
    return rrb.Blueprint(
        views,
        rrb.TimePanel(timeline="sim_time", state="collapsed", play_state="paused"),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        rrb.TopPanel(state="hidden"),
        auto_views=False,
    )
