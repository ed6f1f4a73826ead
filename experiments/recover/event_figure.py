"""The figure of `fjh recover --events`: what each event costs against doing nothing."""

from functools import partial
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullFormatter

from argument_checks.ties import ascending
from experiments.recover.event_tables import headline
from experiments.study.plotting import BLUE, GREEN, ORANGE, PAGE_IN, VERMILION, new_figure
from experiments.study.results import Picture

_OF = {"actuator": BLUE, "supply": ORANGE, "machine": GREEN, "sensor": VERMILION}


def pictures(summary: dict[str, Any]) -> list[Picture]:
    """The figure and its caption."""
    picture = Picture(
        "recover_events",
        f"{headline(summary)} RMS pointing error from each event on, divided by that of the same "
        "controller without diagnosis, or from 0.5 s after it on, where that is more: all flights, "
        "and the worst as a large dot. Where the errors differ by less than the detector's noise, "
        "the ratio counts as at most 1.",
        "A row of dots for each kind of event, by what fails: actuator, supply, machine or sensor; "
        f"a line at {summary['worst_allowed']:g} on a logarithmic axis of the ratio of errors.",
        partial(figure_events, summary),
    )
    return [picture]


def figure_events(summary: dict[str, Any]) -> Figure:
    """The ratio of each flight, a row for each event."""
    figure = new_figure(PAGE_IN, 1.6 + 0.19 * len(summary["events"]))
    figure.suptitle(headline(summary))
    draw_ratios(figure.add_subplot(), summary)
    figure.legend(loc="outside lower center", ncols=5)
    return figure


def draw_ratios(axes: Axes, summary: dict[str, Any]) -> None:
    """Small dots for flights, a large one for the worst of each event."""
    events = [each for each in summary["events"] if each["counted"]]
    groups = [list(_OF).index(each["of"]) for each in events]
    order = ascending(groups, [each["counted_worst"] for each in events])
    events = [events[k] for k in order]
    for of, color in _OF.items():
        rows = [(row, each) for row, each in enumerate(events) if each["of"] == of]
        flights = [(ratio, row) for row, each in rows for ratio in each["counted"]]
        worst = [(each["counted_worst"], row) for row, each in rows]
        if worst:
            axes.plot(*zip(*flights, strict=True), "o", color=color, markersize=2)
            axes.plot(*zip(*worst, strict=True), "o", color=color, markersize=5, label=of)
    limit = summary["worst_allowed"]
    axes.axvline(limit, color="black", linewidth=0.8, linestyle="--", label=f"{limit:g} times")
    axes.set_xscale("log")
    axes.xaxis.set_major_formatter(FuncFormatter(lambda ratio, _: f"{ratio:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    low, high = axes.get_xlim()
    axes.set_xlim(min(low, 0.5), max(high, 2.0))
    axes.set(xlabel="RMS error from the event on / RMS error of doing nothing")
    axes.set_yticks(range(len(events)), [each["event"] for each in events])
    axes.set_ylim(-0.7, len(events) - 0.3)
