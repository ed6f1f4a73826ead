"""The recording of one hexapod run: in 3D, on the detector, and every signal over time."""

from pathlib import Path

import mujoco
import rerun.blueprint as rrb

from experiments.hexapod.recording.shown import Scales, Shown, log_shown, scales_of
from experiments.output.recording.file import About, recording_file, screen
from experiments.output.recording.machine import machine_tabs
from experiments.output.recording.marks import happens_in_flight, log_marks
from experiments.output.recording.plane import plane_view
from experiments.output.recording.scale import round_up
from experiments.output.recording.series import notes_view, plot_views

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
    scales = scales_of([shown.run])
    with recording_file(path, about, _screen(model, shown, scales)) as recording:
        log_shown(recording, "", model, shown, scales, RATE_HZ)
        if shown.marks:
            log_marks(recording, shown.marks, shown.run)


def _signal_views(bounds: dict[str, float]) -> list[rrb.View]:
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

    items = zip(titles, bounds.items(), strict=True)
    return [view(title, entity, bound) for title, (entity, bound) in items]


def _screen(model: mujoco.MjModel, shown: Shown, scales: Scales) -> rrb.Blueprint:
    machine = machine_tabs("hexapod", f"motion; {scales.loads}", model, scales.factor)
    error, *signals = _signal_views(scales.bounds)
    story: list[rrb.View] = [notes_view()]
    pointing: list[rrb.View] = [
        plane_view("detector", DETECTOR, scales.square_urad),
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
