"""The figure of `fjh sweep`: simulation against prediction, and what the error depends on."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.output.palette import BLACK, BLUE, VERMILION
from experiments.output.plotting import PAGE_IN, logarithmic, new_figure
from experiments.sweep.summary import ANGLES, Columns, comparable

MOST_POINTS = 2000
"""More cannot be told apart, and make the PDF large."""

COLORS = {"alpha": BLUE, "beta": VERMILION}


def figure_sweep(columns: Columns, summary: dict[str, Any]) -> Figure:
    """Both RMS errors over their predictions; bars of rank correlation."""
    influence = summary["influence"]
    figure = new_figure(PAGE_IN, max(2.8, 0.6 + 0.15 * len(influence)))
    left, right = figure.subplots(1, 2, width_ratios=[1, 1])
    _against(left, columns)
    _bars(right, influence)
    return figure


def _against(axes: Axes, columns: Columns) -> None:
    covered = np.flatnonzero(comparable(columns))
    chosen = covered[:: max(1, len(covered) // MOST_POINTS)]
    ends = []
    for angle in ANGLES:
        predicted, simulated = (
            columns[name][chosen] for name in (f"predicted_{angle}_rms_urad", f"{angle}_rms_urad")
        )
        axes.plot(predicted, simulated, "o", ms=2, mew=0, color=COLORS[angle], label=f"$\\{angle}$")
        ends += [predicted, simulated]
    if len(chosen):
        span = np.min(ends), np.max(ends)
        axes.plot(span, span, color=BLACK, lw=0.6, zorder=0, label="equal")
        logarithmic(axes, "xy")
    axes.set(
        title=f"{len(covered)} runs that the linear model covers",
        xlabel="RMS error, linear model, µrad",
        ylabel="RMS error, simulated, µrad",
    )
    axes.legend(loc="upper left")


def _bars(axes: Axes, influence: dict[str, dict[str, float]]) -> None:
    rows = np.arange(len(influence))
    for k, angle in enumerate(ANGLES):
        values = [found[angle] for found in influence.values()]
        axes.barh(rows + 0.4 * k - 0.2, values, 0.4, color=COLORS[angle], label=f"$\\{angle}$")
    axes.set_yticks(rows, list(influence))
    axes.set(
        title="what the RMS error depends on",
        xlabel="Spearman's rank correlation",
        xlim=(-1, 1),
        xticks=(-1, -0.5, 0, 0.5, 1),
        ylim=(len(influence) - 0.4, -0.6),
    )
    axes.legend(loc="lower right")
