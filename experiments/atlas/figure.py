"""The figure of `fjh atlas`: simulation against prediction, and against the failures."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from experiments.atlas.conditions import classified
from experiments.hexapod.failure_atlas import Verdict, verdicts
from experiments.output.palette import BLACK
from experiments.output.plotting import PAGE_IN, logarithmic, new_figure
from experiments.sweep.summary import ANGLES, Columns

MARKERS = {"constant": "o", "analytic": "x"}


def figure_atlas_flown(columns: Columns, summary: dict[str, Any]) -> Figure:
    """Error of each condition and Jacobian, with the weight that makes it largest."""
    figure = new_figure(PAGE_IN, 3.6)
    found = [each for each in verdicts(classified()) if (columns["verdict"] == each.name).any()]
    left, right = figure.subplots(1, 2)
    _against(left, columns, found)
    _by_failures(right, columns, found)
    figure.suptitle(f"{summary['conditions']} failure conditions, {summary['runs']} runs")
    legend = [Line2D([], [], ls="", marker="o", color=v.color, label=v.label) for v in found]
    legend += [
        Line2D([], [], ls="", marker=marker, color=BLACK, mfc="none", label=f"{name} Jacobian")
        for name, marker in MARKERS.items()
    ]
    figure.legend(handles=legend, loc="outside lower center", ncols=3)
    return figure


def _against(axes: Axes, columns: Columns, found: list[Verdict]) -> None:
    for verdict in found:
        for jacobian, marker in MARKERS.items():
            runs = _worst(columns, verdict.name, jacobian)
            for angle in ANGLES:
                predicted = columns[f"predicted_{angle}_rms_urad"][runs]
                simulated = columns[f"{angle}_rms_urad"][runs]
                axes.plot(
                    predicted, simulated, marker, color=verdict.color, ms=3, mew=0.5, mfc="none"
                )
    predicted = [columns[f"predicted_{angle}_rms_urad"] for angle in ANGLES]
    span = np.nanmin(predicted), np.nanmax(predicted)
    axes.plot(span, span, color=BLACK, lw=0.6, zorder=0)
    logarithmic(axes, "xy")
    axes.set(xlabel="RMS error, linear model, µrad", ylabel="RMS error, simulated, µrad")


def _by_failures(axes: Axes, columns: Columns, found: list[Verdict]) -> None:
    for place, verdict in enumerate(found):
        aside = 0.12 * (place - (len(found) - 1) / 2)
        for jacobian, marker in MARKERS.items():
            runs = _worst(columns, verdict.name, jacobian)
            axes.plot(
                columns["failures"][runs] + aside,
                columns["alpha_rms_urad"][runs],
                marker,
                color=verdict.color,
                ms=3,
                mew=0.5,
                mfc="none",
            )
    logarithmic(axes, "y")
    axes.set(
        xlabel="struts failed, locked or free", ylabel="RMS error of $\\alpha$, simulated, µrad"
    )


def _worst(columns: Columns, verdict: str, jacobian: str) -> np.ndarray:
    """Rows of a verdict and Jacobian, one for each condition: the weight with the largest error."""
    error = columns["alpha_rms_urad"]
    chosen = (columns["verdict"] == verdict) & (columns["jacobian"] == jacobian)
    rows = np.flatnonzero(chosen & np.isfinite(error))
    rows = rows[np.argsort(-error[rows], kind="stable")]
    _, first = np.unique(columns["struts"][rows].astype(str), return_index=True)
    return rows[np.sort(first)]
