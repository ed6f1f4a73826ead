"""One recording of several hexapod runs: a column each, the same scales in all of them."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import mujoco
import rerun.blueprint as rrb

from experiments.hexapod.recording.shown import Scales, Shown, log_shown, scales_of
from experiments.output.recording.file import About, recording_file, screen
from experiments.output.recording.machine import machine_tabs
from experiments.output.recording.plane import plane_view
from experiments.output.recording.series import Plot, notes_view, plot_views

RATE_HZ = 100
_SIGNALS = (
    ("pointing/error", "error", "urad"),
    ("strut/input", "inputs", "%"),
    ("secondary/true", "SDOF", "urad, um"),
)
FEW = 3
"""Columns that leave room for the hexapod beside the plots; more have it on a page of its own."""
MANY = 6
"""Columns on a page."""


def write_side_by_side(
    path: Path, about: About, model: mujoco.MjModel, shown: Mapping[str, Shown]
) -> None:
    """Write runs of the same machine as one `.rrd` file.

    Args:
        path: File to write.
        about: What it says of itself.
        model: The machine that is drawn.
        shown: Runs by their names.

    Raises:
        Exception: Whatever the writer complains of; it runs in strict mode.
    """
    scales = scales_of([one.run for one in shown.values()])
    with recording_file(path, about, _screen(model, shown, scales)) as recording:
        for k, one in enumerate(shown.values()):
            log_shown(recording, f"{_entity(k)}/", model, one, scales, RATE_HZ)


def _entity(k: int) -> str:
    return f"run_{k}"


def _screen(model: mujoco.MjModel, shown: Mapping[str, Shown], scales: Scales) -> rrb.Blueprint:
    limits = scales.bounds
    extras = zip(*(one.extras for one in shown.values()), strict=True)
    ranges = [_range_of(plots) for plots in extras]

    def machine(k: int, name: str) -> rrb.Tabs:
        return machine_tabs(
            f"{_entity(k)}/hexapod", f"{name}; {scales.loads}", model, scales.factor
        )

    def signals(k: int) -> list[rrb.View]:
        # Small plots have no room for a scale: the title says it; nor for more than one legend.
        return [
            rrb.TimeSeriesView(
                origin=f"{_entity(k)}/{entity}",
                name=f"{words} ±{limits[entity]:.3g} {unit}",
                axis_y=rrb.ScalarAxis(range=(-limits[entity], limits[entity])),
                plot_legend=rrb.PlotLegend(visible=k == 0),
            )
            for entity, words, unit in _SIGNALS
        ]

    def column(k: int, name: str, one: Shown) -> rrb.Container:
        detector = plane_view(f"{_entity(k)}/detector", f"{name} [urad]", scales.square_urad)
        plots = [*signals(k), *plot_views(one.extras, f"{_entity(k)}/", ranges)]
        if len(shown) > FEW:
            return rrb.Vertical(detector, *plots)
        return rrb.Horizontal(rrb.Vertical(machine(k, name), detector), rrb.Vertical(*plots))

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


def _range_of(plots: Sequence[Plot]) -> tuple[float, float]:
    """Of the values of all of them: the same scale in every column."""
    return float(min(p.values.min() for p in plots)), float(max(p.values.max() for p in plots))
