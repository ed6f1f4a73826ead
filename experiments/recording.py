"""Rerun recordings: one file per run, made after the run, opened without a click.

The `.rrd` is a view at 250 Hz; the `.npz` beside it is the record.
"""

from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from experiments.run import Trajectory
from sim import Array

RATE_HZ = 250
STRUTS = [f"strut {k} [%]" for k in range(1, 7)]
SECONDARY = ["gamma [urad]", "t_x [um]", "t_y [um]", "t_z [um]"]
POINTING = ["alpha error [urad]", "beta error [urad]"]

# Okabe and Ito's palette.
COLORS = [
    [0, 114, 178],
    [213, 94, 0],
    [0, 158, 115],
    [204, 121, 167],
    [230, 159, 0],
    [86, 180, 233],
]


def write_recording(
    path: Path,
    recording_id: str,
    name: str,
    run: Trajectory,
    notes: str,
    properties: dict[str, Any],
) -> None:
    """Write one run as an `.rrd` file.

    Args:
        path: File to write.
        recording_id: What tells it from all others: experiment, column and seed.
        name: What a person reads.
        run: The run.
        notes: Markdown shown beside the plots.
        properties: Recording properties: seed, versions, model hash, bench constants.

    Raises:
        Exception: Whatever the writer complains of; it runs in strict mode.
    """
    recording = _open(path, recording_id, name, notes, properties, _blueprint(name))
    tick_s = float(run.time_s[1] - run.time_s[0])
    every = slice(None, None, max(1, round(1 / (RATE_HZ * tick_s))))
    time = _time_column(run.time_s[every])

    def series(entity: str, names: list[str], values: Array) -> None:
        _series(recording, time, entity, names, values[every])

    angles = ["alpha [urad]", "beta [urad]"]
    series("pointing/desired", angles, 1e6 * run.desired_rad)
    series("pointing/true", angles, 1e6 * run.true_rad)
    series("pointing/measured", angles, 1e6 * run.measured_rad)
    series("pointing/error", POINTING, 1e6 * (run.desired_rad - run.true_rad))
    series("strut/input", STRUTS, run.strut_input_percent)
    struts_um = [f"strut {k} [um]" for k in range(1, 7)]
    series("strut/displacement", struts_um, 1e6 * run.strut_displacement_m)
    series("secondary/true", SECONDARY, 1e6 * run.secondary)
    series("secondary/estimated", SECONDARY, 1e6 * run.secondary_estimated)
    series("closure/residual", ["closure [nm]"], 1e9 * run.closure_residual_m[:, None])
    _detector_plane(recording, time, run, every)
    recording.disconnect()


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
    recording = _open(path, recording_id, name, notes, properties, _screen(views))
    for title, (time_s, names, values) in runs.items():
        _series(recording, _time_column(time_s), entities[title], names, values)
    recording.disconnect()


def _open(
    path: Path,
    recording_id: str,
    name: str,
    notes: str,
    properties: dict[str, Any],
    blueprint: rrb.Blueprint,
) -> rr.RecordingStream:
    rr.set_strict_mode(True)
    recording = rr.RecordingStream("fjh", recording_id=recording_id, send_properties=False)
    recording.save(path, default_blueprint=blueprint)
    recording.set_log_time_enabled(False)
    recording.send_recording_name(name)
    recording.send_property("run", rr.AnyValues(**properties))
    document = rr.TextDocument(notes, media_type=rr.MediaType.MARKDOWN)
    recording.log("notes", document, static=True)
    return recording


def _time_column(time_s: Array) -> rr.TimeColumn:
    return rr.TimeColumn("sim_time", duration=np.rint(time_s * 1e9).astype("timedelta64[ns]"))


def _series(
    recording: rr.RecordingStream,
    time: rr.TimeColumn,
    entity: str,
    names: list[str],
    values: Array,
) -> None:
    style = rr.SeriesLines(names=names, colors=COLORS[: len(names)])
    recording.log(entity, style, static=True)
    columns = rr.Scalars.columns(scalars=values)
    recording.send_columns(entity, indexes=[time], columns=columns)


def _detector_plane(
    recording: rr.RecordingStream, time: rr.TimeColumn, run: Trajectory, every: slice
) -> None:
    # Image axes run down: beta is drawn upwards.
    flip = np.array([1e6, -1e6])
    desired, measured = run.desired_rad[every] * flip, run.measured_rad[every] * flip
    for label, line, color in (
        ("desired", desired, [120, 120, 120]),
        ("measured", measured, COLORS[0]),
    ):
        recording.log(
            f"detector/{label}",
            rr.LineStrips2D([line], colors=[color], radii=[0.3]),
            static=True,
        )
    recording.log(
        "detector/spot", rr.Points2D.from_fields(colors=[COLORS[1]], radii=[2.0]), static=True
    )
    recording.send_columns(
        "detector/spot",
        indexes=[time],
        columns=rr.Points2D.columns(positions=measured),
    )


def _blueprint(name: str) -> rrb.Blueprint:
    def plot(entity: str, title: str) -> rrb.TimeSeriesView:
        return rrb.TimeSeriesView(origin=entity, name=title)

    return _screen(
        rrb.Horizontal(
            rrb.Vertical(
                rrb.Spatial2DView(
                    origin="detector", name=f"{name}: detector plane, alpha right, beta up [urad]"
                ),
                rrb.TextDocumentView(origin="notes", name="Run"),
                row_shares=[2, 1],
            ),
            rrb.Vertical(
                plot("pointing/error", "Pointing error, desired - true [urad]"),
                plot("strut/input", "Strut inputs [%]"),
                plot("secondary/true", "Secondary motion [urad], [um]"),
                plot("closure/residual", "Closure residual [nm]"),
            ),
        )
    )


def _screen(views: rrb.Horizontal) -> rrb.Blueprint:
    """The views alone, on simulation time."""
    return rrb.Blueprint(
        views,
        rrb.TimePanel(timeline="sim_time", state="collapsed", play_state="paused"),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        rrb.TopPanel(state="hidden"),
        auto_views=False,
    )
