"""The figure of `fjh survey`: what single failures leave, and what pairs of them do."""

from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure

from experiments.rig.conditions import FREE, KINDS, LOCKED
from experiments.study.palette import BLACK, BLUE, ORANGE, VERMILION
from experiments.study.plotting import COLOR_MAP, PAGE_IN, new_figure, one_legend
from experiments.study.results import Picture
from experiments.survey.survey import Survey
from sim import Array

_COLORS = {LOCKED: BLUE, FREE: ORANGE}
_LOST = ListedColormap([VERMILION])
_MARK: dict[str, Any] = {"ls": "", "marker": "x", "color": VERMILION, "ms": 4, "clip_on": False}
_MOST_NAMES = 16
"""Names along an axis; of more actuators, some of the names."""


def pictures(survey: Survey) -> list[Picture]:
    """The study's figure and its caption; none where the sound robot cannot do the task."""
    if not survey.start.survived[0]:
        return []
    what = _what(survey)
    caption = (
        f"{survey.subject.title}: {what} left in the worst direction at the start, of that without "
        "failures. Left: after the failure of one actuator. Right: after that of two, each locked "
        "or free; vermilion: the major task is lost."
    )
    alt = f"Bars of the {what} left after each single failure, and a map of all double failures."
    return [Picture("survey", caption, alt, partial(figure_survey, survey))]


def _what(survey: Survey) -> str:
    return "effect" if survey.subject.robot is None else "speed"


def figure_survey(survey: Survey) -> Figure:
    """Bars of the singles, and the map of the doubles where these are examined."""
    n = len(survey.subject.actuators)
    doubles = bool((survey.start.failures == 2).any())
    widths = [1.0, 2.0][: 1 + doubles]
    figure = new_figure(PAGE_IN, min(4.6, max(3.4, 1.8 + 0.22 * n)))
    bars, *right = figure.subplots(1, len(widths), squeeze=False, width_ratios=widths)[0]
    _bars(bars, survey)
    if right:
        _pairs(right[0], survey)
    one_legend(figure, 4)
    what = f"{survey.subject.title}: {_what(survey)} left in the worst direction"
    figure.suptitle(what, parse_math=False)
    return figure


def _bars(axes: Axes, survey: Survey) -> None:
    start, names = survey.start, survey.subject.actuators
    at = np.arange(len(names))
    for kind, word in KINDS.items():
        rows = start.singles[:, kind - LOCKED]
        left, place = np.nan_to_num(start.speed_left[rows]), at + 0.2 * (2 * (kind - LOCKED) - 1)
        axes.barh(place, left, 0.36, color=_COLORS[kind], label=word)
        lost = ~start.survived[rows]
        axes.plot(0 * place[lost], place[lost], **_MARK)
    axes.plot([], [], **_MARK, label="task lost")
    axes.axvline(1.0, color=BLACK, lw=0.8, label="without failures")
    axes.set(
        xlabel="left, of that without failures", title="one failure", ylim=(len(names) - 0.5, -0.5)
    )
    axes.set_yticks(at, names, parse_math=False)
    axes.grid(axis="y", visible=False)


def _pairs(axes: Axes, survey: Survey) -> None:
    """Rows and columns: each actuator locked, then each free."""
    names, left = survey.subject.actuators, pair_table(survey)
    shown = axes.imshow(np.where(left > 0, left, np.nan), cmap=COLOR_MAP, vmin=0.0, vmax=1.0)
    axes.imshow(np.where(left == 0, 0.0, np.nan), cmap=_LOST)
    n = len(names)
    step = -(-n // _MOST_NAMES)
    some = np.arange(0, n - step + 1, step)
    at = np.concatenate([some, n + some])
    labels = [names[k % n] for k in at]
    axes.set_xticks(at, labels, rotation=90, parse_math=False)
    axes.set_yticks(at, labels, parse_math=False)
    for k, word in enumerate(KINDS.values()):
        middle = (0.25 + 0.5 * k, 1.02)
        axes.text(*middle, word, transform=axes.transAxes, ha="center")
        axes.text(1.02, 1 - middle[0], word, transform=axes.transAxes, va="center", rotation=-90)
    axes.axhline(n - 0.5, color=BLACK, lw=0.6)
    axes.axvline(n - 0.5, color=BLACK, lw=0.6)
    axes.grid(visible=False)
    axes.set_title("two failures", pad=14)
    axes.figure.colorbar(shown, ax=axes, shrink=0.8, pad=0.08)


def pair_table(survey: Survey) -> Array:
    """What is left of each pair, locked ones first, shape (2 n, 2 n); singles on the diagonal."""
    start = survey.start
    n = start.codes.shape[1]
    left = np.full((2 * n, 2 * n), np.nan)
    for row in np.flatnonzero((start.failures == 1) | (start.failures == 2)):
        failed = np.flatnonzero(start.codes[row])
        at = failed + n * (start.codes[row, failed] - LOCKED)
        kept = start.speed_left[row] if start.survived[row] else 0.0
        left[at[0], at[-1]] = left[at[-1], at[0]] = kept
    return left
