"""The figures of `fjh sweep` and `fjh atlas`: simulation against prediction, and what matters."""

from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from experiments.hexapod.fault_tolerance import Verdict, verdicts
from experiments.output.plotting import BLACK, BLUE, PAGE_IN, VERMILION, logarithmic, new_figure
from experiments.output.results import Picture
from experiments.sweep.dataset import Columns
from experiments.sweep.row import ANGLES, classified

COLORS = {"alpha": BLUE, "beta": VERMILION}
MARKERS = {"constant": "o", "analytic": "x"}

MOST_POINTS = 2000
"""More cannot be told apart, and make the PDF large."""


def sweep_picture(columns: Columns, compared: np.ndarray, summary: dict[str, Any]) -> Picture:
    """The figure of a sweep and its caption; `compared` are the runs of the linear model."""
    return Picture(
        "sweep",
        "Simulated over predicted RMS error of the runs that the linear model covers, and what the "
        "error depends on.",
        "On the left a cloud of points on the diagonal; on the right bars, one pair for each "
        "quantity varied, the strongest on top.",
        partial(_sweep, columns, compared, summary["influence"]),
    )


def atlas_picture(columns: Columns, summary: dict[str, Any]) -> Picture:
    """The figure of the atlas and its caption."""
    return Picture(
        "atlas_flown",
        "Every failure condition simulated: simulated against predicted error, and the error over "
        "the number of failed struts.",
        "On the left points on the diagonal, some yellow crosses far above it; on the right "
        "blue points on one level whatever the number of failures, yellow and black ones above.",
        partial(_atlas, columns, summary),
    )


def _sweep(
    columns: Columns, compared: np.ndarray, influence: dict[str, dict[str, float]]
) -> Figure:
    """Both RMS errors over their predictions; bars of rank correlation."""
    figure = new_figure(PAGE_IN, max(2.8, 0.6 + 0.15 * len(influence)))
    left, right = figure.subplots(1, 2, width_ratios=[1, 1])
    runs = np.flatnonzero(compared)
    chosen = runs[:: max(1, len(runs) // MOST_POINTS)]
    ends = []
    for angle in ANGLES:
        predicted, simulated = _errors(columns, angle, chosen)
        left.plot(predicted, simulated, "o", ms=2, mew=0, color=COLORS[angle], label=f"$\\{angle}$")
        ends += [predicted, simulated]
    if len(chosen):
        span = np.min(ends), np.max(ends)
        left.plot(span, span, color=BLACK, lw=0.6, zorder=0, label="equal")
        logarithmic(left, "xy")
    left.set(title=f"{len(runs)} runs that the linear model covers")
    _label(left)
    left.legend(loc="upper left")
    _bars(right, influence)
    return figure


def _errors(columns: Columns, angle: str, runs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """RMS errors of some runs, predicted and simulated."""
    rms = f"{angle}_rms_urad"
    return columns[f"predicted_{rms}"][runs], columns[rms][runs]


def _label(axes: Axes) -> None:
    axes.set(xlabel="RMS error, linear model, µrad", ylabel="RMS error, simulated, µrad")


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


def _atlas(columns: Columns, summary: dict[str, Any]) -> Figure:
    """Error of each condition and Jacobian, with the weight that makes it largest."""
    figure = new_figure(PAGE_IN, 3.6)
    found = [each for each in verdicts(classified()) if (columns["verdict"] == each.name).any()]
    left, right = figure.subplots(1, 2)
    for place, verdict in enumerate(found):
        aside = 0.12 * (place - (len(found) - 1) / 2)
        for jacobian in MARKERS:
            _draw(left, right, columns, verdict, jacobian, aside)
    predicted = [columns[f"predicted_{angle}_rms_urad"] for angle in ANGLES]
    span = np.nanmin(predicted), np.nanmax(predicted)
    left.plot(span, span, color=BLACK, lw=0.6, zorder=0)
    logarithmic(left, "xy")
    _label(left)
    logarithmic(right, "y")
    right.set(
        xlabel="struts failed, locked or free", ylabel="RMS error of $\\alpha$, simulated, µrad"
    )
    figure.suptitle(f"{summary['conditions']} failure conditions, {summary['runs']} runs")
    legend = [Line2D([], [], ls="", marker="o", color=v.color, label=v.label) for v in found]
    legend += [
        Line2D([], [], ls="", marker=marker, color=BLACK, mfc="none", label=f"{name} Jacobian")
        for name, marker in MARKERS.items()
    ]
    figure.legend(handles=legend, loc="outside lower center", ncols=3)
    return figure


def _draw(
    left: Axes, right: Axes, columns: Columns, verdict: Verdict, jacobian: str, aside: float
) -> None:
    """Both angles against their prediction, and alpha over the number of failures."""
    style = {"color": verdict.color, "ms": 3, "mew": 0.5, "mfc": "none"}
    runs, marker = _worst(columns, verdict.name, jacobian), MARKERS[jacobian]
    for angle in ANGLES:
        left.plot(*_errors(columns, angle, runs), marker, **style)
    right.plot(columns["failures"][runs] + aside, columns["alpha_rms_urad"][runs], marker, **style)


def _worst(columns: Columns, verdict: str, jacobian: str) -> np.ndarray:
    """Rows of a verdict and Jacobian, one for each condition: the weight with the largest error."""
    error = columns["alpha_rms_urad"]
    chosen = (columns["verdict"] == verdict) & (columns["jacobian"] == jacobian)
    rows = np.flatnonzero(chosen & np.isfinite(error))
    rows = rows[np.argsort(-error[rows], kind="stable")]
    _, first = np.unique(columns["struts"][rows].astype(str), return_index=True)
    return rows[np.sort(first)]
