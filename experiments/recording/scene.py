"""One machine with its plots, curves and events, as it is logged below an entity."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import rerun as rr

from experiments.recording.file import rgb, time_column
from experiments.recording.hexapod import load_colors
from experiments.recording.machine import Picture, log_machine, stills
from experiments.recording.marks import SOUND
from experiments.recording.shown import CLOSURE, ERROR, INPUT, SECONDARY, Shown
from experiments.recording.signals import Line, Plot, Range, log_lines, log_plot
from experiments.recording.views import Square, Task, log_plane, square_around
from experiments.study.palette import FAILED, GREEN, ORANGE, SKY

_LINES = 1.9
"""Side of the square over the extent of the curves where the label has three lines."""
_STATES = {SOUND: [150] * 3, "free": rgb(ORANGE), "weak": rgb(SKY), "loose": rgb(GREEN)}
"""Colours of what actuators are, or are taken for; of any other failure that of what has failed."""


@dataclass(frozen=True)
class Scene:
    """A machine in one condition or flight.

    Attributes:
        picture: In 3D.
        plots: All that is logged.
        panels: Of them, those that are shown.
        ranges: Of the values of the panels, by entity; the same in all scenes that are compared.
        task: Two rows in a plane; None is nothing.
        square: What is shown of the plane.
        lines: Events.
        lanes: States of actuators over time, by name.
        sentences: What is known from each time on.
    """

    picture: Picture
    plots: Sequence[Plot]
    panels: Sequence[Plot]
    ranges: Mapping[str, Range]
    task: tuple[str, Task] | None = None
    square: Square | None = None
    lines: Sequence[Line] = ()
    lanes: Mapping[str, Sequence[tuple[float, str]]] = field(default_factory=dict)
    sentences: Sequence[tuple[float, str]] = ()

    @property
    def has_events(self) -> bool:
        """Whether anything happens on the way; what was there from the start is no event."""
        begin_s = float(self.plots[0].time_s[0]) if self.plots else 0.0
        return any(line.time_s > begin_s for line in self.lines)


def scenes_of(flights: Sequence[Shown]) -> list[Scene]:
    """Flights on scales that those of one robot and task have in common.

    One alone has its path in the plane, several have their errors there: their paths are one line.
    """
    scenes = []
    for one in flights:
        alike = [other for other in flights if other.kind == one.kind]
        ranges = _ranges([_panels(other) for other in alike])
        shown = [plot for plot in _panels(one) if plot.entity in ranges]
        curves = None
        if len(one.drawn) > 1:
            curves = _path(one) if len(flights) == 1 else _errors(one, alike)
        scene = Scene(
            _picture(one, alike), one.signals, shown, ranges, *(curves or (None, None)),
            lines=one.lines, lanes=one.lanes, sentences=one.sentences,
        )  # fmt: skip
        scenes.append(scene)
    return scenes


def _panels(one: Shown) -> list[Plot]:
    """In the order of what they tell; a screen may have no room for the last."""
    places = [ERROR, INPUT, *(plot.entity for plot in one.extras), SECONDARY, CLOSURE]
    return [plot for place in places for plot in one.signals if plot.entity.startswith(place)]


def _ranges(each: Sequence[Sequence[Plot]]) -> dict[str, Range]:
    """Of the values of the same plot in all; of what is constant in all of them, none."""
    found, ranges = [plot for plots in each for plot in plots], dict[str, Range]()
    for entity in dict.fromkeys(plot.entity for plot in found):
        alike = [plot for plot in found if plot.entity == entity]
        if not all(plot.is_constant for plot in alike):
            lows, highs = zip(*(plot.range for plot in alike), strict=True)
            ranges[entity] = min(lows), max(highs)
    return ranges


def _picture(one: Shown, alike: Sequence[Shown]) -> Picture:
    factor, at = min(other.factor for other in alike), stills(one.time_s)
    colors, words = {}, ""
    if one.colored:
        full = float(max(1.0, np.ceil(max(np.abs(other.inputs).max() for other in alike))))
        words = f"inputs -{full:g} % blue, +{full:g} % red"
        for names, load in zip(one.bodies, one.inputs[at].T, strict=True):
            colors |= dict.fromkeys(names, load_colors(load, full))
    failing = [(one.bodies[mark.actuator], mark) for mark in one.marks if mark.kind != SOUND]
    motion = one.motion(at, factor)
    return Picture(
        one.model, one.time_s[at], motion, factor, failing, colors, dict(one.fixtures), words
    )


def _path(one: Shown) -> tuple[tuple[str, Task], Square]:
    right, up = one.drawn[:2]
    curves = 1e6 * one.desired[:, [right, up]], 1e6 * one.true[:, [right, up]]
    task = Task((one.rows[right], one.rows[up]), f"u{one.row_units[0]}", *curves)
    return ("Path: {1} over {0}; desired orange, true blue", task), task.square


def _errors(one: Shown, alike: Sequence[Shown]) -> tuple[tuple[str, Task], Square]:
    def error(of: Shown) -> np.ndarray:
        return 1e6 * of.error[:, of.drawn[:2]]

    own = error(one)
    (right, up), unit = one.drawn[:2], f"u{one.row_units[0]}"
    names = one.rows[right], f"{one.rows[up]} error"
    task = Task(names, unit, np.zeros_like(own), own, f"RMS {one.rms_said()}")
    return ("Error", task), square_around(*map(error, alike), margin=_LINES)


def log_scene(
    recording: rr.RecordingStream,
    under: str,
    scene: Scene,
    axes: Mapping[str, Range],
    name: str = "",
) -> None:
    """Log a scene below an entity, its events over the ranges of the axes of its panels.

    Of several scenes the name is said in the list of events.
    """
    log_machine(recording, f"{under}machine", scene.picture)
    for plot in scene.plots:
        log_plot(recording, plot, under)
    for plot in (each for each in scene.panels if each.entity in axes):
        log_lines(recording, plot, scene.lines, axes[plot.entity], under)
    if scene.task and scene.square:
        time_s = scene.plots[0].time_s
        log_plane(recording, f"{under}plane", time_s, scene.task[1], scene.square)
    if not scene.has_events:
        return
    listed = [(e.time_s, f"{name}: {e.name}" if name else e.name) for e in scene.lines]
    _log_words(recording, f"{under}events", rr.TextLog, listed)
    _log_words(recording, f"{under}status", rr.TextDocument, scene.sentences)
    kinds = {kind for changes in scene.lanes.values() for _, kind in changes}
    colors = {kind: _STATES.get(kind, rgb(FAILED)) for kind in sorted(kinds)}
    style = rr.StateConfiguration(values=list(colors), colors=list(colors.values()))
    for name, changes in scene.lanes.items():
        entity = f"{under}state/{name.replace(' ', '_')}"
        times, states = zip(*changes, strict=True)
        recording.log(entity, style, static=True)
        columns = rr.StateChange.columns(state=states)
        recording.send_columns(entity, [time_column(np.array(times))], columns)


def _log_words(
    recording: rr.RecordingStream,
    entity: str,
    kind: type[rr.TextLog] | type[rr.TextDocument],
    said: Sequence[tuple[float, str]],
) -> None:
    times, words = zip(*said, strict=True)
    if kind is rr.TextLog:
        columns = rr.TextLog.columns(text=words)
    else:
        types = [rr.MediaType.MARKDOWN] * len(words)
        columns = rr.TextDocument.columns(text=words, media_type=types)
    recording.send_columns(entity, [time_column(np.array(times))], columns)
