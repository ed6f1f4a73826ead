"""Layout of recordings: one run, a few side by side, many on pages, or conditions of a machine.

Sizes are for a window of 1600 x 900 pixels.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import rerun.blueprint as rrb

from fjh.recording.file import RecordingInfo, recording_file, screen
from fjh.recording.machine import machine_view
from fjh.recording.plane import plane_view
from fjh.recording.scene import FEW, Scene, log_scene
from fjh.recording.signals import Plot, plot_view
from fjh.recording.view import ERROR

MANY = 6
"""Largest number of runs on a page."""
_PANELS = 4
"""Largest number of panels in the column of a run; more would be too low for their ticks."""
_HEIGHT = 880.0
_SIGNALS = 0.7
"""Fraction of the width that the signals have."""
_NAMES, _FEW_NAMES = 8, 4
"""Largest number of names in the legend of a wide and of a narrow plot."""


def write_scenes(
    path: Path, about: RecordingInfo, scenes: Mapping[str, Scene], *, pages: bool = True
) -> None:
    """Write named scenes as one `.rrd` file, many on pages, or (as for conditions) in rows."""
    single = next(iter(scenes.values())) if pages and len(scenes) == 1 else None
    views = _side_by_side(scenes, pages) if single is None else _single(single)
    _write(path, about, scenes, views, single is None)


def write_film(path: Path, about: RecordingInfo, scenes: Mapping[str, Scene]) -> None:
    """Write named scenes for small pictures, each as one column: machine, plane and error."""
    columns = []
    for number, (name, scene) in enumerate(scenes.items()):
        under = entity_of(number)
        views = list[rrb.View]([_machine(under, scene, name)])
        if scene.plane is not None:
            views.append(plane_view(f"{under}plane", "Path", scene.plane))
        for error in scene.panels[:1]:
            axis = scene.axes[error.entity]
            views.append(plot_view(error, axis, under, legend=False, is_wide=False))
        columns.append(rrb.Vertical(*views))
    _write(path, about, scenes, rrb.Horizontal(*columns), True)


def _write(
    path: Path, about: RecordingInfo, scenes: Mapping[str, Scene], views: rrb.Container, split: bool
) -> None:
    with recording_file(path, about, screen(views)) as recording:
        for number, (name, scene) in enumerate(scenes.items()):
            under = entity_of(number) if split else ""
            log_scene(recording, under, scene, name if len(scenes) > 1 else "")


def entity_of(number: int) -> str:
    """Return the entity of the scene with this number in a recording of several scenes."""
    return f"run_{number}/"


def _single(scene: Scene) -> rrb.Container:
    """Return machine, path and texts in one column, and all signals in another."""
    left, heights = list[rrb.View]([_machine("", scene)]), [310.0]
    if scene.plane is not None:
        left.append(plane_view("plane", scene.plane.title, scene.plane))
        heights.append(235.0)
    if scene.has_events:
        left.append(rrb.TextLogView(origin="events", name="Events"))
        heights.append(160.0)
    left.append(_notes())
    heights.append(max(110.0, _HEIGHT - sum(heights)))
    states = _states_px([scene])
    right, shares = _panels("", scene, scene.panels, _HEIGHT - states)
    if states:
        right.append(_states(""))
        shares.append(states)
    columns = rrb.Vertical(*left, row_shares=heights), rrb.Vertical(*right, row_shares=shares)
    return rrb.Horizontal(*columns, column_shares=[1 - _SIGNALS, _SIGNALS])


def _side_by_side(scenes: Mapping[str, Scene], pages: bool) -> rrb.Container:
    """Return up to three scenes next to the notes; more on pages, with machines on their own page.

    Without `pages`, up to four scenes are in one row, and more in rows of three.
    """
    if len(scenes) > FEW and pages:
        return _pages(scenes)
    per_row = len(scenes) if len(scenes) <= FEW + 1 else FEW
    height, states = _HEIGHT / -(-len(scenes) // per_row), _states_px(list(scenes.values()))
    cells = list[rrb.Container]()
    for number, (name, scene) in enumerate(scenes.items()):
        under = entity_of(number)
        pictures = list[rrb.View]([_machine(under, scene, name)])
        if scene.plane is not None:
            pictures.append(plane_view(f"{under}plane", scene.plane.title, scene.plane))
        top = rrb.Horizontal(*pictures, column_shares=[3, 2][: len(pictures)])
        # In conditions the machine matters most: it is twice as high as a plot.
        machine = height * (0.32 if pages else 2 / (2 + len(scene.panels)))
        panels, remaining = scene.panels[:_PANELS], height - machine - states
        views, shares = _panels(under, scene, panels, remaining, names=_FEW_NAMES)
        if scene.has_events:
            views.append(_states(under))
            shares.append(states)
        cells.append(rrb.Vertical(top, *views, row_shares=[machine, *shares]))
    grid = rrb.Grid(*cells, grid_columns=per_row)
    return rrb.Horizontal(_text_views(scenes), grid, column_shares=[1, 4])


def _pages(scenes: Mapping[str, Scene]) -> rrb.Container:
    """Return pages with plots of up to `MANY` scenes each, a page of machines, one of texts."""
    columns, machines = list[rrb.Container](), list[rrb.View]()
    for number, (name, scene) in enumerate(scenes.items()):
        under, top = entity_of(number), list[rrb.View]()
        machines.append(_machine(under, scene, name))
        if scene.plane is not None:
            top.append(plane_view(f"{under}plane", name, scene.plane))
        height = 0.26 * _HEIGHT
        names = _FEW_NAMES if number % MANY == 0 else 0
        views, shares = _panels(
            under, scene, scene.panels[:_PANELS], _HEIGHT - height, names=names, is_wide=False
        )
        heights = [height] * len(top) + shares
        columns.append(rrb.Vertical(*top, *views, row_shares=heights, name=name))
    pages = [
        rrb.Horizontal(*columns[first : first + MANY], name=f"Side by side, from {first + 1}")
        for first in range(0, len(columns), MANY)
    ]
    robots = rrb.Grid(*machines, name="Robots")
    return rrb.Tabs(*pages, robots, _text_views(scenes), active_tab=0)


def _panels(
    under: str,
    scene: Scene,
    panels: Sequence[Plot],
    height: float,
    *,
    names: int = _NAMES,
    is_wide: bool = True,
) -> tuple[list[rrb.View], list[float]]:
    """Return views of plots in a column, and their heights; legends have at most `names` names."""
    # Names need space above the lines, and the error matters most.
    shares = [
        max(3.5 * plot.entity.startswith(ERROR), 2.5 + 0.17 * min(6, len(plot.names)))
        for plot in panels
    ]
    views = [
        plot_view(
            plot, scene.axes[plot.entity], under, legend=len(plot.names) <= names, is_wide=is_wide
        )
        for plot in panels
    ]
    return list[rrb.View](views), [height * share / sum(shares) for share in shares]


def _states_px(scenes: Sequence[Scene]) -> float:
    """Return the height of the actuators' states, the same for all scenes."""
    lanes = [len(scene.lanes) for scene in scenes if scene.has_events]
    return 62.0 + 42.0 * max(lanes) if lanes else 0.0


def _states(under: str) -> rrb.View:
    return rrb.StateTimelineView(origin=f"{under}state", name="Actuators")


def _machine(under: str, scene: Scene, name: str = "") -> rrb.Spatial3DView:
    picture = scene.picture
    title = "; ".join(filter(None, (name, picture.title))) or "true size"
    return machine_view(f"{under}machine", title, picture.model)


def _notes() -> rrb.TextDocumentView:
    return rrb.TextDocumentView(origin="notes", name="Notes")


def _text_views(scenes: Mapping[str, Scene]) -> rrb.Container:
    """Return the notes, and a list of the events of all scenes."""
    views: list[rrb.View] = [_notes()]
    if any(scene.has_events for scene in scenes.values()):
        every = [f"+ /{entity_of(k)}events" for k in range(len(scenes))]
        views.append(rrb.TextLogView(origin="/", contents=every, name="Events"))
    return rrb.Vertical(*views, name="Notes", row_shares=[3, 1][: len(views)])
