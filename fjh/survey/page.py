"""Report of a survey: printed tables, sentences, a figure, and an HTML page."""

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
from fjh.study.page import rendered, version_text
from fjh.study.palette import BLACK, BLUE, ORANGE, VERMILION
from fjh.study.plotting import COLOR_MAP, PAGE_IN, new_figure, one_legend
from fjh.study.provenance import commit
from fjh.study.result import Result, TableView
from fjh.survey.system import AnalyzedSystem
from sim import Array

_NEAR = 10.0  # gap of a rank decision below which a classification is uncertain


def table_views(system: AnalyzedSystem, tables: Mapping[str, pd.DataFrame]) -> list[TableView]:
    """Return the printed tables; that of single failures omits columns without any value."""
    conditions, isolation = tables["conditions"], tables["isolation"]
    single = conditions[conditions.failures < 2].dropna(axis=1, how="all")
    columns = [
        f"{name}{digits}"
        for pattern, digits in _COLUMNS.items()
        for name in single.filter(regex=pattern)
    ]
    title = "Capability after failures of each actuator"
    views = [
        TableView(f"{title}, {system.title}", tables["actuators"], _COSTS, _LEFT_LEGEND),
        TableView("Conditions by failures", tables["counts"], "failures conditions:, survived:,"),
        TableView("Single failures", single, " ".join(columns), _LEGEND),
    ]
    if len(isolation):
        columns = _OF_MATRIX if system.robot is None else _OF_ROBOT
        text = isolation.map(
            lambda cell: ", ".join(map(str, cell)) if isinstance(cell, list) else cell
        )
        title = "Failures that sensors isolate"
        views.insert(2, TableView(title, text, columns, _ISOLABLE_LEGEND))
    return views


_COLUMNS = {
    "^(failed|major_task)$": "",
    "_left$": ":.0%",
    "^(relative_manipulability|largest_gain.*|error_gain.*)(?<!_over_postures)$": ":.3g",
    "^lost_secondary$": "",
    "^share_of_postures$": ":.0%",
}
"""Patterns of the printed columns of conditions, and their formats."""
_LEGEND = (
    "Left: fraction of the value without failures, in the worst direction within the limits. "
    "Relative manipulability: sqrt(det J_m J_m^T) over that without failures. Largest gain: "
    "norm of the actuators' motion per unit of the major task. Error gain: major error per norm of "
    "the actuators' errors. Share of postures: those where the task survives."
)
_COSTS = "actuator left_locked=left_if_locked:.0% left_free=left_if_free:.0% "
_COSTS += "doubles_survived=double_failures_survived:.0% costs_most"
_LEFT_LEGEND = "Left: mean over start and postures, in the worst direction."
_OF_MATRIX = "sensors isolable alike=indistinguishable without_effect nearest "
_OF_MATRIX += "smallest_angle_deg:.3g"
_OF_ROBOT = (
    "sensors isolable failures isolable_with_exact_model dither_hz:g further_sensors "
    "isolable_with_further"
)
_ISOLABLE_LEGEND = (
    "Isolable: failures (for a robot each actuator locked, free, half weak) separated from those "
    "of other actuators and from none. Further sensors: the best additions, one after another."
)


def headline(system: AnalyzedSystem, start: ConditionAnalysis) -> str:
    """Return a sentence on single failures, or on how to make an infeasible task possible."""
    rows = listed([system.rows[row] for row in system.major])
    task = f"{counted(len(system.actuators), 'actuator')}, major task {rows}: it"
    if start.survived[0]:
        survived, total = start.survived[start.singles].sum(), start.singles.size
        return f"{task} survives {survived or 'none'} of {total} single failures."
    advice = "drop major rows (--major)"
    if system.robot is not None:
        advice += ", choose another start (--keyframe), or pin bodies on the ground (--pinned)"
    elif start.classification(0) == NO_MARGIN:
        one_sided = "for one-sided inputs, give what they exert at rest (--hold)"
        advice = one_sided if system.hold is None else "widen the limits, or hold less"
    return f"{task} is not possible even without failures, because {start.reason(0)}: {advice}."


def notes(
    system: AnalyzedSystem,
    start: ConditionAnalysis,
    actuators: pd.DataFrame,
    settings: Mapping[str, Any],
) -> Iterator[str]:
    """Yield sentences on the conditions and limits of the numbers."""
    if system.instead is not None:
        yield system.instead
    if near := int((start.classes.gap < _NEAR).sum()):
        yield f"{near:,} classifications depend on the rank tolerance within a factor of {_NEAR:g}."
    costly = actuators.actuator[actuators.costs_most].tolist()
    if 0 < len(costly) < len(actuators):
        yield f"The failure of {listed(costly, 'or')} costs most."
    if sampled := settings["postures_drawn"]:
        possible, closed = (settings[f"postures_{k}"] for k in ("possible", "examined"))
        yield (
            f"Of {sampled} other postures {closed} close within the joint ranges; the task is "
            f"possible without failures at {possible} of them."
        )
    if (reason := settings["isolation_refused"]) is not None:
        yield f"Which failures sensors isolate was not computed: {reason.removesuffix('.')}."
    origins = [
        f"of the {quantity}: {source or 'not stated, one unit each is assumed'}"
        for quantity, source in system.sources.items()
    ]
    yield f"Limits {'; '.join(origins)}."
    for sentence in (*settings["left_out"], *system.warnings):
        yield f"{sentence[0].upper()}{sentence[1:].removesuffix('.')}."


def write_page(result: Result, folder: Path) -> None:
    """Write `survey.html`, one self-contained page, into the folder with the figures."""
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
            "versions": version_text(settings["versions"]),
            "commit": commit(),
        },
    )
    (folder / "survey.html").write_text(html, encoding="utf-8")


CAPTION = (
    "Remaining capability in the worst direction at the start, relative to that without failures. "
    "Left: after the failure of one actuator. Right: after failures of two, each locked or free; "
    "vermilion: the major task is lost."
)
ALT = "Bars of the capability left after each single failure, and a map of all double failures."

_COLORS = {LOCKED: BLUE, FREE: ORANGE}
_MARK: dict[str, Any] = {"ls": "", "marker": "x", "color": VERMILION, "ms": 4, "clip_on": False}
_MOST_NAMES = 16  # largest number of names along an axis; with more actuators some are left out


def figure_survey(system: AnalyzedSystem, start: ConditionAnalysis) -> Figure:
    """Plot bars of single failures, and a map of double failures if they were analyzed."""
    names, doubles = system.actuators, bool((start.failures == 2).any())
    widths = [1.0, 2.0][: 1 + doubles]
    figure = new_figure(PAGE_IN, min(4.6, max(3.4, 1.8 + 0.22 * len(names))))
    bars, *right = figure.subplots(1, len(widths), squeeze=False, width_ratios=widths)[0]
    _bars(bars, names, start)
    if right:
        _pairs(right[0], names, pair_table(start))
    one_legend(figure, 4)
    title = f"{system.title}: {system.measure} left in the worst direction"
    figure.suptitle(title, parse_math=False)
    return figure


def _bars(axes: Axes, names: tuple[str, ...], start: ConditionAnalysis) -> None:
    for (kind, word), rows, aside in zip(KINDS.items(), start.singles.T, (-0.2, 0.2), strict=True):
        at, lost = np.arange(len(names)) + aside, ~start.survived[rows]
        axes.barh(at, np.nan_to_num(start.speed_left[rows]), 0.36, color=_COLORS[kind], label=word)
        axes.plot(0 * at[lost], at[lost], **_MARK)
    axes.plot([], [], **_MARK, label="task lost")
    axes.axvline(1.0, color=BLACK, lw=0.8, label="without failures")
    axes.set(xlabel="left, relative to no failure", title="one failure")
    axes.set(ylim=(len(names) - 0.5, -0.5))
    axes.set_yticks(range(len(names)), names, parse_math=False)
    axes.grid(axis="y", visible=False)


def _pairs(axes: Axes, names: tuple[str, ...], left: Array) -> None:
    """Plot the table of :func:`pair_table`: each actuator locked, then each free."""
    lost = matplotlib.colormaps[COLOR_MAP].with_extremes(under=VERMILION)
    image = axes.imshow(np.where(left == 0, -1.0, left), cmap=lost, vmin=0.0, vmax=1.0)
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
    axes.figure.colorbar(image, ax=axes, shrink=0.8, pad=0.08)


def pair_table(start: ConditionAnalysis) -> Array:
    """Return the fraction left after each pair, (2 n, 2 n), locked first; diagonal: singles."""
    n = start.codes.shape[1]
    table, left = np.full((2 * n, 2 * n), np.nan), np.where(start.survived, start.speed_left, 0.0)
    failed = np.hstack([start.codes == LOCKED, start.codes == FREE])
    for row in np.flatnonzero((start.failures == 1) | (start.failures == 2)):
        one, *_, other = np.flatnonzero(failed[row]).repeat(2)
        table[one, other] = table[other, one] = left[row]
    return table
