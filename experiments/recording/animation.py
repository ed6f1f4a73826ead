"""One run, or two side by side, as an animation: the machine, its path, and the error."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.recording import Array, drawing
from experiments.recording.animated import Animated
from experiments.recording.gif import pixels, write_gif
from experiments.study.palette import BLACK, BLUE, VERMILION
from experiments.study.plotting import DESIRED, MEASURED, TEXT_PT, TITLE_PT
from experiments.study.study import WrongInput

SIZE_IN, DPI = (16 / 7, 3.9), 140
"""Of a run: 320 pixels wide."""
FRAMES = 72
"""Those that move; the first failure and the end are one more."""
_BEFORE = 0.15
"""Part of the time after the first failure that is shown of the time before."""
_FRAME_MS, _EVENT_MS, _LAST_MS = 70, 500, 2000
_UNITS = (("", 1.0), ("m", 1e3), ("µ", 1e6))
_HALF = 0.4
"""Of the machine's picture, in the extents that its MJCF states."""
_MARGIN = 1.15
_CENTRED: dict[str, Any] = {"ha": "center", "va": "center"}


@dataclass(frozen=True)
class Frame:
    """A tick of the run, and for how long it is shown."""

    tick: int
    shown_ms: int


@dataclass(frozen=True)
class Animation:
    """Runs of one path that are to be animated side by side, all on the same scales.

    Raises:
        WrongInput: They differ in their machine, times or path.
    """

    runs: Sequence[Animated]

    def __post_init__(self) -> None:
        first = self.runs[0]
        for other in self.runs[1:]:
            both = f"{first.heading} and {other.heading}"
            if first.unit != other.unit or first.desired.shape[1:] != other.desired.shape[1:]:
                raise WrongInput(f"{both} are no runs of the same task")
            if not np.array_equal(first.time_s, other.time_s):
                raise WrongInput(f"{both} differ in duration or time steps")
            if not np.array_equal(first.desired, other.desired):
                raise WrongInput(f"{both} have different paths")

    @cached_property
    def factor(self) -> int:
        """By which the machine's motion is magnified: as the larger one needs."""
        return min(one.factor for one in self.runs)

    @cached_property
    def frames(self) -> list[Frame]:
        """Evenly spaced, from shortly before the first failure, which stands for a moment."""
        time_s = self.runs[0].time_s
        begin_s, end_s = time_s[[0, -1]]
        failed = [failure.time_s for one in self.runs for _, failure in one.failures]
        struck_s = min(failed, default=begin_s)
        begin_s = max(begin_s, struck_s - _BEFORE * (end_s - struck_s))
        moving = np.linspace(begin_s, end_s, FRAMES)
        durations = dict.fromkeys(self._ticks_at(moving), _FRAME_MS)
        if struck_s > begin_s:
            durations |= dict.fromkeys(self._ticks_at([struck_s]), _EVENT_MS)
        durations[len(time_s) - 1] = _LAST_MS
        return [Frame(tick, durations[tick]) for tick in sorted(durations)]

    def _ticks_at(self, times_s: Sequence[float] | Array) -> list[int]:
        """The first ticks that are not before these times."""
        time_s = self.runs[0].time_s
        found = np.searchsorted(time_s, np.array(times_s) - 1e-9)
        return np.minimum(found, len(time_s) - 1).tolist()

    @cached_property
    def unit(self) -> tuple[str, float]:
        """For errors, and how many of it make one [rad] or [m]."""
        largest, unit = self.largest_error, self.runs[0].unit
        fitting = ((prefix + unit, many) for prefix, many in _UNITS if largest * many >= 1.0)
        return next(fitting, (f"µ{unit}", 1e6))

    @cached_property
    def largest_error(self) -> float:
        """Of all runs, in all frames."""
        shown = self.frames[0].tick
        return max(float(one.error[shown:].max()) for one in self.runs)

    @cached_property
    def square(self) -> tuple[Array, float]:
        """Middle and half the side of what is shown of the plane of the path."""
        all_of_it = np.vstack([curve for one in self.runs for curve in one.curves])
        low, high = all_of_it.min(axis=0), all_of_it.max(axis=0)
        return (low + high) / 2, _MARGIN * float((high - low).max()) / 2


def write_animation(
    path: Path, animation: Animation, on_progress: Callable[[int, int], None]
) -> None:
    """Write a GIF that repeats; the same bytes every time."""
    frames, pictures = animation.frames, []
    for done, frame in enumerate(frames, 1):
        pictures.append(pixels(figure_at(animation, frame.tick)))
        on_progress(done, len(frames))
    write_gif(path, pictures, [frame.shown_ms for frame in frames])


def figure_at(animation: Animation, tick: int) -> Figure:
    """One picture: a column for each run, the machine above its path above its error."""
    runs = animation.runs
    share = 1 / len(runs)
    figure = Figure(figsize=(SIZE_IN[0] * len(runs), SIZE_IN[1]), dpi=DPI)
    for k, one in enumerate(runs):
        middle = (k + 0.5) * share
        color, words = state_at(one, tick)
        figure.text(middle, 0.965, one.heading, fontsize=TITLE_PT, weight="bold", **_CENTRED)
        figure.text(middle, 0.92, words, fontsize=TEXT_PT, color=color, **_CENTRED)
        _machine(_axes(figure, k * share, 0.53, share, 0.36), animation, one, tick)
        _path(_axes(figure, k * share, 0.12, share, 0.41), animation, one, tick)
        _error(figure.add_axes(((k + 0.1) * share, 0.055, 0.8 * share, 0.03)), animation, one, tick)
    note = f"{runs[0].time_s[tick]:.2f} s"
    if animation.factor > 1:
        note += f"; motion magnified {animation.factor} times"
    figure.text(0.5, 0.022, note, fontsize=TEXT_PT, **_CENTRED)
    return figure


def _axes(figure: Figure, left: float, bottom: float, width: float, height: float) -> Axes:
    axes = figure.add_axes((left, bottom, width, height), aspect="equal")
    axes.axis("off")
    return axes


def state_at(one: Animated, tick: int) -> tuple[str, str]:
    """What is known of the actuators, and the colour in which it is written."""
    now_s = one.time_s[tick]
    failed = [failure for failure in one.run.failures if failure.time_s <= now_s]
    if not failed:
        return BLACK, "all actuators work"
    diagnosis, text = one.run.diagnosis_of(failed[-1]), one.run.stated.text(failed[-1])
    if diagnosis is None or diagnosis.time_s > now_s:
        return VERMILION, text
    delay_ms = round(1e3 * (diagnosis.time_s - failed[-1].time_s))
    return BLUE, f"{text}, diagnosed as {diagnosis.kind} after {delay_ms} ms"


def _machine(axes: Axes, animation: Animation, one: Animated, tick: int) -> None:
    """The machine at a tick, what has failed in red, seen as its MJCF says."""
    model, surface = one.run.model, one.surface
    seen = model.vis.global_
    view = drawing.View(seen.azimuth - 180.0, -seen.elevation)
    failed = [part for part, failure in one.failures if failure.time_s <= one.time_s[tick]]
    colors = drawing.COLORS | {part: VERMILION for part in failed if part is not None}
    points = surface.placed(one.motion(tick, animation.factor), 0)
    drawing.draw_machine(axes, surface, points, view, colors)
    right, up = view.on_paper(model.stat.center)
    half = _HALF * float(model.stat.extent)
    ratio = SIZE_IN[0] / (0.36 * SIZE_IN[1])
    axes.set(xlim=(right - ratio * half, right + ratio * half), ylim=(up - half, up + half))


def _path(axes: Axes, animation: Animation, one: Animated, tick: int) -> None:
    """The desired path, that taken until a tick, and how far the two are apart now."""
    (right, up), half = animation.square
    desired, true = one.curves
    axes.plot(*desired.T, color="0.65", lw=1.0, ls="--")
    axes.plot(*true[: tick + 1].T, color=MEASURED, lw=1.6)
    axes.plot(*np.array([desired[tick], true[tick]]).T, color=VERMILION, lw=2.2)
    axes.plot(*desired[tick], "o", color=DESIRED, ms=4, mfc="white")
    axes.plot(*true[tick], "o", color=MEASURED, ms=5)
    axes.set(xlim=(right - half, right + half), ylim=(up - half, up + half))


def _error(axes: Axes, animation: Animation, one: Animated, tick: int) -> None:
    """The error as a bar, full at the largest of all runs."""
    unit, many = animation.unit
    value = many * one.error[tick]
    axes.barh(0.0, value, color=VERMILION, height=1.0)
    axes.set(
        xlim=(0.0, many * animation.largest_error or 1.0), ylim=(-0.5, 0.5), xticks=[], yticks=[]
    )
    words = f"error {value:.{0 if value >= 10 else 1}f} {unit}"
    axes.set_title(words, fontsize=TITLE_PT, weight="bold", pad=3)
