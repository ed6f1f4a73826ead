"""Scene of a recording: a machine with its plots, curves and events, below one entity."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import mujoco
import numpy as np
import rerun as rr

from fjh.recording import Array
from fjh.recording.file import rgb, time_column
from fjh.recording.machine import FIXTURES, Failing, Picture, load_colors, log_machine, stills
from fjh.recording.motion import displacement, magnification, magnified, motion_of
from fjh.recording.plane import Plane, log_plane
from fjh.recording.signals import Line, Plot, Range, axis_of, log_lines, log_plot
from fjh.recording.view import RunView
from fjh.rig.run import HEALTHY
from fjh.study.palette import FAILED, GREEN, ORANGE, SKY

_LINES = 1.9
"""Side of the visible square relative to the extent of the curves, with a label of three lines."""
_STATES = {HEALTHY: [150] * 3, "free": rgb(ORANGE), "weak": rgb(SKY), "loose": rgb(GREEN)}
"""Colours of states and diagnoses of actuators; other failures have the colour `FAILED`."""
FEW = 3
"""Largest number of runs with the robot next to the plots; with more it has its own page."""
_TICKS, _FEW_TICKS = 8.0, 4.0
"""Number of axis ticks that fit, for plots in their own column and for plots below the robot."""


@dataclass(frozen=True)
class Scene:
    """Scene of a machine in one condition or run.

    Attributes:
        picture: Machine in 3D.
        plots: All logged signals.
        axes: Axes of the plots with a view, by entity; the same in all compared scenes.
        plane: Two rows in a plane; None: no such view.
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
        """Plots that have a view."""
        return [plot for plot in self.plots if plot.entity in self.axes]

    @property
    def has_events(self) -> bool:
        """True if there is an event after the start."""
        start_s = float(self.plots[0].time_s[0]) if self.plots else 0.0
        return any(line.time_s > start_s for line in self.lines)


def scenes_of(runs: Mapping[str, RunView], *, paths: bool = False) -> dict[str, Scene]:
    """Return scenes of named runs, with common scales for runs of one robot and task.

    The plane shows the path of a single run, but the errors of several, whose paths would coincide
    unless `paths` is set.
    """
    scenes, ticks = {}, _FEW_TICKS if 1 < len(runs) <= FEW else _TICKS
    for name, run in runs.items():
        comparable = [one for one in runs.values() if one.scales == run.scales]
        axes = axes_of([plot for other in comparable for plot in other.panels], ticks)
        plane = None
        if len(run.plane_columns) > 1:
            plane = (_path if paths or len(runs) == 1 else _errors)(run, comparable)
        picture = _picture(run, comparable)
        scenes[name] = Scene(picture, run.signals, axes, plane, run.lines, run.lanes)
    return scenes


def axes_of(plots: Sequence[Plot], ticks: float = _FEW_TICKS) -> dict[str, Range]:
    """Return the axis of each entity of plots, without entities whose plots are all constant."""
    axes = {}
    for entity in dict.fromkeys(plot.entity for plot in plots):
        comparable = [plot for plot in plots if plot.entity == entity]
        if not all(plot.is_constant for plot in comparable):
            lows, highs = zip(*(plot.range for plot in comparable), strict=True)
            axes[entity] = axis_of(min(lows), max(highs), ticks)
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
    """Return the scene of a mechanism in one condition that moves along given joint positions.

    Args:
        model: Model of the mechanism.
        time_s: Evenly spaced times (N,).
        qpos: Positions of all its joints, (N, nq).
        plots: Signals; those that are not constant have a view.
        plane: Two rows of its task in a plane.
        nominal: Pose (nq,) about which small motion is magnified; None: `qpos0`.
        failing: Bodies and labels of failed actuators.
    """
    origin = motion_of(model, (model.qpos0 if nominal is None else nominal)[None])
    at = stills(time_s)
    motion = motion_of(model, qpos[at])
    factor = magnification(*displacement(motion, origin))
    picture = Picture(model, time_s[at], magnified(motion, origin, factor), factor, failing)
    return Scene(picture, plots, axes_of(plots), plane)


def _picture(run: RunView, comparable: Sequence[RunView]) -> Picture:
    factor, at = min(other.factor for other in comparable), stills(run.time_s)
    inputs, colors, note = run.arrays["inputs"], {}, ""
    if run.stated.hexapod:
        most = max(np.abs(other.arrays["inputs"]).max() for other in comparable)
        full = float(max(1.0, np.ceil(most)))
        note = f"inputs -{full:g} % blue, +{full:g} % red"
        for names, load in zip(run.stated.bodies, inputs[at].T, strict=True):
            colors |= dict.fromkeys(names, load_colors(load, full))
    motion = run.motion(run.arrays["task"][at], run.arrays["qpos"][at], factor)
    fixtures = FIXTURES if run.stated.hexapod else {}
    return Picture(run.model, run.time_s[at], motion, factor, run.failing, colors, fixtures, note)


def _path(run: RunView, comparable: Sequence[RunView]) -> Plane:
    columns, unit = run.plane_columns[:2], f"u{run.stated.row_units[0]}"
    desired, true = (1e6 * run.arrays[name][:, columns] for name in ("desired", "true"))
    right, up = (run.rows[k] for k in columns)
    title = f"Path: {up} over {right}; desired orange, true blue"
    curves = [
        1e6 * one.arrays[name][:, columns] for one in comparable for name in ("desired", "true")
    ]
    return Plane(title, (right, up), unit, desired, true, np.concatenate(curves))


def _errors(run: RunView, comparable: Sequence[RunView]) -> Plane:
    columns, unit = run.plane_columns[:2], f"u{run.stated.row_units[0]}"
    errors = [1e6 * one.error[:, columns] for one in (run, *comparable)]
    right, up = (run.rows[k] for k in columns)
    names, zero = (right, f"{up} error"), np.zeros_like(errors[0])
    enclosed, note = np.concatenate(errors), f"RMS {run.rms_text()}"
    return Plane("Error", names, unit, zero, errors[0], enclosed, _LINES, note)


def log_scene(recording: rr.RecordingStream, under: str, scene: Scene, name: str = "") -> None:
    """Log a scene below an entity; `name` is its prefix in the list of events."""
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
