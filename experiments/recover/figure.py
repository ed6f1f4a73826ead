"""Figures of `fjh paper recover`: speed and robustness of the diagnosis, errors by events."""

from functools import partial

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullFormatter

from argument_checks.ties import ascending
from experiments.recover.tables import WORST, Tables, harm_ratio
from fjh.rig.events import EVENTS
from fjh.study.palette import BLACK, BLUE, GREEN, ORANGE, PURPLE, SKY, VERMILION
from fjh.study.plotting import PAGE_IN, new_figure
from fjh.study.result import Picture
from ftc.fdi import KINDS

_AFTER = {"supervised": BLUE, "unaware": ORANGE, "other": PURPLE}
"""Colours of controllers whose error after recovery is compared with an informed one's."""
_OF = {"actuator": BLUE, "supply": ORANGE, "machine": GREEN, "sensor": VERMILION}
GROUPS = {
    "coils: gain, hysteresis": ("gain", "hysteresis"),
    "springs, dampers, masses": ("stiffness", "damping", "inertia"),
    "delay, integrator step": ("delay_ticks", "timestep_s"),
    "floor vibration": ("floor_um_per_s",),
    "drifts of coils and detector": ("gain_drift_per_s", "drift_urad_per_s"),
    "all at once": ("all",),
}
"""Names of mismatches, by group."""


def pictures(rows: pd.DataFrame, tables: Tables, noise: float) -> list[Picture]:
    """Return the figure of failures of the hexapod, or that of events."""
    if "by_event" in tables:
        caption = (
            "Ratio of the RMS error since each event to that of the same controller without "
            "diagnosis, or the ratio after recovery, if that is larger: all runs, and the worst "
            "as large dots. Ratios are at most 1 if errors differ by less than sensor noise."
        )
        alt = f"A row of dots for each event, by what fails; a line at {WORST:g}; ratios of errors."
        plot = partial(figure_events, rows, tables["by_event"], noise)
        return [Picture("recover_events", caption, alt, plot)]
    if "beliefs" not in tables:
        return []
    caption = (
        "Above, with all mismatches of plant and model: time until the failed strut is identified, "
        "and RMS pointing error after recovery over that of a controller informed at once. Below: "
        "number of failures in which the first identified strut was the failed one, by the size of "
        "the mismatch; 1 is that of the other panels."
    )
    alt = (
        "Above left: three rising steps, the share of failures whose strut is identified, over "
        "time. Above right: shares of runs over the ratio of errors, 1 if supervised, larger if "
        "unaware. Below: groups of mismatches and sizes, with counts of correct identifications."
    )
    return [Picture("recover", caption, alt, partial(figure_failures, rows))]


def figure_failures(rows: pd.DataFrame) -> Figure:
    """Plot delays of the diagnosis, errors after recovery, and the effect of mismatches."""
    simulated = rows[rows.status.eq("flown") & rows.sort.isin(["failure", "size"])]
    mixed = simulated[simulated.sort.eq("failure") & simulated.mismatch.eq("all")]
    figure = new_figure(PAGE_IN, 5.4)
    right, delay_ms = mixed.right.eq(True), 1e3 * mixed.named_s
    figure.suptitle(
        f"The failed actuator was identified in {right.sum()} of {len(mixed)} failures, "
        f"{delay_ms[right].median():.0f} ms after onset (median)"
    )
    panels = figure.subplot_mosaic("da;ss", height_ratios=[1.25, 1])
    plot_delays(panels["d"], mixed.kind, delay_ms.where(right, np.inf))
    plot_ratios(panels["a"], mixed)
    plot_sizes(panels["s"], simulated)
    for name in "da":  # space for the legend above the curves, which end at 1
        panels[name].set(ylim=(-0.04, 1.5), yticks=np.linspace(0, 1, 6))
        panels[name].legend(loc="upper center")
    return figure


def plot_delays(axes: Axes, kinds: pd.Series, delay_ms: pd.Series) -> None:
    """Plot the fraction of correctly identified failures over the time since onset."""
    isolated = delay_ms[delay_ms < np.inf]
    for kind, color in zip(KINDS, (BLUE, VERMILION, GREEN), strict=True):
        if len(ms := delay_ms[kinds == kind]):
            axes.ecdf(ms, label=f"{kind}: {(ms < np.inf).sum()} of {len(ms)}", color=color)
    axes.set_title(f"The strut is identified within {isolated.max():.0f} ms")
    axes.set(xlabel="time since the failure, ms", ylabel="share of failures identified")
    axes.set_xlim(0, 1.08 * isolated.max() if len(isolated) else 10)


def plot_ratios(axes: Axes, mixed: pd.DataFrame) -> None:
    """Plot the distribution of errors after recovery, relative to an informed controller's."""
    for name, color in _AFTER.items():
        if f"rms_{name}_after" in mixed:
            over = (mixed[f"rms_{name}_after"] / mixed.rms_informed_after).dropna()
            axes.ecdf(over, label=f"{name}: up to {over.max():.2f}", color=color)
    axes.set_title("Error after recovery, over that of\na controller informed at once")
    axes.set(xlabel="RMS error / RMS error if informed", ylabel="share of runs")


def plot_sizes(axes: Axes, simulated: pd.DataFrame) -> None:
    """Plot the number of correct identifications by group and size of mismatches."""
    group_of = {name: group for group, names in GROUPS.items() for name in names}
    cells = simulated.right.eq(True).groupby([simulated.mismatch.map(group_of), simulated.factor])
    names = [name for name in GROUPS if name in set(simulated.mismatch.map(group_of))]
    right, count = (getattr(cells, how)().unstack().loc[names] for how in ("sum", "count"))
    missed = right < count
    colors = {"cmap": ListedColormap([SKY, ORANGE]), "vmin": 0, "vmax": 1, "edgecolors": "white"}
    axes.pcolormesh(missed.astype(float).where(count > 0), **colors)
    for (row, column), runs in np.ndenumerate(count):
        if runs > 0:
            text = f"{right.iloc[row, column]:g} of {runs:g}"
            axes.text(column + 0.5, row + 0.5, text, ha="center", va="center")
    largest = max(count.columns[np.logical_and.accumulate(~missed.any())], default=0)
    axes.set_title(f"The strut is always identified up to {largest:g} times the mismatch")
    axes.set_xticks(np.arange(count.shape[1]) + 0.5, [f"{factor:g}" for factor in count.columns])
    axes.set_yticks(np.arange(len(count)) + 0.5, count.index)
    axes.invert_yaxis()
    axes.set_xlabel("size of the mismatch")
    axes.grid(visible=False)


def figure_events(rows: pd.DataFrame, by_event: pd.DataFrame, noise: float) -> Figure:
    """Plot ratios of errors of all runs, a row for each event, with a large dot for the worst."""
    runs = rows[rows.sort.eq("event") & rows.status.eq("flown")]
    ratio = harm_ratio(runs, noise)
    event = runs.event[ratio.index]
    worst = ratio.groupby(event).max()
    groups = [list(_OF).index(EVENTS[name].of) for name in worst.index]
    names = [worst.index[k] for k in ascending(groups, worst)]
    place = pd.Series(range(len(names)), index=names)
    harmless = (by_event.harmed.eq(0) & by_event.ended.eq(0)).sum()
    figure = new_figure(PAGE_IN, 1.6 + 0.19 * len(names))
    figure.suptitle(
        f"At most {WORST:g} times the error without diagnosis in {harmless} of {len(by_event)} "
        "kinds of event"
    )
    axes = figure.add_subplot()
    for of, color in _OF.items():
        if events := [name for name in names if EVENTS[name].of == of]:
            ratios = ratio[event.isin(events)]
            axes.plot(ratios, place[event[ratios.index]], "o", color=color, markersize=2)
            axes.plot(worst[events], place[events], "o", color=color, markersize=5, label=of)
    axes.axvline(WORST, color=BLACK, linewidth=0.8, linestyle="--", label=f"{WORST:g} times")
    axes.set_xscale("log")
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    low, high = axes.get_xlim()
    axes.set_xlim(min(low, 0.5), max(high, 2.0))
    axes.set(xlabel="RMS error since the event / RMS error without diagnosis")
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(-0.7, len(names) - 0.3)
    figure.legend(loc="outside lower center", ncols=5)
    return figure
