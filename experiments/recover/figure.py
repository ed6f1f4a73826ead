"""The figures of `fjh recover`: how fast and how robust the diagnosis is; what events cost."""

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle
from matplotlib.ticker import FuncFormatter, NullFormatter

from argument_checks.ties import ascending
from experiments.recover.statistics import counted
from experiments.rig.events import EVENTS
from experiments.study.plotting import (
    BLUE,
    GREEN,
    ORANGE,
    PAGE_IN,
    PURPLE,
    SKY,
    VERMILION,
    new_figure,
)
from experiments.study.results import Picture
from ftc.fdi.fault_model import KINDS

_KINDS = {"locked": BLUE, "free": VERMILION, "weak": GREEN}
_AFTER = {
    "supervised": ("supervised", BLUE),
    "unaware": ("fault-unaware", ORANGE),
    "other": ("the other controller", PURPLE),
}
"""Controllers whose error after recovery is compared with that of an informed one."""
_OF = {"actuator": BLUE, "supply": ORANGE, "machine": GREEN, "sensor": VERMILION}
GROUPS = {
    "coils: gain, hysteresis": ("gain", "hysteresis"),
    "springs, dampers, masses": ("stiffness", "damping", "inertia"),
    "delay, integrator step": ("delay_ticks", "timestep_s"),
    "floor vibration": ("floor_um_per_s",),
    "drifts of coils and detector": ("gain_drift_per_s", "drift_urad_per_s"),
    "all at once": ("all",),
}
"""Mismatches of plant and model, by where they are."""


def pictures(summary: dict[str, Any], frame: pd.DataFrame) -> list[Picture]:
    """The figure of failures of the hexapod, or that of events, with its caption."""
    if summary["by_event"]:
        caption = (
            f"{headline(summary)} RMS error from each event on, divided by that of the same "
            "controller without diagnosis, or from recovery on, where that is more: all runs, and "
            "the worst as a large dot. Where the errors differ by less than the sensors' noise, "
            "the ratio counts as at most 1."
        )
        alt = (
            "A row of dots for each kind of event, by what fails: actuator, supply, machine or "
            f"sensor; a line at {summary['worst_allowed']:g} on a logarithmic axis of the ratio."
        )
        draw = partial(figure_events, summary, frame)
        return [Picture("recover_events", caption, alt, draw)]
    if "beliefs" not in summary:
        return []
    caption = (
        f"{headline(summary)} Above, with all mismatches of plant and model: time until the first "
        "diagnosis names the failed strut, and RMS pointing error after recovery over that of a "
        "controller informed at once, a step for each run. Below: how often the first strut named "
        "was the failed one, by the size of the mismatch; 1 is that of the other panels."
    )
    alt = (
        "Above left: three rising steps, the share of failures whose strut is named, against the "
        "time since the failure. Above right: the supervised controller's error is that of an "
        "informed one, the unaware controller's is larger. Below: a table of groups of mismatches "
        "against their size, with the count of failures whose strut was rightly named."
    )
    return [Picture("recover", caption, alt, partial(figure_failures, summary, frame))]


def headline(summary: dict[str, Any]) -> str:
    """How many failed actuators were named, and how fast; or in how many events harm is done."""
    if events := summary["by_event"]:
        limit = summary["worst_allowed"]
        harmless = sum(not each["harmed"] and not each["ended"] for each in events)
        return (
            f"At most {limit:g} times the error of doing nothing in {harmless} of {len(events)} "
            "kinds of event."
        )
    mixed = next(e for e in summary["by_mismatch"] if (e["mismatch"], e["factor"]) == ("all", 1.0))
    right, named = mixed["right"], mixed["named_s"]
    found = f"The failed actuator was identified in {right['right']} of {right['cases']} failures"
    return (
        f"{found}, {1e3 * named['median']:.0f} ms after onset (median)." if named else f"{found}."
    )


def figure_failures(summary: dict[str, Any], frame: pd.DataFrame) -> Figure:
    """How fast, what recovery is worth, and what a wrong model costs."""
    cases = frame[frame["sort"].eq("failure") & frame["mismatch"].eq("all")]
    cases = cases[cases["status"] == "flown"]
    figure = new_figure(PAGE_IN, 5.4)
    figure.suptitle(headline(summary))
    panels = figure.subplot_mosaic("da;ss", height_ratios=[1.25, 1])
    draw_delays(panels["d"], cases)
    draw_after(panels["a"], cases)
    draw_sizes(panels["s"], summary["by_mismatch"])
    cells = {"rightly named in all failures": SKY, "wrong or not named in some": ORANGE}
    handles = [Patch(color=color, label=label) for label, color in cells.items()]
    figure.legend(handles=handles, loc="outside lower center", ncols=2)
    return figure


def draw_delays(axes: Axes, cases: pd.DataFrame) -> None:
    """Share of failures whose actuator is named, over the time since then."""
    named_ms = 1e3 * cases["named_s"][cases["right"].eq(True)]
    latest_ms = named_ms.max() if len(named_ms) else 10
    for kind in KINDS:
        if count := int((cases["kind"] == kind).sum()):
            delays = sorted(named_ms[cases["kind"] == kind])
            label = f"{kind}: {len(delays)} of {count}"
            _steps(axes, [*delays, latest_ms], len(delays), count, label, _KINDS[kind])
    axes.set_title(f"Naming the strut takes at most {latest_ms:.0f} ms")
    axes.set(xlabel="time since the failure, ms", ylabel="share of failures named, %")
    axes.set(xlim=(0, 1.08 * latest_ms))
    _legend_above(axes)


def draw_after(axes: Axes, cases: pd.DataFrame) -> None:
    """Share of runs whose error after recovery is at most so many times the informed one's."""
    worst = dict[str, float]()
    for name, (label, color) in _AFTER.items():
        if f"rms_{name}_after" in cases:
            over = sorted((cases[f"rms_{name}_after"] / cases["rms_informed_after"]).dropna())
            worst[name] = over[-1]
            _steps(axes, over, len(over), len(over), f"{label}: up to {over[-1]:.2f}", color)
    axes.set_title(
        f"After recovery the error is at most {worst['supervised']:.2f} times\n"
        "that of a controller informed at once"
    )
    axes.set(xlabel="RMS error / RMS error if informed", ylabel="share of runs, %")
    _legend_above(axes)


def _legend_above(axes: Axes) -> None:
    """Over shares of up to 100 %, where no curve is, whatever the runs."""
    axes.set(ylim=(-4, 150), yticks=range(0, 101, 20))
    axes.legend(loc="upper center")


def _steps(
    axes: Axes, at: Sequence[float], reached: int, count: int, label: str, color: str
) -> None:
    """A step of 1 / count at each of the first values `at`, in ascending order."""
    shares = 100 * np.minimum(np.arange(len(at) + 1), reached) / count
    axes.step([at[0], *at], shares, where="post", color=color, label=label)


def draw_sizes(axes: Axes, entries: Sequence[dict[str, Any]]) -> None:
    """A cell for each group and size: in how many failures the actuator is rightly named."""
    sizes = [each for each in entries if each["mismatch"] != "exact"]
    factors = sorted({each["factor"] for each in sizes})
    known = {each["mismatch"] for each in sizes}
    groups = {group: names for group, names in GROUPS.items() if known.intersection(names)}
    for row, names in enumerate(groups.values()):
        for column, factor in enumerate(factors):
            own = [e["right"] for e in sizes if e["mismatch"] in names and e["factor"] == factor]
            if own:
                right, count = (sum(rate[key] for rate in own) for key in ("right", "cases"))
                color = SKY if right == count else ORANGE
                axes.add_patch(Rectangle((column - 0.5, row - 0.5), 1, 1, fc=color, ec="white"))
                axes.text(column, row, f"{right} of {count}", ha="center", va="center")
    axes.set_title(
        f"The strut is always rightly named up to {tolerated(sizes):g} times the mismatch"
    )
    axes.set_xticks(range(len(factors)), [f"{factor:g}" for factor in factors])
    axes.set_yticks(range(len(groups)), list(groups))
    axes.set(xlabel="size of the mismatch", xlim=(-0.5, len(factors) - 0.5))
    axes.set_ylim(len(groups) - 0.5, -0.5)
    axes.grid(visible=False)


def tolerated(sizes: Sequence[dict[str, Any]]) -> float:
    """The largest size up to which the first actuator named was the failed one in every run."""
    wrong = [e["factor"] for e in sizes if e["right"]["right"] < e["right"]["cases"]]
    return max((e["factor"] for e in sizes if e["factor"] < min(wrong, default=np.inf)), default=0)


def figure_events(summary: dict[str, Any], frame: pd.DataFrame) -> Figure:
    """Ratio of errors of each run, a row for each event; a large dot for the worst."""
    runs = frame[frame["sort"].eq("event") & frame["status"].eq("flown")]
    runs = runs.assign(ratio=counted(runs, summary["noise"])).dropna(subset="ratio")
    ratios = {str(name): list(own["ratio"]) for name, own in runs.groupby("event", sort=False)}
    groups = [list(_OF).index(EVENTS[name].of) for name in ratios]
    order = ascending(groups, [max(own) for own in ratios.values()])
    names = [list(ratios)[k] for k in order]
    figure = new_figure(PAGE_IN, 1.6 + 0.19 * len(names))
    figure.suptitle(headline(summary))
    axes, limit = figure.add_subplot(), summary["worst_allowed"]
    for of, color in _OF.items():
        rows = [(row, ratios[name]) for row, name in enumerate(names) if EVENTS[name].of == of]
        for size, label, taken in ((2, None, list), (5, of, lambda own: [max(own)])):
            if dots := [(ratio, row) for row, own in rows for ratio in taken(own)]:
                axes.plot(*zip(*dots, strict=True), "o", color=color, markersize=size, label=label)
    axes.axvline(limit, color="black", linewidth=0.8, linestyle="--", label=f"{limit:g} times")
    axes.set_xscale("log")
    axes.xaxis.set_major_formatter(FuncFormatter(lambda ratio, _: f"{ratio:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    low, high = axes.get_xlim()
    axes.set_xlim(min(low, 0.5), max(high, 2.0))
    axes.set(xlabel="RMS error from the event on / RMS error of doing nothing")
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(-0.7, len(names) - 0.3)
    figure.legend(loc="outside lower center", ncols=5)
    return figure
