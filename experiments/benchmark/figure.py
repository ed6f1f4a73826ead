"""The figure of `fjh bench`: growth of the time beside the peers, and what became of the goals."""

from functools import partial
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.study.plotting import (
    BLACK,
    BLUE,
    GREEN,
    LINES,
    PAGE_IN,
    VERMILION,
    logarithmic,
    name_rows,
    new_figure,
)
from experiments.study.results import Picture

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
RATIOS = {
    "closed_loop_over_mj_step": "closed loop / physics alone",
    "loop_overhead_over_mink": "control tick without physics / mink",
    "tick_over_mink": "tick, general path / mink",
    "arm_tick_over_mink": "tick with limits, arm / mink",
    "humanoid_tick_over_mink": "tick with limits, humanoid / mink",
    "hexapod_tick_over_mink": "tick, hexapod's closed form / mink",
    "diagnosis_over_mj_step": "diagnosis / physics alone",
    "solve_over_daqp": "one Problem 1 / daqp",
    "solve_over_placo": "one Problem 1 / PlaCo",
    "solve_over_placo_built": "one Problem 1 / PlaCo, built",
    "limited_over_daqp": "Problem 1 with limits / daqp, built",
    "hierarchy3_over_daqp": "three levels with limits / daqp",
    "batched_over_daqp": "one mapping of a batch / daqp",
    "growth_over_daqp": "one Problem 1, 200 actuators / daqp",
}
"""The ratios in words."""


def picture(summary: dict[str, Any]) -> Picture:
    """The study's figure and its caption."""
    return Picture(
        "bench",
        "Time of one Problem 1 over the number of actuators, with the power of n that fits the "
        "largest sizes best (in brackets: of the flattest and the steepest piece between them); "
        "time of one mapping over the size of the batch; each ratio beside its bound and its goal.",
        "Three panels with logarithmic axes. Above left: five rising lines, microseconds against "
        "6 to 200 actuators. Above right: a line that falls with the size of the batch, beside the "
        "level lines of single solves. Below: a point with its range for each ratio, its bound and "
        "its goal, and in words whether they are met.",
        partial(figure_growth, summary),
    )


def figure_growth(summary: dict[str, Any]) -> Figure:
    """Time over the number of actuators and over the size of the batch; ratios and goals."""
    figure = new_figure(PAGE_IN, 6.6)
    # Twelfths of the width; what the ratios are, and what became of them, stands beside them.
    panels = figure.subplot_mosaic("nnnnnnbbbbbb;....rrrrr...")
    _actuators(panels["n"], summary["growth"]["actuators"])
    _batch(panels["b"], summary)
    _ratios(panels["r"], summary["ratios"])
    explained = panels["r"].get_legend_handles_labels()
    figure.legend(*explained, loc="outside lower center", ncols=4)
    return figure


def _actuators(axes: Axes, growth: dict[str, Any]) -> None:
    for name, one in growth.items():
        fit = one["large"]
        power = f"{fit['exponent']:.1f} ({fit['least']:.1f} to {fit['most']:.1f})"
        axes.plot(one["size"], one["median_us"], label=f"{LABELS[name]}: {power}", **_STYLES[name])
    same = growth["prioritized"]
    sizes, fitted = same["size"], same["large"]
    axes.set(title="one Problem 1", xlabel="actuators $n$", ylabel="time, µs")
    axes.set(xscale="log", yscale="log")
    axes.set_xticks(sizes, map(str, sizes))
    said = f"power of $n$, fitted from $n$ = {fitted['from']} to {fitted['to']}"
    axes.legend(loc="upper left", title=said)
    _room_above(axes, 1000)


def _batch(axes: Axes, summary: dict[str, Any]) -> None:
    """Ours falls as the call is shared; the others solve one at a time."""
    one = summary["growth"]["batch"]
    axes.plot(one["size"], one["median_us"], "o-", color=BLACK, label="velocity_mapping of a batch")
    us = {name: timing["median_us"] for name, timing in summary["timings"].items()}
    for name in ("prioritized", "daqp", "dgglse", "placo"):
        label = f"{LABELS[name]}, one at a time"
        axes.axhline(us[name], color=_STYLES[name]["color"], ls="--", label=label)
    axes.set(title="one mapping", xlabel="mappings in one call", ylabel="time, µs")
    axes.set(xscale="log", yscale="log")
    axes.legend(loc="upper right")
    _room_above(axes, 300)


def _room_above(axes: Axes, factor: float) -> None:
    """For a legend above the lines."""
    axes.minorticks_off()
    low, high = axes.get_ylim()
    axes.set_ylim(low, factor * high)


def _ratios(axes: Axes, ratios: dict[str, Any]) -> None:
    """Each ratio with its range over the rounds, beside its bound and its goal."""
    for row, one in enumerate(ratios.values()):
        axes.plot([one["p5"], one["p95"]], [row, row], color=BLUE, lw=1.5)
        axes.plot(one["ratio"], row, "o", color=BLUE)
        for limit, marker, color in (("bound", "|", VERMILION), ("goal", "x", GREEN)):
            if one[limit] is not None:
                axes.plot(one[limit], row, marker, color=color, ms=8, mew=1.5)
    axes.plot([], [], "o", color=BLUE, label="ratio of medians")
    axes.plot([], [], color=BLUE, lw=1.5, label="5 to 95 % of the rounds")
    axes.plot([], [], "|", color=VERMILION, ms=8, mew=1.5, label="bound: to stay below")
    axes.plot([], [], "x", color=GREEN, ms=8, mew=1.5, label="goal")
    axes.set_yticks(range(len(ratios)), [""] * len(ratios))
    name_rows(axes, [RATIOS[name] for name in ratios])
    name_rows(axes, [verdict(one) for one in ratios.values()], right=True)
    axes.set(xlabel="time / time", ylim=(len(ratios) - 0.5, -0.5))
    logarithmic(axes, "x")


def verdict(ratio: dict[str, Any]) -> str:
    """Which of its bound and its goal a ratio meets, in words."""
    met = {True: "met", False: "missed"}
    limits = {"bound": ratio["within_bound"], "goal": ratio["reaches_goal"]}
    said = [f"{name} {met[held]}" for name, held in limits.items() if held is not None]
    return ", ".join(said) or "no bound, no goal"
