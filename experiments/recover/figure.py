"""The figures of `fjh paper recover`: speed and robustness of the diagnosis, cost of events."""

from functools import partial

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullFormatter

from argument_checks.ties import ascending
from experiments.recover.tables import WORST, Tables, over_unaware
from fjh.rig.events import EVENTS
from fjh.study.palette import BLACK, BLUE, GREEN, ORANGE, PURPLE, SKY, VERMILION
from fjh.study.plotting import PAGE_IN, new_figure
from fjh.study.result import Picture
from ftc.fdi import KINDS

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


def pictures(rows: pd.DataFrame, tables: Tables, noise: float) -> list[Picture]:
    """The figure of failures of the hexapod, or that of events."""
    if "by_event" in tables:
        caption = (
            "RMS error from each event on, divided by that of the same controller without "
            "diagnosis, or from recovery on, where that is more: all runs, and the worst as large "
            "dots. Where the errors differ by less than the sensors' noise, it is at most 1."
        )
        alt = f"A row of dots for each event, by what fails; a line at {WORST:g}; ratios of errors."
        draw = partial(figure_events, rows, tables["by_event"], noise)
        return [Picture("recover_events", caption, alt, draw)]
    if "beliefs" not in tables:
        return []
    caption = (
        "Above, with all mismatches of plant and model: time until the first diagnosis names the "
        "failed strut, and RMS pointing error after recovery over that of a controller informed at "
        "once. Below: how often the first strut named was the failed one, by the size of the "
        "mismatch; 1 is that of the other panels."
    )
    alt = (
        "Above left: three rising steps, the share of failures whose strut is named, against time. "
        "Above right: shares of runs against the ratio of errors, 1 if supervised, unaware more. "
        "Below: groups of mismatches against their size, with counts of struts rightly named."
    )
    return [Picture("recover", caption, alt, partial(figure_failures, rows))]


def figure_failures(rows: pd.DataFrame) -> Figure:
    """How fast, what recovery is worth, and what a wrong model costs."""
    flown = rows[rows.status.eq("flown") & rows.sort.isin(["failure", "size"])]
    mixed = flown[flown.sort.eq("failure") & flown.mismatch.eq("all")]
    figure = new_figure(PAGE_IN, 5.4)
    right, named_ms = mixed.right.eq(True), 1e3 * mixed.named_s
    figure.suptitle(
        f"The failed actuator was identified in {right.sum()} of {len(mixed)} failures, "
        f"{named_ms[right].median():.0f} ms after onset (median)"
    )
    panels = figure.subplot_mosaic("da;ss", height_ratios=[1.25, 1])
    draw_delays(panels["d"], mixed.kind, named_ms.where(right, np.inf))
    draw_after(panels["a"], mixed)
    draw_sizes(panels["s"], flown)
    for name in "da":  # legends above shares of up to 100 %, where no curve is, whatever the runs
        panels[name].set(ylim=(-0.04, 1.5), yticks=np.linspace(0, 1, 6))
        panels[name].legend(loc="upper center")
    return figure


def draw_delays(axes: Axes, kinds: pd.Series, named_ms: pd.Series) -> None:
    """Share of failures whose actuator is rightly named, over the time since the failure."""
    named = named_ms[named_ms < np.inf]
    for kind, color in zip(KINDS, (BLUE, VERMILION, GREEN), strict=True):
        if len(own := named_ms[kinds == kind]):
            axes.ecdf(own, label=f"{kind}: {(own < np.inf).sum()} of {len(own)}", color=color)
    axes.set_title(f"Naming the strut takes at most {named.max():.0f} ms")
    axes.set(xlabel="time since the failure, ms", ylabel="share of failures named")
    axes.set_xlim(0, 1.08 * named.max() if len(named) else 10)


def draw_after(axes: Axes, mixed: pd.DataFrame) -> None:
    """Share of runs whose error after recovery is at most so many times the informed one's."""
    for name, color in _AFTER.items():
        if f"rms_{name}_after" in mixed:
            over = (mixed[f"rms_{name}_after"] / mixed.rms_informed_after).dropna()
            axes.ecdf(over, label=f"{name}: up to {over.max():.2f}", color=color)
    axes.set_title("Error after recovery, over that of\na controller informed at once")
    axes.set(xlabel="RMS error / RMS error if informed", ylabel="share of runs")


def draw_sizes(axes: Axes, flown: pd.DataFrame) -> None:
    """A cell for each group of mismatches and size: how often the actuator is rightly named."""
    of = {name: group for group, names in GROUPS.items() for name in names}
    cells = flown.right.eq(True).groupby([flown.mismatch.map(of), flown.factor])
    names = [name for name in GROUPS if name in set(flown.mismatch.map(of))]
    right, count = (getattr(cells, how)().unstack().loc[names] for how in ("sum", "count"))
    missed = right < count
    colors = {"cmap": ListedColormap([SKY, ORANGE]), "vmin": 0, "vmax": 1, "edgecolors": "white"}
    axes.pcolormesh(missed.astype(float).where(count > 0), **colors)
    for (row, column), runs in np.ndenumerate(count):
        if runs > 0:
            text = f"{right.iloc[row, column]:g} of {runs:g}"
            axes.text(column + 0.5, row + 0.5, text, ha="center", va="center")
    largest = max(count.columns[np.logical_and.accumulate(~missed.any())], default=0)
    axes.set_title(f"The strut is always rightly named up to {largest:g} times the mismatch")
    axes.set_xticks(np.arange(count.shape[1]) + 0.5, [f"{factor:g}" for factor in count.columns])
    axes.set_yticks(np.arange(len(count)) + 0.5, count.index)
    axes.invert_yaxis()
    axes.set_xlabel("size of the mismatch")
    axes.grid(visible=False)


def figure_events(rows: pd.DataFrame, by_event: pd.DataFrame, noise: float) -> Figure:
    """Ratio of errors of each run, a row for each event; a large dot for the worst."""
    runs = rows[rows.sort.eq("event") & rows.status.eq("flown")]
    ratio = over_unaware(runs, noise)
    event = runs.event[ratio.index]
    worst = ratio.groupby(event).max()
    groups = [list(_OF).index(EVENTS[name].of) for name in worst.index]
    names = [worst.index[k] for k in ascending(groups, worst)]
    place = pd.Series(range(len(names)), index=names)
    harmless = (by_event.harmed.eq(0) & by_event.ended.eq(0)).sum()
    figure = new_figure(PAGE_IN, 1.6 + 0.19 * len(names))
    figure.suptitle(
        f"At most {WORST:g} times the error of doing nothing in {harmless} of {len(by_event)} "
        "kinds of event"
    )
    axes = figure.add_subplot()
    for of, color in _OF.items():
        if own := [name for name in names if EVENTS[name].of == of]:
            every = ratio[event.isin(own)]
            axes.plot(every, place[event[every.index]], "o", color=color, markersize=2)
            axes.plot(worst[own], place[own], "o", color=color, markersize=5, label=of)
    axes.axvline(WORST, color=BLACK, linewidth=0.8, linestyle="--", label=f"{WORST:g} times")
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
