"""Recordings of hexapod runs: one run on a screen of its own, or several side by side."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import mujoco
import rerun.blueprint as rrb

from experiments.recording import Array
from experiments.recording.file import RecordingInfo, recording_file, round_up, screen
from experiments.recording.hexapod import log_marks
from experiments.recording.mechanism import machine_tabs
from experiments.recording.shown import (
    Scales,
    Shown,
    log_detector,
    log_error_plane,
    log_shown,
    scales_of,
    signals_of,
)
from experiments.recording.views import Plot, legend_off, notes_view, plane_view, plot_views
from experiments.rig.hexapod.simulation import Trajectory

RATE_HZ = 500
"""Of the signals of a single run."""
SIDE_BY_SIDE_HZ = 100
FEW = 3
"""Columns that leave room for the hexapod beside the plots; more have it on a page of its own."""
MANY = 6
"""Columns on a page."""

_DETECTOR = "Detector: beta over alpha [urad]; desired orange, measured blue"
_TITLES = {
    "pointing/error": "Pointing error, desired - true [urad]",
    "strut/input": "Strut inputs [%]",
    "secondary/true": "Secondary motion [urad], [um]",
    "closure/residual": "Closure residual [nm]",
}
_SHORT = {"pointing/error": "error ±{:.3g} urad", "strut/input": "inputs ±{:.3g} %"}
_SHORT |= {"secondary/true": "SDOF ±{:.3g} urad, um"}
_SHORT_SHARES = (4, 3, 5, 4)
"""Heights of the plane of errors and of these: six names need room."""


def write_run(path: Path, about: RecordingInfo, model: mujoco.MjModel, shown: Shown) -> None:
    """Write one run as an `.rrd` file, drawn as the hexapod of this MJCF."""
    scales = scales_of([shown.run])
    with recording_file(path, about, _single(model, shown, scales)) as recording:
        log_shown(recording, "", model, shown, scales, RATE_HZ)
        log_detector(recording, shown.run, scales)
        if shown.marks:
            log_marks(recording, shown.marks, shown.run)


def write_side_by_side(
    path: Path, about: RecordingInfo, model: mujoco.MjModel, shown: Mapping[str, Shown]
) -> None:
    """Write runs of the same machine, by their names, as one `.rrd` file: a column each."""
    scales = scales_of([one.run for one in shown.values()])
    with recording_file(path, about, _columns(model, shown, scales)) as recording:
        for k, one in enumerate(shown.values()):
            log_shown(recording, f"{_entity(k)}/", model, one, scales, SIDE_BY_SIDE_HZ)
            log_error_plane(recording, f"{_entity(k)}/error_plane", one.run, scales)


def _single(model: mujoco.MjModel, shown: Shown, scales: Scales) -> rrb.Blueprint:
    machine = machine_tabs("hexapod", f"motion; {scales.loads}", model, scales.factor)
    values = signals_of(shown.run)
    error, *signals = (
        _signal(entity, values[entity][1], scales.bounds[entity]) for entity in _TITLES
    )
    extras = plot_views(shown.extras)
    below: list[rrb.View] = [notes_view()]
    pointing: list[rrb.View] = [plane_view("detector", _DETECTOR, scales.square_urad), error]
    # What was there from the start is no event.
    if any(mark.failed_s > shown.run.time_s[0] for mark in shown.marks):
        below.append(rrb.TextLogView(origin="events", name="Events"))
        pointing.append(rrb.StateTimelineView(origin="state", name="Struts"))
    return screen(
        rrb.Horizontal(
            rrb.Vertical(machine, *below, row_shares=[5, 4, 2][: 1 + len(below)]),
            rrb.Vertical(*pointing, row_shares=[10, 6, 1 + len(shown.marks)][: len(pointing)]),
            # Six names and the marks need room above the lines.
            rrb.Vertical(*signals, *extras, row_shares=[11, 6, 4] + [4] * len(extras)),
        )
    )


def _signal(entity: str, values: Array, bound: float) -> rrb.TimeSeriesView:
    high = round_up(bound)
    low = 0.0 if entity == "closure/residual" else -high
    return rrb.TimeSeriesView(
        origin=entity,
        name=_TITLES[entity],
        axis_y=rrb.ScalarAxis(range=(low, high)),
        plot_legend=legend_off(values, low, high),
    )


def _entity(k: int) -> str:
    return f"run_{k}"


def _columns(model: mujoco.MjModel, shown: Mapping[str, Shown], scales: Scales) -> rrb.Blueprint:
    ranges = [
        _range_of(plots) for plots in zip(*(one.extras for one in shown.values()), strict=True)
    ]

    def machine(k: int, name: str) -> rrb.Tabs:
        title = f"{name}; {scales.loads}"
        return machine_tabs(f"{_entity(k)}/hexapod", title, model, scales.factor)

    def column(k: int, name: str, one: Shown) -> rrb.Container:
        errors = plane_view(f"{_entity(k)}/error_plane", name, scales.error_urad)
        plots = [
            *_small_signals(k, one.run, scales),
            *plot_views(one.extras, f"{_entity(k)}/", ranges),
        ]
        if len(shown) > FEW:
            shares = [*_SHORT_SHARES, *[3] * len(one.extras)]
            return rrb.Vertical(errors, *plots, row_shares=shares)
        return rrb.Horizontal(rrb.Vertical(machine(k, name), errors), rrb.Vertical(*plots))

    columns = [column(k, name, one) for k, (name, one) in enumerate(shown.items())]
    if len(shown) <= FEW:
        shares = [1] + [2] * len(columns)
        return screen(rrb.Horizontal(notes_view(), *columns, column_shares=shares))
    hexapods = rrb.Grid(*(machine(k, name) for k, name in enumerate(shown)), name="Hexapods")
    pages = [
        rrb.Horizontal(*columns[begin : begin + MANY], name=f"Side by side, from {begin + 1}")
        for begin in range(0, len(columns), MANY)
    ]
    return screen(rrb.Tabs(*pages, hexapods, notes_view(), active_tab=0))


def _small_signals(k: int, run: Trajectory, scales: Scales) -> list[rrb.View]:
    """The signals of run k: no room for a scale, which the title states; one legend a row."""
    values = signals_of(run)

    def view(entity: str, title: str) -> rrb.TimeSeriesView:
        bound = scales.bounds[entity]
        legend = legend_off(values[entity][1], -bound, bound)
        return rrb.TimeSeriesView(
            origin=f"{_entity(k)}/{entity}",
            name=title.format(bound),
            axis_y=rrb.ScalarAxis(range=(-bound, bound)),
            plot_legend=legend if k == 0 else rrb.PlotLegend(visible=False),
        )

    return [view(entity, title) for entity, title in _SHORT.items()]


def _range_of(plots: Sequence[Plot]) -> tuple[float, float]:
    """Of the values of all plots: the same scale in every column."""
    return float(min(p.values.min() for p in plots)), float(max(p.values.max() for p in plots))
