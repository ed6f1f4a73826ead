"""The figure of `fjh bench`: growth of the time, beside the peers."""

from functools import partial
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.output.plotting import BLACK, LINES, PAGE_IN, new_figure
from experiments.output.results import Picture

LABELS = {
    "prioritized": "velocity_mapping",
    "daqp": "daqp",
    "placo": "PlaCo",
    "pinv_formula": "eq. (25), pinv",
    "dgglse": "LAPACK dgglse",
}
_STYLES: dict[str, dict[str, Any]] = {
    name: {"color": color, "marker": mark}
    for name, color, mark in zip(LABELS, LINES, "osD^v", strict=False)
}


def picture(summary: dict[str, Any]) -> Picture:
    """The study's figure and its caption."""
    return Picture(
        "bench",
        "How the time of one Problem 1 grows with the number of actuators, and the time of one "
        "mapping with the size of the batch.",
        "Two panels with logarithmic axes. Left: five rising lines, microseconds against 6 to 200 "
        "actuators. Right: a line that falls with the size of the batch, beside the level lines "
        "of single solves.",
        partial(figure_growth, summary),
    )


def figure_growth(summary: dict[str, Any]) -> Figure:
    """Time over the number of actuators, and time of one mapping over the size of the batch."""
    figure = new_figure(PAGE_IN, 2.9)
    left, right = figure.subplots(1, 2, sharey=True)
    _actuators(left, summary["growth"]["actuators"])
    _batch(right, summary)
    for axes in (left, right):
        axes.minorticks_off()
        axes.legend(loc="upper left" if axes is left else "upper right")
    # Room for the legends above the lines.
    left.set_ylim(top=20 * left.get_ylim()[1])
    left.set_ylabel("time, µs")
    return figure


def _actuators(axes: Axes, growth: dict[str, Any]) -> None:
    axes.set(title="one Problem 1", xlabel="actuators $n$", xscale="log", yscale="log")
    for name, one in growth.items():
        label = f"{LABELS[name]}, $n^{{{one['exponent']:.1f}}}$"
        axes.plot(one["size"], one["median_us"], label=label, **_STYLES[name])
        axes.set_xticks(one["size"], map(str, one["size"]))


def _batch(axes: Axes, summary: dict[str, Any]) -> None:
    """Ours falls as the call is shared; the others solve one at a time."""
    axes.set(title="one mapping of a batch", xlabel="mappings in one call", xscale="log")
    one, name = summary["growth"]["batch"], "prioritized"
    axes.plot(one["size"], one["median_us"], label=LABELS[name], **_STYLES[name])
    us = {name: timing["median_us"] for name, timing in summary["timings"].items()}
    for name in ("daqp", "dgglse", "placo"):
        color = _STYLES[name]["color"]
        axes.axhline(us[name], color=color, ls="--", label=f"{LABELS[name]}, one at a time")
    goal_us = summary["ratios"]["batched_over_daqp"]["goal"] * us["daqp"]
    axes.axhline(goal_us, color=BLACK, ls=":", label="goal for large batches")
