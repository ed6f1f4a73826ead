"""The picture of the four goals: each kept or lost, and what that costs the major task."""

from functools import partial
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from argument_checks.ties import greatest
from experiments.goals.demonstration import Demonstration, Outcome
from experiments.goals.runs import DEMONSTRATIONS
from experiments.study.palette import BLACK, BLUE, PURPLE, VERMILION
from experiments.study.plotting import PAGE_IN, logarithmic, new_figure, one_legend
from experiments.study.results import Picture

MEASURES = {
    "hottest_coil_c": "hottest coil, °C",
    "stroke_margin_um": "least stroke left, µm",
    "clearance_um": "clearance, µm",
    "condition_number": "condition number of $J_m$",
}
_WAYS: dict[str, dict[str, Any]] = {
    "nothing": {"color": VERMILION, "marker": "o", "label": "goal not pursued"},
    "pursued": {"color": BLUE, "marker": "o", "label": "goal pursued through the mapping"},
}

Outcomes = dict[str, dict[str, Outcome]]


def pictures(outcomes: Outcomes, summary: dict[str, Any]) -> list[Picture]:
    """The study's figure and its caption."""
    caption = (
        "Four secondary goals, pursued through the mapping and not pursued. Below: RMS of the "
        "change of the pointing at each control tick, relative to a run with nothing to avoid and "
        "divided by the change that another noise seed makes. Coils that are not kept cool do not "
        "change the pointing: no mark."
    )
    alt = (
        "Four panels: coil temperature, stroke left, clearance and condition number cross their "
        "limits when the goal is not pursued, and keep clear of them when it is. Below, marks of "
        "the pursued goals left of the line of another noise seed, those not pursued and those of "
        "pseudo-inverses with small weights far to the right."
    )
    return [Picture("goals", caption, alt, partial(figure_goals, outcomes, summary))]


def strategy_label(run: dict[str, Any]) -> str:
    """A run in a word; pseudo-inverses by their weight."""
    return "w = {:g}".format(run["major_weight"]) if run["major_weight"] else run["name"]


def figure_goals(outcomes: Outcomes, summary: dict[str, Any]) -> Figure:
    """The measure of each goal over time, and below how far the pointing changed."""
    figure = new_figure(PAGE_IN, 6.0)
    panels = figure.subplot_mosaic([[0, 1], [2, 3], [4, 4]], height_ratios=[1, 1, 1.1])
    for k, (one, goal) in enumerate(zip(DEMONSTRATIONS, summary["goals"], strict=True)):
        _measure(panels[k], one, outcomes[one.name], goal)
    _changes(panels[4], summary["goals"])
    one_legend(figure, 3)
    return figure


def _measure(
    axes: Axes, one: Demonstration, ours: dict[str, Outcome], goal: dict[str, Any]
) -> None:
    worst = {run["name"]: round(run[one.measure], 1) + 0.0 for run in goal["runs"]}
    for name, style in _WAYS.items():
        measure = ours[name].measure
        place = greatest(measure if one.keeps_below else -measure)
        axes.plot(ours[name].time_s, measure, markevery=[place], **style)
    axes.axhline(one.limit, color=BLACK, ls="-.", label="limit")
    _, _, unit = MEASURES[one.measure].partition(",")
    axes.set_title(
        f"{one.title}:\n{worst['pursued']:g}{unit} when pursued, {worst['nothing']:g} when not"
    )
    axes.set(xlabel="time, s", ylabel=MEASURES[one.measure])
    if one.measure == "condition_number":
        logarithmic(axes, "y")


def _changes(axes: Axes, goals: list[dict[str, Any]]) -> None:
    """How far each way to treat a goal changes the pointing, over what another seed changes."""
    pursued = []
    for row, goal in enumerate(goals):
        noise = goal["another_seed"]["difference_rms_urad"]
        changes = {run["name"]: max(run["difference_rms_urad"]) / noise for run in goal["runs"]}
        weighted = [run for run in goal["runs"] if run["major_weight"]]
        weights = ", ".join(f"{run['major_weight']:g}" for run in weighted)
        label = f"pseudo-inverse, weight {weights} (from right)"
        compromised = [changes[run["name"]] for run in weighted]
        axes.plot(compromised, [row] * len(weighted), "D--", color=PURPLE, label=label)
        for name, style in _WAYS.items():
            if changes[name] > 0:
                axes.plot(changes[name], row, **style)
        pursued.append(changes["pursued"])
    axes.axvline(1, color=BLACK, ls=":", label="another noise seed")
    axes.set_title(
        f"A pursued goal changes the pointing at most {max(pursued):.2f} times as much as another "
        "noise seed does"
    )
    logarithmic(axes, "x")
    axes.set_yticks(range(len(goals)), [goal["title"] for goal in goals])
    axes.set(xlabel="change of the pointing, larger angle, over that by another noise seed")
    axes.set_ylim(len(goals) - 0.5, -0.5)
