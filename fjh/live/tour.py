"""A tour without installation: each failure, flown, filmed and put into numbers, on one page."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fjh.live.filmed import BEGINS_S, BREAKS_S, ENDS_S, HAPPENINGS, Filmed, filmed
from fjh.live.stage import COLORS, NAMES
from fjh.rig.options import RobotOptions
from fjh.study.files import published
from fjh.study.option import OnProgress
from fjh.study.page import rendered
from fjh.study.workers import in_parallel
from sim import MODELS

_ARM = (MODELS / "arm.xml", RobotOptions(major=(3, 4, 5)))
_HEXAPOD = (None, RobotOptions())
_WIDTH, _LEFT, _TOP, _DECADE = 360.0, 50.0, 16.0, 28.0
"""Of a plot, in its own units."""
_SHOWN = 5
"""Decades, at most."""


@dataclass(frozen=True)
class Stop:
    """What is to be seen: a happening of a robot, as of :func:`filmed`."""

    model: Path | None
    options: RobotOptions
    happening: str


def stops(model: Path | None, options: RobotOptions) -> tuple[Stop, ...]:
    """All that can happen to a robot."""
    return tuple(Stop(model, options, each) for each in HAPPENINGS)


TOUR = (Stop(*_ARM, "Lock"), *stops(*_HEXAPOD), Stop(*_ARM, "No force"))
"""That of the site. The loops of the hexapod hide from the eye what a lock does to the arm."""


def write_tour(
    file: Path,
    tour: Sequence[Stop] = TOUR,
    seed: int = 0,
    on_progress: OnProgress = lambda done, of: None,
) -> tuple[Filmed, ...]:
    """Fly all stops, and write a page that needs neither network nor any other file.

    Args:
        file: That is written.
        tour: What is to be seen, in this order.
        seed: Of all noise, and of what is drawn.
        on_progress: Called with the stops that are done, and all.

    Raises:
        WrongInput, sim.ModelError, sim.SimulationDiverged: As of :func:`filmed`.
        OutputError: The folder or the disk refuses; the message says why.
    """
    calls = [vars(stop) | {"seed": seed} for stop in tour]
    films = tuple(in_parallel(filmed, calls, on_progress))
    with published(file.parent, index=file.name) as staging:
        (staging / file.name).write_text(page(films), encoding="utf-8")
    return films


def page(films: Sequence[Filmed]) -> str:
    """The HTML of some flights."""
    robots = {film.robot: [each for each in films if each.robot == film.robot] for film in films}
    times = {"begins_s": BEGINS_S, "breaks_s": BREAKS_S, "ends_s": ENDS_S}
    looks = {"names": NAMES, "colors": COLORS, "plotted": plotted, "zip": zip}
    template = ("fjh.live", "tour.html.j2")
    return rendered(*template, films=films, robots=robots, **times, **looks)


def plotted(film: Filmed) -> dict[str, Any]:
    """Both errors over time on a scale of decades, as places in an SVG.

    Returns:
        Points of each curve, the height, the heights of the decades by what is written there,
        the places of seconds, of the failure and of its name.
    """
    curves = np.log10(np.maximum(film.curves, 1e-12))
    high = int(np.ceil(curves.max()))
    low = max(int(np.floor(np.percentile(curves, 10))), high - _SHOWN)
    x = _LEFT + (_WIDTH - _LEFT) * np.arange(1, curves.shape[1] + 1) / curves.shape[1]
    y = _TOP + _DECADE * (high - np.maximum(curves, low))

    def at(time_s: float) -> float:
        return round(_LEFT + (_WIDTH - _LEFT) * time_s / ENDS_S, 1)

    return {
        "lines": [" ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, each, strict=True)) for each in y],
        "width": _WIDTH,
        "height": _TOP + _DECADE * (high - low),
        "left": _LEFT,
        "top": _TOP,
        "decades": {f"{10.0 ** (k + 2):g} %": _TOP + _DECADE * (high - k)
                    for k in range(low, high + 1)},
        "seconds": {k: at(k) for k in range(1, int(ENDS_S) + 1)},
        "breaks": at(BREAKS_S),
        "named": None if film.named_s is None else at(film.named_s),
    }  # fmt: skip
