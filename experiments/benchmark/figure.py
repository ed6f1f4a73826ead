"""The figure of `fjh bench`: each ratio to what others need, and growth beside their solvers."""

from functools import partial
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.benchmark.ratios import RATIOS
from experiments.study.palette import BLACK, BLUE, GREEN, ORANGE, PURPLE, SKY, VERMILION
from experiments.study.plotting import PAGE_IN, logarithmic, name_rows, new_figure
from experiments.study.results import Picture

_STYLES: dict[str, dict[str, Any]] = {
    "prioritized": {"label": "velocity_mapping", "color": BLACK, "marker": "o", "lw": 2.0},
    "daqp": {"label": "daqp", "color": GREEN, "marker": "s"},
    "placo": {"label": "PlaCo", "color": ORANGE, "marker": "D"},
    "pinv_formula": {"label": "eq. (25), pinv", "color": PURPLE, "marker": "^"},
    "dgglse": {"label": "LAPACK dgglse", "color": SKY, "marker": "v"},
}
WORDS = {ratio.name: ratio.words for ratio in RATIOS if ratio.words is not None}
"""Of the ratios that compare with others."""
_COLORS = {"less time": BLUE, "about as much": "0.5", "more time": VERMILION}


def picture(summary: dict[str, Any]) -> Picture:
    """The study's figure and its caption."""
    return Picture(
        "bench",
        f"{headline(summary)} Points: ratios of medians; lines: 5 to 95 % of the rounds.",
        "Above: a point for each ratio of times on a logarithmic axis, left of 1 where this "
        "library is faster. Below: time of one Problem 1 against the number of actuators; beyond "
        "20 actuators that of velocity_mapping grows least.",
        partial(figure_bench, summary),
    )


def headline(summary: dict[str, Any]) -> str:
    """How many comparisons are won and lost, in one sentence."""
    found = [comparison(summary["ratios"][name]) for name in WORDS]
    less, alike, more = (found.count(name) for name in _COLORS)
    return (
        f"This library needs less time in {less} of {len(found)} comparisons, about as much in "
        f"{alike}, more in {more}."
    )


def comparison(ratio: dict[str, Any]) -> str:
    """Whether a ratio is below or above 1 in 95 % of the rounds."""
    return "less time" if ratio["p95"] < 1 else "more time" if ratio["p5"] > 1 else "about as much"


def figure_bench(summary: dict[str, Any]) -> Figure:
    """Ratios above, growth below."""
    figure = new_figure(PAGE_IN, 5.8)
    figure.suptitle(headline(summary))
    # Twelfths of the width: the names of the ratios stand on the left.
    panels = figure.subplot_mosaic("....rrrrrrr.;nnnnnnnnnnnn", height_ratios=[1.6, 1])
    _ratios(panels["r"], {name: summary["ratios"][name] for name in WORDS})
    _actuators(panels["n"], summary["growth"]["actuators"])
    return figure


def _ratios(axes: Axes, ratios: dict[str, Any]) -> None:
    """Each ratio with its range over the rounds, its value beside it."""
    axes.axvline(1, color=BLACK, lw=0.8, label="equal")
    found = [comparison(one) for one in ratios.values()]
    for row, (one, name) in enumerate(zip(ratios.values(), found, strict=True)):
        style = {"color": _COLORS[name], "marker": "o", "ms": 5, "lw": 1.5, "markevery": [1]}
        label = name if row == found.index(name) else None
        axes.plot([one["p5"], one["ratio"], one["p95"]], [row] * 3, **style, label=label)
    axes.set_yticks(range(len(ratios)), [""] * len(ratios))
    name_rows(axes, [WORDS[name] for name in ratios])
    name_rows(axes, [f"{one['ratio']:#.2g}" for one in ratios.values()], right=True)
    axes.set(xlabel="time / time: left is better", ylim=(len(ratios) - 0.5, -0.5))
    logarithmic(axes, "x")
    axes.legend(loc="best")


def _actuators(axes: Axes, growth: dict[str, Any]) -> None:
    """Time over the number of actuators, for each solver."""
    for name, one in growth.items():
        axes.plot(one["size"], one["median_us"], **_STYLES[name])
    ours, daqp = growth["prioritized"], growth["daqp"]
    axes.set_title(
        f"One Problem 1 of {ours['size'][-1]} actuators takes {ours['median_us'][-1]:.0f} µs, "
        f"with daqp {daqp['median_us'][-1]:.0f} µs"
    )
    axes.set(xlabel="actuators", ylabel="time, µs: lower is better", xscale="log", yscale="log")
    axes.set_xticks(ours["size"], map(str, ours["size"]))
    axes.minorticks_off()
    axes.legend(loc="upper left", ncols=2)
