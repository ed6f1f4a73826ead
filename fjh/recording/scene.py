"""One machine with its plots, curves and events, as it is logged below an entity."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import mujoco
import numpy as np
import rerun as rr

from fjh.recording import Array
from fjh.recording.file import rgb, time_column
from fjh.recording.machine import (
    FIXTURES,
    Failing,
    Picture,
    load_colors,
    log_machine,
    stills,
)
from fjh.recording.motion import displacement, magnification, magnified, motion_of
from fjh.recording.plane import Plane, log_plane
from fjh.recording.signals import Line, Plot, Range, axis_of, log_lines, log_plot
from fjh.recording.view import RunView
from fjh.rig.run import HEALTHY
from fjh.study.palette import FAILED, GREEN, ORANGE, SKY

_LINES = 1.9
"""Side of the square over the extent of the curves where the label has three lines."""
_STATES = {HEALTHY: [150] * 3, "free": rgb(ORANGE), "weak": rgb(SKY), "loose": rgb(GREEN)}
"""Colours of what actuators are, or are taken for; of any other failure that of what has failed."""
FEW = 3
"""Runs that leave room for the robot next to the plots; of more it has a page of its own."""
_ROOM, _NARROW = 8.0, 4.0
"""Ticks for which an axis has room: where the plots have a column, and below the robot."""


@dataclass(frozen=True)
class Scene:
    """A machine in one condition or run.

    Attributes:
        picture: In 3D.
        plots: All that is logged.
        axes: Of those plots that are shown, by entity; the same in all scenes that are compared.
        plane: Two rows in a plane; None is nothing.
        lines: Events.
        lanes: States of actuators over time, by name.
    """

    picture: Picture
    plots: Sequence[Plot]
    axes: Mapping[str, Range]
    plane: Plane | None = None
    lines: Sequence[Line] = ()
    lanes: Mapping[str, Sequence[tuple[float, str]]] = field(default_factory=dict)

    @property
    def panels(self) -> list[Plot]:
        """The plots that are shown."""
        return [plot for plot in self.plots if plot.entity in self.axes]

    @property
    def has_events(self) -> bool:
        """Whether anything happens on the way; what was there from the start is no event."""
        begin_s = float(self.plots[0].time_s[0]) if self.plots else 0.0
        return any(line.time_s > begin_s for line in self.lines)


def scenes_of(runs: Mapping[str, RunView], *, paths: bool = False) -> dict[str, Scene]:
    """Runs on scales that those of one robot and task have in common.

    One alone has its path in the plane, several have their errors there: their paths are one line,
    unless `paths` are wanted.
    """
    scenes, room = {}, _NARROW if 1 < len(runs) <= FEW else _ROOM
    for name, run in runs.items():
        alike = [other for other in runs.values() if other.scales == run.scales]
        axes = axes_of([plot for other in alike for plot in other.panels], room)
        plane = None
        if len(run.drawn) > 1:
            plane = (_path if paths or len(runs) == 1 else _errors)(run, alike)
        scenes[name] = Scene(_picture(run, alike), run.signals, axes, plane, run.lines, run.lanes)
    return scenes


def axes_of(plots: Sequence[Plot], room: float = _NARROW) -> dict[str, Range]:
    """The axes of plots, of one entity the same; of what is constant in all of them, none."""
    axes = {}
    for entity in dict.fromkeys(plot.entity for plot in plots):
        alike = [plot for plot in plots if plot.entity == entity]
        if not all(plot.is_constant for plot in alike):
            lows, highs = zip(*(plot.range for plot in alike), strict=True)
            axes[entity] = axis_of(min(lows), max(highs), room)
    return axes


def condition_scene(
    model: mujoco.MjModel,
    time_s: Array,
    qpos: Array,
    plots: Sequence[Plot],
    *,
    plane: Plane | None = None,
    nominal: Array | None = None,
    failing: Sequence[Failing] = (),
) -> Scene:
    """A mechanism in one condition, moving as it is told, at evenly spaced times (N,).

    Args:
        model: Of the mechanism.
        time_s: (N,).
        qpos: Positions of all its joints, (N, nq).
        plots: Those that are not constant are shown.
        plane: Of its task.
        nominal: The pose (nq,) about which motion too small to be seen is magnified; None is
            `qpos0`.
        failing: What has failed.
    """
    rest = motion_of(model, (model.qpos0 if nominal is None else nominal)[None])
    at = stills(time_s)
    motion = motion_of(model, qpos[at])
    factor = magnification(*displacement(motion, rest))
    picture = Picture(model, time_s[at], magnified(motion, rest, factor), factor, failing)
    return Scene(picture, plots, axes_of(plots), plane)


def _picture(run: RunView, alike: Sequence[RunView]) -> Picture:
    factor, at = min(other.factor for other in alike), stills(run.time_s)
    inputs, colors, words = run.arrays["inputs"], {}, ""
    if run.stated.hexapod:
        most = max(np.abs(other.arrays["inputs"]).max() for other in alike)
        full = float(max(1.0, np.ceil(most)))
        words = f"inputs -{full:g} % blue, +{full:g} % red"
        for names, load in zip(run.stated.bodies, inputs[at].T, strict=True):
            colors |= dict.fromkeys(names, load_colors(load, full))
    return Picture(
        run.model,
        run.time_s[at],
        run.motion(run.arrays["task"][at], run.arrays["qpos"][at], factor),
        factor,
        run.failing,
        colors,
        FIXTURES if run.stated.hexapod else {},
        words,
    )


def _path(run: RunView, alike: Sequence[RunView]) -> Plane:
    columns, unit = run.drawn[:2], f"u{run.stated.row_units[0]}"
    desired, true = (1e6 * run.arrays[name][:, columns] for name in ("desired", "true"))
    right, up = (run.rows[k] for k in columns)
    title = f"Path: {up} over {right}; desired orange, true blue"
    curves = [1e6 * each.arrays[name][:, columns] for each in alike for name in ("desired", "true")]
    return Plane(title, (right, up), unit, desired, true, np.concatenate(curves))


def _errors(run: RunView, alike: Sequence[RunView]) -> Plane:
    columns, unit = run.drawn[:2], f"u{run.stated.row_units[0]}"
    errors = [1e6 * each.error[:, columns] for each in (run, *alike)]
    right, up = (run.rows[k] for k in columns)
    names, zero = (right, f"{up} error"), np.zeros_like(errors[0])
    within, note = np.concatenate(errors), f"RMS {run.rms_text()}"
    return Plane("Error", names, unit, zero, errors[0], within, _LINES, note)


def log_scene(recording: rr.RecordingStream, under: str, scene: Scene, name: str = "") -> None:
    """Log a scene below an entity; of several scenes the name is in the list of events."""
    log_machine(recording, f"{under}machine", scene.picture)
    for plot in scene.plots:
        log_plot(recording, plot, under)
    for plot in scene.panels:
        log_lines(recording, plot, scene.lines, scene.axes[plot.entity], under)
    if scene.plane is not None:
        log_plane(recording, f"{under}plane", scene.plots[0].time_s, scene.plane)
    if not scene.has_events:
        return
    texts = [f"{name}: {line.name}" if name else line.name for line in scene.lines]
    times = time_column(np.array([line.time_s for line in scene.lines]))
    recording.send_columns(f"{under}events", [times], rr.TextLog.columns(text=texts))
    kinds = {kind for changes in scene.lanes.values() for _, kind in changes}
    colors = {kind: _STATES.get(kind, rgb(FAILED)) for kind in sorted(kinds)}
    style = rr.StateConfiguration(values=list(colors), colors=list(colors.values()))
    for lane, changes in scene.lanes.items():
        entity = f"{under}state/{lane.replace(' ', '_')}"
        at_s, states = zip(*changes, strict=True)
        recording.log(entity, style, static=True)
        columns = rr.StateChange.columns(state=states)
        recording.send_columns(entity, [time_column(np.array(at_s))], columns)
