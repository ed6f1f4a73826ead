"""The picture of the four goals: what each is about, and what it costs the major task."""

from functools import partial
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from experiments.goals.demonstration import REFERENCE, Demonstration, Outcome
from experiments.goals.runs import DEMONSTRATIONS
from experiments.study.plotting import (
    BLACK,
    BLUE,
    GREEN,
    PAGE_IN,
    PURPLE,
    SKY,
    VERMILION,
    logarithmic,
    new_figure,
)
from experiments.study.results import Picture
from sim import Array

MEASURES = {
    "hottest_coil_c": "hottest coil, °C",
    "stroke_margin_um": "least stroke left, µm",
    "clearance_um": "clearance, µm",
    "condition_number": "condition number of $J_m$",
}
_WINDOW_S = 0.5
_MANY_DECADES = 1e3
"""Of an axis whose ends are so far apart only the decades have labels."""

Outcomes = dict[str, dict[str, Outcome]]


def pictures(outcomes: Outcomes, summary: dict[str, Any]) -> list[Picture]:
    """The study's figure and its caption."""
    caption = (
        "Four secondary goals, a row each: pursued through the mapping, not pursued, and pursued "
        "by a pseudo-inverse that weights pointing by w. Left: the secondary measure and its "
        "limit. Middle: the pointing error. Right: how far the pointing differs, sample by sample, "
        "from a run with nothing to avoid; shaded: as far as another noise seed changes it."
    )
    alt = (
        "Four rows of panels: coil temperature, stroke left, clearance and condition number keep "
        "clear of their limits only when pursued. Beside them the pointing errors, and their "
        "changes, which stay below those of another seed where the goal is pursued."
    )
    return [Picture("goals", caption, alt, partial(figure_goals, outcomes, summary))]


def strategy_label(run: dict[str, Any]) -> str:
    """A run in a word; pseudo-inverses by their weight."""
    return "w = {:g}".format(run["major_weight"]) if run["major_weight"] else run["name"]


def figure_goals(outcomes: Outcomes, summary: dict[str, Any]) -> Figure:
    """A row for each goal: its measure and the pointing error over time, and what changed."""
    figure = new_figure(PAGE_IN, 8.9)
    figure.suptitle(
        "Four secondary goals: pursued through the mapping, not pursued, and by pseudo-inverse"
    )
    grid = figure.subplots(len(DEMONSTRATIONS), 3, width_ratios=[1, 1, 0.8])
    for row, one, goal in zip(grid, DEMONSTRATIONS, summary["goals"], strict=True):
        ours = outcomes[one.name]
        _measure(row[0], one, ours)
        _error(row[1], one, ours)
        _changes(row[2], goal, styles(ours))
    alike: dict[str, list[Artist]] = {}
    for axes in grid.flat:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            alike.setdefault(label, []).append(handle)
    # Of each the first and the last: a line over time, and a mark on the right.
    marks: list[Any] = [(handles[0], handles[-1]) for handles in alike.values()]
    figure.legend(marks, alike, loc="outside lower center", ncols=3)
    return figure


def styles(ours: dict[str, Outcome]) -> dict[str, dict[str, Any]]:
    """Lines of the strategies drawn over time; of the pseudo-inverses the one of least weight."""
    lightest = next(name for name in ours if name.startswith("pseudo_inverse"))
    curves = f"pseudo-inverse (curves: w = {lightest.rsplit('_', 1)[1]})"
    return {
        "nothing": {"color": VERMILION, "label": "goal not pursued"},
        "pursued": {"color": BLUE, "label": "goal pursued through the mapping"},
        lightest: {"color": PURPLE, "ls": "--", "label": curves},
    }


def _measure(axes: Axes, one: Demonstration, ours: dict[str, Outcome]) -> None:
    for name, style in styles(ours).items():
        axes.plot(ours[name].time_s, ours[name].measure, **style)
    axes.axhline(one.limit, color=BLACK, ls="-.", label="limit of the measure")
    side = "below" if one.keeps_below else "above"
    axes.set_title(f"{one.title}\n(must stay {side} the limit)")
    axes.set(xlabel="time, s", ylabel=MEASURES[one.measure])
    if one.measure == "condition_number":
        logarithmic(axes, "y")


def _error(axes: Axes, one: Demonstration, ours: dict[str, Outcome]) -> None:
    # Wide and below the others: where it is hidden, nothing has changed.
    reference = {"color": SKY, "lw": 3, "label": "reference: nothing to avoid"}
    for name, style in ({REFERENCE: reference} | styles(ours)).items():
        axes.plot(*_moving_rms(ours[name]), **style)
    axes.set_title(f"Pointing error\n(RMS over windows of {_WINDOW_S:g} s)")
    axes.set(xlabel="time, s", ylabel="both angles, µrad")
    logarithmic(axes, "y")
    low, high = axes.get_ylim()
    if high > _MANY_DECADES * low:
        axes.yaxis.set_major_locator(LogLocator())


def _changes(axes: Axes, goal: dict[str, Any], looks: dict[str, dict[str, Any]]) -> None:
    runs = [run for run in goal["runs"] if not run["name"].startswith(REFERENCE)]
    runs = sorted(runs, key=lambda run: (run["name"] != "nothing", run["major_weight"] or np.inf))
    noise = goal["another_seed"]["difference_rms_urad"]
    largest = [max(run["difference_rms_urad"]) for run in runs]
    for k, (run, change) in enumerate(zip(runs, largest, strict=True)):
        if change > 0:
            style = looks.get(run["name"], {"color": PURPLE}) | {"ls": ""}
            axes.plot(change, k, marker="o", ms=5, **style)
        else:
            place, words = (0.03, k), "0: the same run"
            axes.annotate(words, place, xycoords=("axes fraction", "data"), va="center")
    axes.axvspan(0, noise, color=GREEN, alpha=0.2, label="no more than another noise seed")
    axes.set_xscale("log")
    axes.set_xlim(min(noise, *(change for change in largest if change > 0)) / 3, None)
    names = [strategy_label(run).replace("nothing", "not pursued") for run in runs]
    axes.set_yticks(range(len(runs)), names)
    axes.set_title("Change of pointing\n(from the reference)")
    axes.set(xlabel="RMS, larger angle, µrad", ylim=(-0.6, len(runs) - 0.4))


def _moving_rms(outcome: Outcome) -> tuple[Array, Array]:
    """Middle of each window, and the RMS [urad] of both angles together in it."""
    ticks = round(_WINDOW_S / float(outcome.time_s[1] - outcome.time_s[0]))
    windows = len(outcome.time_s) // ticks
    squares = (1e6 * outcome.error_rad[: windows * ticks]) ** 2
    return (
        outcome.time_s[: windows * ticks].reshape(windows, ticks).mean(axis=1),
        np.sqrt(squares.sum(axis=1).reshape(windows, ticks).mean(axis=1)),
    )
