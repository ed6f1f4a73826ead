"""The figures of `fjh recover`: how fast and how robust the diagnosis is; what events cost."""

from functools import partial
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle
from matplotlib.ticker import FuncFormatter, NullFormatter

from argument_checks.ties import ascending
from experiments.recover.statistics import WORST, counted
from experiments.rig.events import EVENTS
from experiments.study.palette import BLUE, GREEN, ORANGE, PURPLE, SKY, VERMILION
from experiments.study.plotting import PAGE_IN, new_figure
from experiments.study.results import Picture
from ftc.fdi.fault_model import KINDS

_AFTER = {"supervised": BLUE, "unaware": ORANGE, "other": PURPLE}
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
    title = headline(summary)
    if summary["by_event"]:
        caption = (
            f"{title} RMS error from each event on, divided by that of the same controller without "
            "diagnosis, or from recovery on, where that is more: all runs, and the worst as large "
            "dots. Where the errors differ by less than the sensors' noise, it is at most 1."
        )
        alt = f"A row of dots for each event, by what fails; a line at {WORST:g}; ratios of errors."
        draw = partial(figure_events, title, frame, summary["noise"])
        return [Picture("recover_events", caption, alt, draw)]
    if "beliefs" not in summary:
        return []
    caption = (
        f"{title} Above, with all mismatches of plant and model: time until the first diagnosis "
        "names the failed strut, and RMS pointing error after recovery over that of a controller "
        "informed at once. Below: how often the first strut named was the failed one, by the size "
        "of the mismatch; 1 is that of the other panels."
    )
    alt = (
        "Above left: three rising steps, the share of failures whose strut is named, against time. "
        "Above right: shares of runs against the ratio of errors, 1 if supervised, unaware more. "
        "Below: groups of mismatches against their size, with counts of struts rightly named."
    )
    return [Picture("recover", caption, alt, partial(figure_failures, title, frame))]


def headline(summary: dict[str, Any]) -> str:
    """How many failed actuators were named, and how fast; or in how many events harm is done."""
    if events := summary["by_event"]:
        harmless = sum(not each["harmed"] and not each["ended"] for each in events)
        said = f"At most {WORST:g} times the error of doing nothing in {harmless} of {len(events)}"
        return f"{said} kinds of event."
    failures = {each["mismatch"]: each for each in summary["by_mismatch"] if each["factor"] == 1.0}
    right, named_s = failures["all"]["right"], failures["all"]["named_s"]
    found = f"The failed actuator was identified in {right['count']} of {right['cases']} failures"
    return f"{found}, {1e3 * named_s['median']:.0f} ms after onset (median)." if named_s else found


def figure_failures(title: str, frame: pd.DataFrame) -> Figure:
    """How fast, what recovery is worth, and what a wrong model costs."""
    flown = frame[frame["status"].eq("flown") & frame["sort"].isin(["failure", "size"])]
    mixed = flown[flown["sort"].eq("failure") & flown["mismatch"].eq("all")]
    figure = new_figure(PAGE_IN, 5.4)
    figure.suptitle(title)
    panels = figure.subplot_mosaic("da;ss", height_ratios=[1.25, 1])
    draw_delays(panels["d"], mixed)
    draw_after(panels["a"], mixed)
    draw_sizes(panels["s"], flown)
    for name in "da":  # legends above shares of up to 100 %, where no curve is, whatever the runs
        panels[name].set(ylim=(-0.04, 1.5), yticks=np.linspace(0, 1, 6))
        panels[name].legend(loc="upper center")
    cells = {"rightly named in all failures": SKY, "wrong or not named in some": ORANGE}
    handles = [Patch(color=color, label=label) for label, color in cells.items()]
    figure.legend(handles=handles, loc="outside lower center", ncols=2)
    return figure


def draw_delays(axes: Axes, mixed: pd.DataFrame) -> None:
    """Share of failures whose actuator is rightly named, over the time since the failure."""
    named_ms = (1e3 * mixed["named_s"]).where(mixed["right"].eq(True), np.inf)
    latest_ms = named_ms[named_ms < np.inf].max() if named_ms.min() < np.inf else 10.0
    for kind, color in zip(KINDS, (BLUE, VERMILION, GREEN), strict=True):
        if len(own := named_ms[mixed["kind"] == kind]):
            label = f"{kind}: {int((own < np.inf).sum())} of {len(own)}"
            axes.ecdf(own, label=label, color=color)
    axes.set_title(f"Naming the strut takes at most {latest_ms:.0f} ms")
    axes.set(xlabel="time since the failure, ms", ylabel="share of failures named")
    axes.set(xlim=(0, 1.08 * latest_ms))


def draw_after(axes: Axes, mixed: pd.DataFrame) -> None:
    """Share of runs whose error after recovery is at most so many times the informed one's."""
    for name, color in _AFTER.items():
        if f"rms_{name}_after" in mixed:
            over = (mixed[f"rms_{name}_after"] / mixed["rms_informed_after"]).dropna()
            axes.ecdf(over, label=f"{name}: up to {over.max():.2f}", color=color)
    axes.set_title("Error after recovery, over that of\na controller informed at once")
    axes.set(xlabel="RMS error / RMS error if informed", ylabel="share of runs")


def draw_sizes(axes: Axes, flown: pd.DataFrame) -> None:
    """A cell for each group of mismatches and size: how often the actuator is rightly named."""
    of = {name: group for group, names in GROUPS.items() for name in names}
    cells = flown["right"].eq(True).groupby([flown["mismatch"].map(of), flown["factor"]])
    counts = cells.agg(["sum", "count"])
    groups = [group for group in GROUPS if group in counts.index.get_level_values(0)]
    factors = sorted(counts.index.unique(level=1))
    for (group, factor), (right, count) in counts.iterrows():
        row, column = groups.index(group), factors.index(factor)
        color = SKY if right == count else ORANGE
        axes.add_patch(Rectangle((column - 0.5, row - 0.5), 1, 1, fc=color, ec="white"))
        axes.text(column, row, f"{right} of {count}", ha="center", va="center")
    wrong = counts.index.get_level_values(1)[counts["sum"] < counts["count"]].min()
    largest = max((factor for factor in factors if not factor >= wrong), default=0)
    axes.set_title(f"The strut is always rightly named up to {largest:g} times the mismatch")
    axes.set_xticks(range(len(factors)), [f"{factor:g}" for factor in factors])
    axes.set_yticks(range(len(groups)), groups)
    axes.set(xlabel="size of the mismatch", xlim=(-0.5, len(factors) - 0.5))
    axes.set_ylim(len(groups) - 0.5, -0.5)
    axes.grid(visible=False)


def figure_events(title: str, frame: pd.DataFrame, noise: float) -> Figure:
    """Ratio of errors of each run, a row for each event; a large dot for the worst."""
    runs = frame[frame["sort"].eq("event") & frame["status"].eq("flown")]
    ratio = counted(runs, noise)
    worst = ratio.groupby(runs["event"].loc[ratio.index]).max()
    groups = [list(_OF).index(EVENTS[name].of) for name in worst.index]
    names = [worst.index[k] for k in ascending(groups, worst)]
    rows = pd.Series(range(len(names)), index=names)
    figure = new_figure(PAGE_IN, 1.6 + 0.19 * len(names))
    figure.suptitle(title)
    axes = figure.add_subplot()
    for of, color in _OF.items():
        if own := [name for name in names if EVENTS[name].of == of]:
            every = ratio[runs["event"].isin(own)]
            axes.plot(every, rows[runs["event"].loc[every.index]], "o", color=color, markersize=2)
            axes.plot(worst[own], rows[own], "o", color=color, markersize=5, label=of)
    axes.axvline(WORST, color="black", linewidth=0.8, linestyle="--", label=f"{WORST:g} times")
    axes.set_xscale("log")
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    low, high = axes.get_xlim()
    axes.set_xlim(min(low, 0.5), max(high, 2.0))
    axes.set(xlabel="RMS error from the event on / RMS error of doing nothing")
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(-0.7, len(names) - 0.3)
    figure.legend(loc="outside lower center", ncols=5)
    return figure
