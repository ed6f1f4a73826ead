"""Rerun recordings: one file per run, made after the run, opened without a click.

The `.rrd` is a view at 250 Hz; the `.npz` beside it is the record.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from experiments.marks import Mark, log_marks
from experiments.rerun_file import COLORS, log_series, open_recording, screen, time_column
from experiments.run import Trajectory
from sim import Array

RATE_HZ = 250
STRUTS = [f"strut {k} [%]" for k in range(1, 7)]
SECONDARY = ["gamma [urad]", "t_x [um]", "t_y [um]", "t_z [um]"]
POINTING = ["alpha error [urad]", "beta error [urad]"]


def write_recording(
    path: Path,
    recording_id: str,
    name: str,
    run: Trajectory,
    notes: str,
    properties: dict[str, Any],
    marks: Sequence[Mark] = (),
) -> None:
    """Write one run as an `.rrd` file.

    Args:
        path: File to write.
        recording_id: What tells it from all others: experiment, column and seed.
        name: What a person reads.
        run: The run.
        notes: Markdown shown beside the plots.
        properties: Recording properties: seed, versions, model hash, bench constants.
        marks: Failures in flight, and when they were found.

    Raises:
        Exception: Whatever the writer complains of; it runs in strict mode.
    """
    screen = _blueprint(name, with_marks=bool(marks))
    recording = open_recording(path, recording_id, name, notes, properties, screen)
    tick_s = float(run.time_s[1] - run.time_s[0])
    every = slice(None, None, max(1, round(1 / (RATE_HZ * tick_s))))
    time = time_column(run.time_s[every])

    def series(entity: str, names: list[str], values: Array) -> None:
        log_series(recording, time, entity, names, values[every])

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
    if marks:
        log_marks(recording, marks, run.time_s, run.strut_input_percent)
    recording.disconnect()


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


def _blueprint(name: str, with_marks: bool) -> rrb.Blueprint:
    def plot(entity: str, title: str) -> rrb.TimeSeriesView:
        return rrb.TimeSeriesView(origin=entity, name=title)

    on_the_left: list[rrb.View] = [
        rrb.Spatial2DView(
            origin="detector", name=f"{name}: detector plane, alpha right, beta up [urad]"
        ),
        rrb.TextDocumentView(origin="notes", name="Run"),
    ]
    on_the_right: list[rrb.View] = [
        plot("pointing/error", "Pointing error, desired - true [urad]"),
        plot("strut/input", "Strut inputs [%]"),
        plot("secondary/true", "Secondary motion [urad], [um]"),
        plot("closure/residual", "Closure residual [nm]"),
    ]
    if with_marks:
        on_the_left.append(rrb.TextLogView(origin="events", name="What happened"))
        on_the_right.insert(0, rrb.StateTimelineView(origin="state", name="Struts"))
    return screen(
        rrb.Horizontal(
            rrb.Vertical(*on_the_left, row_shares=[4, 2, 1][: len(on_the_left)]),
            rrb.Vertical(*on_the_right, row_shares=[1.8, 1, 1, 1, 1][-len(on_the_right) :]),
        )
    )
