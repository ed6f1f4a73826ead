"""The recording of one hexapod run: in 3D, on the detector, and every signal over time."""

from pathlib import Path

import mujoco
import numpy as np
import rerun.blueprint as rrb

from experiments.recording.file import About, recording_file, screen
from experiments.recording.hexapod import log_hexapod
from experiments.recording.machine import machine_tabs, sized_entity, sizes
from experiments.recording.marks import happens_in_flight, log_marks
from experiments.recording.plane import plane_view
from experiments.recording.series import log_plots, notes_view, plot_views
from experiments.recording.shown import (
    Shown,
    bounds,
    exaggeration_of,
    full_scale_percent,
    loads_name,
    log_detector,
    log_signals,
    picture_of,
    square_urad,
)
from experiments.run import Trajectory

RATE_HZ = 500
DETECTOR = "Detector: beta over alpha [urad]; desired orange, measured blue"


def write_run(path: Path, about: About, model: mujoco.MjModel, shown: Shown) -> None:
    """Write one run as an `.rrd` file.

    Args:
        path: File to write.
        about: What it says of itself.
        model: The machine that is drawn.
        shown: The run.

    Raises:
        Exception: Whatever the writer complains of; it runs in strict mode.
    """
    factor, full_percent = exaggeration_of([shown.run]), full_scale_percent([shown.run])
    views = _screen(model, shown, factor, full_percent)
    with recording_file(path, about, views) as recording:
        log_signals(recording, "", shown.run, RATE_HZ)
        log_detector(recording, "detector", shown.run, square_urad([shown.run]))
        for size in sizes(factor):
            picture = picture_of(shown, size, full_percent)
            log_hexapod(recording, sized_entity("hexapod", size), model, picture)
        log_plots(recording, shown.extras)
        if shown.marks:
            log_marks(recording, shown.marks, shown.run)


def round_up(value: float) -> float:
    """The next of 1, 2, 5, 10, ...: axes that end there are labelled."""
    decade = 10.0 ** np.floor(np.log10(value)) if value > 0 else 1.0
    return float(decade * min(step for step in (1, 2, 5, 10) if step * decade >= value))


def _signal_views(run: Trajectory) -> list[rrb.View]:
    titles = (
        "Pointing error, desired - true [urad]",
        "Strut inputs [%]",
        "Secondary motion [urad], [um]",
        "Closure residual [nm]",
    )

    def view(title: str, entity: str, bound: float) -> rrb.TimeSeriesView:
        high = round_up(bound)
        axis = rrb.ScalarAxis(range=(0.0 if entity == "closure/residual" else -high, high))
        return rrb.TimeSeriesView(origin=entity, name=title, axis_y=axis)

    items = zip(titles, bounds([run]).items(), strict=True)
    return [view(title, entity, bound) for title, (entity, bound) in items]


def _screen(model: mujoco.MjModel, shown: Shown, factor: int, full_percent: float) -> rrb.Blueprint:
    machine = machine_tabs("hexapod", f"motion; {loads_name(full_percent)}", model, factor)
    error, *signals = _signal_views(shown.run)
    story: list[rrb.View] = [notes_view()]
    pointing: list[rrb.View] = [
        plane_view("detector", DETECTOR, square_urad([shown.run])),
        error,
    ]
    if happens_in_flight(shown.marks, shown.run.time_s):
        story.append(rrb.TextLogView(origin="events", name="What happens"))
        pointing.append(rrb.StateTimelineView(origin="state", name="Struts"))
    return screen(
        rrb.Horizontal(
            rrb.Vertical(machine, *story, row_shares=[5, 4, 2][: 1 + len(story)]),
            rrb.Vertical(*pointing, row_shares=[10, 6, 1 + len(shown.marks)][: len(pointing)]),
            rrb.Vertical(*signals, *plot_views(shown.extras)),
        )
    )
