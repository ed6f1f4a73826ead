"""A survey for a reader: printed tables, sentences, a figure, one page."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fjh.rig.condition_analysis import NO_MARGIN, ConditionAnalysis
from fjh.rig.conditions import FREE, KINDS, LOCKED, counted, listed
from fjh.study.page import named_versions, rendered
from fjh.study.palette import BLACK, BLUE, ORANGE, VERMILION
from fjh.study.plotting import COLOR_MAP, PAGE_IN, new_figure, one_legend
from fjh.study.provenance import commit
from fjh.study.result import Result, Shown
from fjh.survey.subject import Subject
from sim import Array

_NEAR = 10.0  # gap of a rank decision below which a verdict is uncertain


def shown(subject: Subject, tables: Mapping[str, pd.DataFrame]) -> list[Shown]:
    """The printed tables; single failures without the columns that have no value."""
    conditions, isolation = tables["conditions"], tables["isolation"]
    single = conditions[conditions.failures < 2].dropna(axis=1, how="all")
    columns = [
        f"{name}{digits}"
        for pattern, digits in _COLUMNS.items()
        for name in single.filter(regex=pattern)
    ]
    found = [
        Shown(f"{subject.title}: single failures", single, " ".join(columns), _LEGEND),
        Shown("Conditions by failures", tables["counts"], "failures conditions:, survived:,"),
        Shown("What the failures of each actuator leave", tables["actuators"], _COSTS, _LEFT),
    ]
    if len(isolation):
        columns = _OF_MATRIX if subject.robot is None else _OF_ROBOT
        words = isolation.map(
            lambda each: ", ".join(map(str, each)) if isinstance(each, list) else each
        )
        found.append(Shown("Failures that sensors tell apart", words, columns, _TOLD_APART))
    return found


_COLUMNS = {
    "^(failed|major_task)$": "",
    "_left$": ":.0%",
    "^(relative_manipulability|largest_gain.*|error_gain.*)(?<!_over_postures)$": ":.3g",
    "^lost_secondary$": "",
    "^share_of_postures$": ":.0%",
}
"""Patterns of the columns that are printed of conditions, and formats."""
_LEGEND = (
    "left: in the worst direction within the limits, of that without failures. "
    "relative_manipulability: sqrt(det J_m J_m^T) over that without failures. largest_gain: "
    "norm of the actuators' motion per unit of the major task; error_gain: major error per norm of "
    "the actuators' errors. share_of_postures: at which the task is kept."
)
_COSTS = "actuator left_locked:.0% left_free:.0% doubles_survived:.0% costs_most"
_LEFT = "left: in the mean over start and postures. doubles_survived: part of the double failures."
_OF_MATRIX = "sensors isolable alike without_effect nearest smallest_angle_deg:.3g"
_OF_ROBOT = (
    "sensors isolable failures isolable_with_exact_model dither_hz:g further_sensors "
    "isolable_with_further"
)
_TOLD_APART = (
    "isolable: failures (of a robot each actuator locked, free, half weak) that look like no "
    "failure of another actuator and not like none. further_sensors: the best, one after another."
)


def headline(subject: Subject, start: ConditionAnalysis) -> str:
    """What single failures do to the major task; where it is not possible without, what helps."""
    rows = listed([subject.rows[row] for row in subject.major])
    task = f"{counted(len(subject.actuators), 'actuator')}, major task {rows}: it"
    if start.survived[0]:
        kept, of = start.survived[start.singles].sum(), start.singles.size
        return f"{task} survives {kept or 'none'} of {of} single failures."
    advice = "drop major rows (--major)"
    if subject.robot is not None:
        advice += ", take another start (--keyframe), or pin what stands (--pinned)"
    elif start.classification(0) == NO_MARGIN:
        rest = "where inputs are one-sided, say what they exert at rest (--hold)"
        advice = rest if subject.hold is None else "widen the limits, or hold less"
    return f"{task} is not possible even without failures, because {start.reason(0)}: {advice}."


def notes(
    subject: Subject, start: ConditionAnalysis, actuators: pd.DataFrame, settings: Mapping[str, Any]
) -> Iterator[str]:
    """What the tables do not say: what numbers rest on, and what they leave out."""
    if subject.instead is not None:
        yield subject.instead
    if near := int((start.classes.gap < _NEAR).sum()):
        yield f"{near:,} verdicts would change with a tolerance of ranks within {_NEAR:g} times it."
    costly = actuators.actuator[actuators.costs_most].tolist()
    if 0 < len(costly) < len(actuators):
        yield f"The failure of {listed(costly, 'or')} costs most."
    if drawn := settings["postures_drawn"]:
        possible, closed = (settings[f"postures_{k}"] for k in ("possible", "examined"))
        yield (
            f"Of {drawn} other postures {closed} close within the joint ranges; the task is "
            f"possible without failures at {possible} of them."
        )
    if (refused := settings["isolation_refused"]) is not None:
        yield f"Which failures sensors tell apart is not said: {refused.removesuffix('.')}."
    said = [
        f"of the {what}: {source or 'none are stated, and one unit each is taken'}"
        for what, source in subject.sources.items()
    ]
    yield f"Limits {'; '.join(said)}."
    for each in (*settings["left_out"], *subject.warnings):
        yield f"{each[0].upper()}{each[1:].removesuffix('.')}."


def write_page(result: Result, folder: Path) -> None:
    """Write `survey.html`, one page that needs no other file, into a folder with the figures."""
    settings = result.settings
    kind = "model" if "model_sha256" in settings else "matrix"
    html = rendered(
        "fjh.survey",
        "survey.html.j2",
        result=result,
        complaint="; ".join(result.failed),
        recordings=sorted(file.name for file in folder.glob("*.rrd")),
        folder=folder,
        origin={
            "command": settings["command"],
            kind: f"SHA-256 of {settings['title']} {settings[f'{kind}_sha256']}",
            "versions": named_versions(settings["versions"]),
            "commit": commit(),
        },
    )
    (folder / "survey.html").write_text(html, encoding="utf-8")


CAPTION = (
    "What is left in the worst direction at the start, of that without failures. Left: after the "
    "failure of one actuator. Right: after that of two, each locked or free; vermilion: the major "
    "task is lost."
)
ALT = "Bars of what is left after each single failure, and a map of all double failures."

_COLORS = {LOCKED: BLUE, FREE: ORANGE}
_MARK: dict[str, Any] = {"ls": "", "marker": "x", "color": VERMILION, "ms": 4, "clip_on": False}
_MOST_NAMES = 16  # names along an axis; of more actuators, some of the names


def figure_survey(subject: Subject, start: ConditionAnalysis) -> Figure:
    """Bars of the singles, and the map of the doubles where these are examined."""
    names, doubles = subject.actuators, bool((start.failures == 2).any())
    widths = [1.0, 2.0][: 1 + doubles]
    figure = new_figure(PAGE_IN, min(4.6, max(3.4, 1.8 + 0.22 * len(names))))
    bars, *right = figure.subplots(1, len(widths), squeeze=False, width_ratios=widths)[0]
    _bars(bars, names, start)
    if right:
        _pairs(right[0], names, pair_table(start))
    one_legend(figure, 4)
    what = f"{subject.title}: {subject.measure} left in the worst direction"
    figure.suptitle(what, parse_math=False)
    return figure


def _bars(axes: Axes, names: tuple[str, ...], start: ConditionAnalysis) -> None:
    for (kind, word), rows, aside in zip(KINDS.items(), start.singles.T, (-0.2, 0.2), strict=True):
        at, lost = np.arange(len(names)) + aside, ~start.survived[rows]
        axes.barh(at, np.nan_to_num(start.speed_left[rows]), 0.36, color=_COLORS[kind], label=word)
        axes.plot(0 * at[lost], at[lost], **_MARK)
    axes.plot([], [], **_MARK, label="task lost")
    axes.axvline(1.0, color=BLACK, lw=0.8, label="without failures")
    axes.set(xlabel="left, of that without failures", title="one failure")
    axes.set(ylim=(len(names) - 0.5, -0.5))
    axes.set_yticks(range(len(names)), names, parse_math=False)
    axes.grid(axis="y", visible=False)


def _pairs(axes: Axes, names: tuple[str, ...], left: Array) -> None:
    """Rows and columns: each actuator locked, then each free."""
    lost = matplotlib.colormaps[COLOR_MAP].with_extremes(under=VERMILION)
    shown = axes.imshow(np.where(left == 0, -1.0, left), cmap=lost, vmin=0.0, vmax=1.0)
    n = len(names)
    step = -(-n // _MOST_NAMES)
    at = [k + part for part in (0, n) for k in range(0, n - step + 1, step)]
    labels = [names[k % n] for k in at]
    axes.set_xticks(at, labels, rotation=90, parse_math=False)
    axes.set_yticks(at, labels, parse_math=False)
    for middle, word in zip((0.25, 0.75), KINDS.values(), strict=True):
        axes.text(middle, 1.02, word, transform=axes.transAxes, ha="center")
        axes.text(1.02, 1 - middle, word, transform=axes.transAxes, va="center", rotation=-90)
    axes.axhline(n - 0.5, color=BLACK, lw=0.6)
    axes.axvline(n - 0.5, color=BLACK, lw=0.6)
    axes.grid(visible=False)
    axes.set_title("two failures", pad=14)
    axes.figure.colorbar(shown, ax=axes, shrink=0.8, pad=0.08)


def pair_table(start: ConditionAnalysis) -> Array:
    """What is left of each pair, locked ones first, shape (2 n, 2 n); singles on the diagonal."""
    n = start.codes.shape[1]
    table, left = np.full((2 * n, 2 * n), np.nan), np.where(start.survived, start.speed_left, 0.0)
    failed = np.hstack([start.codes == LOCKED, start.codes == FREE])
    for row in np.flatnonzero((start.failures == 1) | (start.failures == 2)):
        one, *_, other = np.flatnonzero(failed[row]).repeat(2)
        table[one, other] = table[other, one] = left[row]
    return table
