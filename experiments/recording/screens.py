"""The layout of recordings: one flight, two or three side by side, many; conditions of a machine.

Sizes are those of a window of 1600 x 900 pixels.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import rerun as rr
import rerun.blueprint as rrb

from experiments.recording.file import RecordingInfo, recording_file, screen
from experiments.recording.machine import machine_view
from experiments.recording.scene import Scene, log_scene, scenes_of
from experiments.recording.shown import ERROR, Shown
from experiments.recording.signals import Plot, Range, axis_range, plot_view
from experiments.recording.views import notes_view, plane_view

Axes = Mapping[str, Range]
"""Of the panels of a scene, by entity."""
FEW = 3
"""Flights that leave room for the robot beside the plots; of more it has a page of its own."""
MANY = 6
"""Flights on a page."""
_ROOM = 4
"""Panels below each other that leave room for the ticks of each, beside others."""
_WIDTH, _HEIGHT = 1600, 880
_SIGNALS = 0.7
"""Share of the width."""
_NAME_PX = 21
"""Of a name in a legend."""
_AROUND_PX = 46
"""Of a panel: its title, and the times below."""


@dataclass(frozen=True)
class Layout:
    """All views of a recording; of each scene, where it is logged, and the axes of its panels."""

    views: rrb.Container
    places: Sequence[tuple[str, Axes]]


def write_flights(path: Path, about: RecordingInfo, flights: Mapping[str, Shown]) -> None:
    """Write flights of any robots, by their names, as one `.rrd` file."""
    scenes = dict(zip(flights, scenes_of(list(flights.values())), strict=True))
    layout = _single(next(iter(scenes.values()))) if len(scenes) == 1 else side_by_side(scenes)
    with scenes_file(path, about, scenes, layout):
        pass


@contextmanager
def scenes_file(
    path: Path, about: RecordingInfo, scenes: Mapping[str, Scene], layout: Layout
) -> Iterator[rr.RecordingStream]:
    """A recording of scenes, to log more below the places of each."""
    with recording_file(path, about, screen(layout.views)) as recording:
        for (name, scene), (under, axes) in zip(scenes.items(), layout.places, strict=True):
            log_scene(recording, under, scene, axes, name if len(scenes) > 1 else "")
        yield recording


def _single(scene: Scene) -> Layout:
    """The machine, its path and the words; beside them all signals, one time axis below the other.

    They are so wide that 16 s have a tick a second.
    """
    left, heights = list[rrb.View]([_machine("", scene)]), [310.0]
    if scene.task and scene.square:
        left.append(_plane("", scene))
        heights.append(235.0)
    if scene.has_events:
        left += [_status(""), rrb.TextLogView(origin="events", name="Events")]
        heights += [86.0, 132.0]
    left.append(notes_view())
    heights.append(max(110.0, _HEIGHT - sum(heights)))
    states_px = _states_px(scene)
    rest, width_px = _HEIGHT - states_px, _SIGNALS * _WIDTH
    views, shares, axes = _column("", scene, scene.panels, rest, width_px)
    right, signals_px = [*views], [rest * share / sum(shares) for share in shares]
    if states_px:
        right.append(rrb.StateTimelineView(origin="state", name="Actuators"))
        signals_px.append(states_px)
    columns = rrb.Vertical(*left, row_shares=heights), rrb.Vertical(*right, row_shares=signals_px)
    shares = [1 - _SIGNALS, _SIGNALS]
    return Layout(rrb.Horizontal(*columns, column_shares=shares), [("", axes)])


def _states_px(*scenes: Scene) -> float:
    """Height of the states of actuators, the same for all scenes."""
    lanes = [len(scene.lanes) for scene in scenes if scene.has_events]
    return 62.0 + 42.0 * max(lanes) if lanes else 0.0


def side_by_side(scenes: Mapping[str, Scene], *, pages: bool = True) -> Layout:
    """Two or three beside the notes; more without the machines, which have a page of their own.

    Where `pages` is off, four are in one row, and more in rows of three: conditions have few plots.
    """
    if len(scenes) > FEW and pages:
        return _pages(scenes)
    per_row = len(scenes) if len(scenes) <= FEW + 1 else FEW
    rows = -(-len(scenes) // per_row)
    width_px, states_px = 0.8 * _WIDTH / per_row, _states_px(*scenes.values())
    cells, places = list[rrb.Container](), []
    for k, (name, scene) in enumerate(scenes.items()):
        under, pictures = entity_of(k), list[rrb.View]([_machine(entity_of(k), scene, name)])
        if scene.task and scene.square:
            pictures.append(_plane(under, scene))
        top = rrb.Horizontal(*pictures, column_shares=[3, 2][: len(pictures)])
        # Conditions are about the machine: it is twice as high as a plot.
        machine_px = (0.32 if pages else 2 / (2 + len(scene.panels))) * _HEIGHT / rows
        below_px = _HEIGHT / rows - machine_px - states_px
        views, shares, axes = _column(
            under, scene, scene.panels[:_ROOM], below_px, width_px, legend=None
        )
        parts, heights = [top, *views], [machine_px]
        heights += [below_px * share / sum(shares) for share in shares]
        if scene.has_events:
            states = rrb.StateTimelineView(origin=f"{under}state", name="Actuators")
            parts.append(rrb.Horizontal(states, _status(under)))
            heights.append(states_px)
        cells.append(rrb.Vertical(*parts, row_shares=heights))
        places.append((under, axes))
    grid = rrb.Grid(*cells, grid_columns=per_row)
    return Layout(rrb.Horizontal(_words(scenes), grid, column_shares=[1, 4]), places)


def _pages(scenes: Mapping[str, Scene]) -> Layout:
    """Plots of six on a page; one page of machines, and one of words."""
    columns, places = list[rrb.Container](), []
    width_px = _WIDTH / min(MANY, len(scenes))
    for k, (name, scene) in enumerate(scenes.items()):
        under, parts, heights = entity_of(k), list[rrb.View](), list[float]()
        if scene.task and scene.square:
            parts, heights = [_plane(under, scene, name)], [0.26 * _HEIGHT]
        rest = _HEIGHT - sum(heights)
        views, shares, axes = _column(
            under, scene, scene.panels[:_ROOM], rest, width_px, legend=k % MANY == 0
        )
        heights += [rest * share / sum(shares) for share in shares]
        columns.append(rrb.Vertical(*parts, *views, row_shares=heights, name=name))
        places.append((under, axes))
    machines = [
        _machine(entity_of(k), scene, name) for k, (name, scene) in enumerate(scenes.items())
    ]
    pages = [
        rrb.Horizontal(*columns[begin : begin + MANY], name=f"Side by side, from {begin + 1}")
        for begin in range(0, len(columns), MANY)
    ]
    robots = rrb.Grid(*machines, name="Robots")
    return Layout(rrb.Tabs(*pages, robots, _words(scenes), active_tab=0), places)


def entity_of(number: int) -> str:
    """Where the scene of a number is logged, of several."""
    return f"run_{number}/"


def _column(
    under: str,
    scene: Scene,
    panels: Sequence[Plot],
    height_px: float,
    width_px: float,
    *,
    legend: bool | None = True,
) -> tuple[list[rrb.View], list[float], Axes]:
    """Views of panels in a column so high, their shares of it, and the ranges of their axes.

    Legends are there, or not; None: where they fit.
    """
    # Names need room above the lines, and the error is what matters.
    shares = [
        max(3.5 * plot.entity.startswith(ERROR), 2.5 + 0.17 * min(6, len(plot.names)))
        for plot in panels
    ]
    heights = [height_px * share / sum(shares) - _AROUND_PX for share in shares]
    axes = {
        plot.entity: axis_range(*scene.ranges[plot.entity], high)
        for plot, high in zip(panels, heights, strict=True)
    }
    views = [
        plot_view(
            plot,
            axes[plot.entity],
            under,
            width_px=width_px - 60,
            legend=_NAME_PX * (2 + len(plot.names)) < high if legend is None else legend,
        )
        for plot, high in zip(panels, heights, strict=True)
    ]
    return list[rrb.View](views), shares, axes


def _machine(under: str, scene: Scene, name: str = "") -> rrb.Spatial3DView:
    picture = scene.picture
    title = "; ".join(filter(None, (name, picture.title))) or "true size"
    return machine_view(f"{under}machine", title, picture.model)


def _plane(under: str, scene: Scene, name: str = "") -> rrb.Spatial2DView:
    assert scene.task and scene.square
    title, task = scene.task
    return plane_view(f"{under}plane", name or title.format(*task.names), scene.square)


def _status(under: str) -> rrb.TextDocumentView:
    return rrb.TextDocumentView(origin=f"{under}status", name="Status")


def _words(scenes: Mapping[str, Scene]) -> rrb.Container:
    """The notes, and the events of all scenes as a list."""
    views: list[rrb.View] = [notes_view()]
    if any(scene.has_events for scene in scenes.values()):
        every = [f"+ /{entity_of(k)}events" for k in range(len(scenes))]
        views.append(rrb.TextLogView(origin="/", contents=every, name="Events"))
    return rrb.Vertical(*views, name="Notes", row_shares=[3, 1][: len(views)])
