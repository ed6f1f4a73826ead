"""The figure of the force experiment: what the optimum is worth, and what internal force is for."""

from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.force.answers import MAJOR_WEIGHTS, Tradeoff
from experiments.force.runs import Force
from experiments.study.palette import BLACK, BLUE, PURPLE, VERMILION
from experiments.study.plotting import PAGE_IN, new_figure
from experiments.study.results import Picture


def pictures(force: Force, summary: dict[str, Any]) -> list[Picture]:
    """The study's figure and its caption."""
    low, high = MAJOR_WEIGHTS[0], MAJOR_WEIGHTS[-1]
    caption = (
        "Left: the hexapod without failure exerts one moment on a fixture. A weighted "
        f"pseudo-inverse, its weight from {low:g} to {high:g} per N m, gives up the moment for "
        "less torque. Right: a platform of four legs presses with the same wrenches, one motor "
        "three times as costly as the others."
    )
    alt = (
        "Left: the force mapping alone has the least torque and no error; a curve of "
        "pseudo-inverses falls towards it from errors of up to all of the moment. Right: four "
        "pairs of bars; with internal force the hot motor has a third of its force."
    )
    return [Picture("force", caption, alt, partial(figure_force, force.tradeoff, summary))]


def figure_force(trade: Tradeoff, summary: dict[str, Any]) -> Figure:
    """Torque against error of the moment; and the force of a hot motor. Blue: the library's."""
    figure = new_figure(PAGE_IN, 3.0)
    left, right = figure.subplots(1, 2)
    _tradeoff(left, trade, summary["tradeoff"])
    _hot_motors(right, [use for use in summary["internal_force"] if use["motor"]])
    return figure


def _tradeoff(axes: Axes, trade: Tradeoff, numbers: dict[str, Any]) -> None:
    others, least = numbers["others"], trade.mapping.weighed[0]
    more = 100 * (others["dearest_over_mapping"] - 1)
    for tried, style, label in (
        (
            trade.others,
            {"color": BLACK, "marker": ".", "ls": ""},
            f"{others['count']} others: up to {more:.0f} % more",
        ),
        (trade.pseudo_inverse, {"color": VERMILION, "marker": "s"}, "weighted pseudo-inverse"),
        (trade.mapping, {"color": BLUE, "marker": "*", "ms": 10, "ls": ""}, "force mapping"),
    ):
        axes.semilogy(tried.weighed / least, 100 * tried.major_off, label=label, **style)
    off = numbers["mapping"]["major_off_percent"]
    axes.set_title(f"The force mapping exerts the moment to {off:.1g} %\nwith the least torque")
    axes.set(
        xlabel="weighted torque, relative to the force mapping's",
        ylabel="error of the moment, %",
        xlim=(-0.05, None),
    )
    axes.legend(loc="upper right")


def _hot_motors(axes: Axes, hot: list[dict[str, Any]]) -> None:
    """The force of each motor while it is the hot one."""
    ways = (("without", "without internal force", PURPLE), ("used", "with internal force", BLUE))
    force_n = {how: np.array([use[how]["hot_motor_rms_n"] for use in hot]) for how, *_ in ways}
    for k, (how, label, color) in enumerate(ways):
        bars = axes.bar(np.arange(4) + 0.4 * k - 0.2, force_n[how], 0.38, color=color, label=label)
        axes.bar_label(bars, fmt="{:.1f}", padding=1)
    less = 100 * (1 - (force_n["used"] / force_n["without"]).max())
    axes.set_title(f"Internal force takes {less:.0f} % off a hot motor,\nthe wrench unchanged")
    axes.set_xticks(range(4), [use["name"] for use in hot])
    axes.set_ylabel("force of the hot motor, RMS, N")
    axes.set_ylim(0, 1.15 * force_n["without"].max())
    axes.grid(visible=False, axis="x")
    axes.legend(loc="upper right", bbox_to_anchor=(1, 0.99))
