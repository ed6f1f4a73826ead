"""A run of the hexapod as an animation: the machine with its motion magnified, detector, error."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import mujoco
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.recording import drawing
from experiments.recording.file import round_down
from experiments.recording.gif import pixels, write_gif
from experiments.recording.marks import Mark
from experiments.recording.shown import Shown, magnified, scales_of
from experiments.study.plotting import BLACK, BLUE, DESIRED, MEASURED, TITLE_PT, VERMILION
from sim import Array

SIZE_IN, DPI = (6.4, 3.8), 120
FRAMES = 104
"""Those that move; each event and the end are one more."""
_SLOW_S, _FAST = 0.8, 0.35
"""The run until so long before its first failure has this share of the frames: it goes faster."""
_FRAME_MS, _EVENT_MS, _LAST_MS = 70, 1200, 2000
_VIEW = drawing.View(azimuth_deg=98.0, elevation_deg=22.0)
_SIGHT_M = 0.17, 0.45
"""Along the line of sight from the payload's origin: its begin, and the point that draws."""


@dataclass(frozen=True)
class Frame:
    """A tick of the run, and for how long it is shown."""

    tick: int
    shown_ms: int


@dataclass(frozen=True)
class Animation:
    """A run that is to be animated, drawn as the hexapod of this MJCF."""

    model: mujoco.MjModel
    shown: Shown

    @cached_property
    def factor(self) -> int:
        """By which the payload's motion is magnified: twice as much as in the run's recording."""
        return 2 * scales_of([self.shown.run]).factor

    @cached_property
    def frames(self) -> list[Frame]:
        """Evenly spaced until shortly before the first failure, and from there; events stand."""
        time_s, events = self.shown.run.time_s, self._events_s
        slow_s = max(time_s[0], min(events, default=time_s[0]) - _SLOW_S)
        fast = round(_FAST * FRAMES) if slow_s > time_s[0] else 0
        moving = [
            *np.linspace(time_s[0], slow_s, fast, endpoint=False),
            *np.linspace(slow_s, time_s[-1], FRAMES - fast),
        ]
        durations = dict.fromkeys(self.ticks_at(moving), _FRAME_MS)
        durations |= dict.fromkeys(self.ticks_at(events), _EVENT_MS)
        durations[len(time_s) - 1] = _LAST_MS
        return [Frame(tick, durations[tick]) for tick in sorted(durations)]

    @cached_property
    def _events_s(self) -> list[float]:
        """Failures after the start and diagnoses."""
        marks, begin_s = self.shown.marks, self.shown.run.time_s[0]
        failed = [mark.failed_s for mark in marks if mark.failed_s > begin_s]
        return failed + [mark.diagnosed_s for mark in marks if mark.is_found]

    def ticks_at(self, times_s: Sequence[float]) -> list[int]:
        """The first ticks that are not before these times."""
        time_s = self.shown.run.time_s
        found = np.searchsorted(time_s, np.array(times_s) - 1e-9)
        return np.minimum(found, len(time_s) - 1).tolist()

    @cached_property
    def solids(self) -> drawing.Machine:
        """The machine's surface."""
        return drawing.machine(self.model)


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
    """One picture: the machine on the left, on the right the detector above the error."""
    run = animation.shown.run
    figure = Figure(figsize=SIZE_IN, dpi=DPI)
    left = figure.add_axes((0.0, 0.03, 0.58, 0.86), aspect="equal")
    _machine(left, animation, tick)
    _detector(figure.add_axes((0.665, 0.385, 0.30, 0.505), aspect="equal"), animation, tick)
    _error(figure.add_axes((0.665, 0.115, 0.30, 0.15)), animation, tick)
    color, words = _state(animation, tick)
    figure.text(0.015, 0.945, words, color=color, fontsize=TITLE_PT, weight="bold", va="center")
    clock = f"{run.time_s[tick]:5.2f} s"
    figure.text(0.985, 0.945, clock, fontsize=TITLE_PT, ha="right", va="center")
    magnified = f"motion magnified {animation.factor} times; line of sight with its trace"
    figure.text(0.015, 0.035, magnified, va="center")
    return figure


def _state(animation: Animation, tick: int) -> tuple[str, str]:
    """What is known of the struts, and the colour in which it is written."""
    now_s, run = animation.shown.run.time_s[tick], animation.shown.run
    failed = [mark for mark in animation.shown.marks if mark.failed_s <= now_s]
    if not failed:
        return BLACK, "all six struts sound"
    last = max(failed, key=lambda mark: mark.failed_s)
    if last.failed_s == run.time_s[0] and not last.is_found:
        return VERMILION, last.failure
    if last.diagnosed_s > now_s:
        return VERMILION, f"{last.failure} at {last.failed_s:.2f} s, unannounced"
    delay_ms = round(1e3 * (last.diagnosed_s - last.failed_s))
    driven = _driven(animation, last)
    goes_on = f"mapping reconfigured, {driven} struts go on" if driven else "no strut is driven"
    return BLUE, f"{last.diagnosis.replace('found', f'found after {delay_ms} ms')}; {goes_on}"


def _driven(animation: Animation, mark: Mark) -> int:
    """Struts whose inputs change after a diagnosis."""
    after = animation.ticks_at([mark.diagnosed_s])[0] + 2
    inputs = animation.shown.run.strut_input_percent[after:]
    return int((np.ptp(inputs, axis=0) > 0).sum()) if len(inputs) else 6


def _machine(axes: Axes, animation: Animation, tick: int) -> None:
    """The machine at a tick; on its line of sight, the trace of a point until then."""
    run, model = animation.shown.run, animation.model
    motion = drawing.motion_at(model, magnified(run, [tick], animation.factor))
    now_s = run.time_s[tick]
    colors = {
        f"strut{mark.actuator + 1}": VERMILION
        for mark in animation.shown.marks
        if mark.failed_s <= now_s
    }
    points = animation.solids.placed(motion, 0)
    drawing.draw_machine(axes, animation.solids, points, _VIEW, drawing.COLORS | colors)
    drawing.number_struts(axes, motion, 0, _VIEW)
    every = max(1, len(run.time_s) // 1000)
    trace = _sight(animation, [*range(0, tick, every), tick])
    axes.plot(*_VIEW.on_paper(trace[:, 1]).T, color=MEASURED, lw=0.7)
    axes.plot(*_VIEW.on_paper(trace[-1]).T, color=BLACK, lw=0.8)
    axes.plot(*_VIEW.on_paper(trace[-1, 1]), "o", color=MEASURED, ms=3)
    axes.set(xlim=(-0.43, 0.43), ylim=(-0.19, 0.74))
    axes.axis("off")


def _sight(animation: Animation, ticks: Sequence[int]) -> Array:
    """Both ends of the line of sight at some ticks, in MuJoCo's world, shape (T, 2, 3)."""
    data = mujoco.MjData(animation.model)
    mujoco.mj_kinematics(animation.model, data)
    to_world, origin = data.site("base").xmat.reshape(3, 3), data.site("payload").xpos
    pose = magnified(animation.shown.run, ticks, animation.factor)
    ends = np.array([[0.0, 0.0, -along] for along in _SIGHT_M])
    return (
        origin + (pose.translation_m[:, None] + ends @ pose.rotation.swapaxes(-1, -2)) @ to_world.T
    )


def _detector(axes: Axes, animation: Animation, tick: int) -> None:
    """Desired and measured pointing until a tick, over the whole of what will be desired."""
    run = animation.shown.run
    desired, measured = 1e6 * run.desired_rad, 1e6 * run.measured_rad
    limit = 1.1 * np.abs(desired).max()
    step = round_down(0.5 * limit)
    ticks = np.arange(-limit // step + 1, limit // step + 1) * step
    axes.plot(*desired.T, color="0.85", lw=0.8)
    axes.plot(*measured[: tick + 1].T, color=MEASURED, lw=1.2, label="measured")
    axes.plot(*desired[: tick + 1].T, color=DESIRED, lw=0.6, ls="--", label="desired")
    axes.plot(*measured[tick], "o", color=MEASURED, ms=3)
    axes.set(xlim=(-limit, limit), ylim=(-limit, limit), xticks=ticks, yticks=ticks)
    axes.set(xlabel="$\\alpha$, µrad", ylabel="$\\beta$, µrad")
    place = {"loc": "lower center", "bbox_to_anchor": (0.5, 1.0), "ncols": 2}
    axes.legend(**place, frameon=False, borderaxespad=0.1)


def _error(axes: Axes, animation: Animation, tick: int) -> None:
    """The size of the pointing error until a tick, failures and diagnoses marked."""
    run = animation.shown.run
    error_urad = 1e6 * np.linalg.norm(run.desired_rad - run.true_rad, axis=1)
    axes.plot(run.time_s[: tick + 1], error_urad[: tick + 1], color=BLACK, lw=0.8)
    for mark in animation.shown.marks:
        for when_s, color in ((mark.failed_s, VERMILION), (mark.diagnosed_s, BLUE)):
            if run.time_s[0] < when_s <= run.time_s[tick]:
                axes.axvline(when_s, color=color, lw=0.8)
    axes.set(xlim=run.time_s[[0, -1]], ylim=(0, 1.15 * error_urad.max()))
    axes.set(xlabel="time, s", ylabel="error, µrad")
