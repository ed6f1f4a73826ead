"""The picture of the four goals: what each is about, and what it costs the major task."""

from functools import partial
from itertools import chain
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from experiments.goals.demonstration import REFERENCE, Demonstration, Outcome
from experiments.goals.runs import DEMONSTRATIONS
from experiments.output.plotting import BLACK, BLUE, GREEN, PAGE_IN, PURPLE, VERMILION, new_figure
from experiments.output.results import Picture
from sim import Array

MEASURES = {
    "hottest_coil_c": "hottest coil, °C",
    "stroke_margin_um": "least stroke left, µm",
    "clearance_um": "clearance, µm",
    "condition_number": "condition number of $J_m$",
}
_WINDOW_S = 0.5

Outcomes = dict[str, dict[str, Outcome]]


def pictures(outcomes: Outcomes, summary: dict[str, Any]) -> list[Picture]:
    """The study's figure and its caption."""
    caption = "Four secondary goals pursued through the mapping, not at all, and conventionally."
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
    figure = new_figure(PAGE_IN, 8.4)
    figure.suptitle("Four secondary goals: pursued through the mapping, not at all, conventionally")
    grid = figure.subplots(len(DEMONSTRATIONS), 3, width_ratios=[1, 1, 0.8])
    for row, one, goal in zip(grid, DEMONSTRATIONS, summary["goals"], strict=True):
        ours = outcomes[one.name]
        _measure(row[0], one, ours)
        _error(row[1], one, ours)
        _changes(row[2], goal)
    handles, labels = zip(*(axes.get_legend_handles_labels() for axes in grid.flat), strict=True)
    legend = dict(zip(chain(*labels), chain(*handles), strict=True))
    figure.legend(legend.values(), legend.keys(), loc="outside lower center", ncols=3)
    return figure


def styles(ours: dict[str, Outcome]) -> dict[str, dict[str, Any]]:
    """Lines of the strategies drawn over time; of the pseudo-inverses the one of least weight."""
    lightest = next(name for name in ours if name.startswith("pseudo_inverse"))
    return {
        "nothing": {"color": VERMILION, "label": "nothing done"},
        lightest: {
            "color": PURPLE,
            "ls": "--",
            "label": f"pseudo-inverse, w = {lightest.rsplit('_', 1)[1]}",
        },
        "pursued": {"color": BLUE, "label": "pursued"},
    }


def _measure(axes: Axes, one: Demonstration, ours: dict[str, Outcome]) -> None:
    for name, style in styles(ours).items():
        axes.plot(ours[name].time_s, ours[name].measure, **style)
    axes.axhline(one.limit, color=BLACK, ls=":", label="limit")
    axes.set(title=one.title, xlabel="time, s", ylabel=MEASURES[one.measure])
    if one.measure == "condition_number":
        axes.set_yscale("log")
        axes.set_yticks([1, 2, 5, 10, 20, 50], ["1", "2", "5", "10", "20", "50"])
        axes.minorticks_off()


def _error(axes: Axes, one: Demonstration, ours: dict[str, Outcome]) -> None:
    shown = styles(ours) | {REFERENCE: {"color": BLACK, "ls": ":", "label": "nothing to avoid"}}
    for name, style in shown.items():
        axes.semilogy(*_moving_rms(ours[name]), **style)
    axes.set(title=f"pointing error, RMS of {_WINDOW_S:g} s", xlabel="time, s")
    axes.set_ylabel("both angles, µrad")
    axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axes.yaxis.set_major_formatter("{x:g}")
    axes.minorticks_off()


def _changes(axes: Axes, goal: dict[str, Any]) -> None:
    runs = [run for run in goal["runs"] if not run["name"].startswith(REFERENCE)]
    runs = sorted(runs, key=lambda run: (run["name"] != "nothing", run["major_weight"] or np.inf))
    noise = goal["another_seed"]["difference_rms_urad"]
    largest = [max(run["difference_rms_urad"]) for run in runs]
    colors = {"pursued": BLUE, "nothing": VERMILION}
    for k, (run, change) in enumerate(zip(runs, largest, strict=True)):
        if change > 0:
            axes.plot(change, k, "o", color=colors.get(run["name"], PURPLE), ms=5)
        else:
            axes.annotate(
                "the same run", (0.03, k), xycoords=("axes fraction", "data"), va="center"
            )
    axes.axvspan(0, noise, color=GREEN, alpha=0.2, label="less than another seed does")
    axes.set_xscale("log")
    axes.set_xlim(min(noise, *(change for change in largest if change > 0)) / 3, None)
    axes.set_yticks(range(len(runs)), [strategy_label(run) for run in runs])
    axes.set(title="change of pointing, RMS", xlabel="µrad", ylim=(-0.6, len(runs)))


def _moving_rms(outcome: Outcome) -> tuple[Array, Array]:
    """Middle of each window, and the RMS [urad] of both angles together in it."""
    ticks = round(_WINDOW_S / float(outcome.time_s[1] - outcome.time_s[0]))
    windows = len(outcome.time_s) // ticks
    squares = (1e6 * outcome.error_rad[: windows * ticks]) ** 2
    return (
        outcome.time_s[: windows * ticks].reshape(windows, ticks).mean(axis=1),
        np.sqrt(squares.sum(axis=1).reshape(windows, ticks).mean(axis=1)),
    )
