"""The figures of `fjh sweep` and `fjh atlas`: simulation against prediction, and what matters."""

from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.legend_handler import HandlerTuple
from matplotlib.lines import Line2D

from argument_checks.ties import ascending
from experiments.rig.hexapod.fault_tolerance import Verdict, verdicts
from experiments.study.dataset import Columns
from experiments.study.plotting import (
    BLACK,
    BLUE,
    GREEN,
    PAGE_IN,
    PURPLE,
    VERMILION,
    logarithmic,
    new_figure,
)
from experiments.study.results import Picture
from experiments.sweep.row import ANGLES, classified
from experiments.sweep.words import WORDS

COLORS = {"alpha": BLUE, "beta": VERMILION}
MARKERS = {"constant": "o", "analytic": "x"}
JACOBIANS = {"constant": "Jacobian of the nominal pose", "analytic": "of the estimated pose"}
VERDICTS = {
    "rigid": BLUE,
    "springs": GREEN,
    "drifts": PURPLE,
    "one_direction": VERMILION,
    "none": BLACK,
}
"""Colours of points; the map of all conditions fills areas, with colours too light for points."""

MOST_POINTS = 2000
"""More cannot be told apart, and make the PDF large."""
NEAR = 0.01
"""Relative distance from the linear model beyond which a point is hollow."""

_MODEL, _SIMULATED = "RMS error, linear model, µrad", "RMS error, simulated, µrad"


def sweep_picture(columns: Columns, compared: np.ndarray, summary: dict[str, Any]) -> Picture:
    """The figure of a sweep and its caption; `compared` are the runs of the linear model."""
    return Picture(
        "sweep",
        "RMS errors of the runs that the linear model covers, simulated against predicted; and "
        "what the errors of all runs depend on. Hollow points differ by more than 1 % from the "
        "linear model, which leaves out the steps of the converters: these runs have coarse ones.",
        "On the left a cloud of points on the diagonal, some hollow ones just above it; on the "
        "right bars, one pair for each quantity varied, the strongest on top.",
        partial(_sweep, columns, compared, summary["influence"]),
    )


def atlas_picture(columns: Columns, summary: dict[str, Any]) -> Picture:
    """The figure of the atlas and its caption."""
    return Picture(
        "atlas_flown",
        "The failure conditions that differ by symmetry, each with the weight that makes its error "
        "largest: errors of alpha and of beta against the linear model's, and that of alpha over "
        "the number of failed struts. Crosses above the line are conditions that are singular at "
        "the nominal pose only: near it the mapping has a gain of 1e5, and amplifiers saturate.",
        "Left and middle: points on the diagonal, some red crosses far above it. Right: blue and "
        "green points on one level whatever the number of failures, red and black ones above.",
        partial(_atlas, columns, summary),
    )


def _sweep(
    columns: Columns, compared: np.ndarray, influence: dict[str, dict[str, float]]
) -> Figure:
    """Both RMS errors over their predictions; bars of rank correlation."""
    figure = new_figure(PAGE_IN, max(3.2, 1.2 + 0.15 * len(influence)))
    left, right = figure.subplots(1, 2)
    runs = np.flatnonzero(compared)
    chosen = runs[:: max(1, len(runs) // MOST_POINTS)]
    for angle, color in COLORS.items():
        predicted, simulated = _errors(columns, angle, chosen)
        near = np.abs(simulated / predicted - 1) <= NEAR
        dot, ring = {"ms": 2, "mew": 0}, {"ms": 3.5, "mew": 0.6, "mfc": "none"}
        far = f"off by more than {100 * NEAR:g} %: coarse converters"
        for which, style, what in ((near, dot, f"within {100 * NEAR:g} %"), (~near, ring, far)):
            points = predicted[which], simulated[which]
            left.plot(*points, "o", color=color, label=f"$\\{angle}$, {what}", **style)
    _diagonal(left, columns, ANGLES, chosen)
    left.set(title=f"{len(runs)} runs that the linear model covers")
    left.set(xlabel=_MODEL, ylabel=_SIMULATED)
    _bars(right, influence)
    figure.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


def _errors(columns: Columns, angle: str, runs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """RMS errors of some runs, predicted and simulated."""
    rms = f"{angle}_rms_urad"
    return columns[f"predicted_{rms}"][runs], columns[rms][runs]


def _diagonal(axes: Axes, columns: Columns, angles: tuple[str, ...], runs: np.ndarray) -> None:
    """Where simulation and prediction are equal, and logarithmic scales, if there are any runs."""
    predicted = np.array([_errors(columns, angle, runs)[0] for angle in angles])
    if np.isfinite(predicted).any():
        span = np.nanmin(predicted), np.nanmax(predicted)
        axes.plot(span, span, color=BLACK, lw=0.6, zorder=0, label="equal")
        logarithmic(axes, "xy")


def _bars(axes: Axes, influence: dict[str, dict[str, float]]) -> None:
    rows = np.arange(len(influence))
    for k, angle in enumerate(ANGLES):
        values = [found[angle] for found in influence.values()]
        axes.barh(rows + 0.4 * k - 0.2, values, 0.4, color=COLORS[angle], label=f"$\\{angle}$")
    axes.set_yticks(rows, [WORDS[name] for name in influence])
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
    figure = new_figure(PAGE_IN, 3.4)
    figure.suptitle(f"{summary['conditions']} failure conditions, {summary['runs']} runs")
    found = [each for each in verdicts(classified()) if (columns["verdict"] == each.name).any()]
    *parity, right = figure.subplots(1, 3, sharey=True)
    for verdict in found:
        for jacobian in MARKERS:
            for axes, angle in zip(parity, ANGLES, strict=True):
                runs = _worst(columns, verdict.name, jacobian, angle)
                axes.plot(*_errors(columns, angle, runs), MARKERS[jacobian], **_style(verdict.name))
            _over_failures(right, columns, verdict, jacobian)
    for axes, angle in zip(parity, ANGLES, strict=True):
        _diagonal(axes, columns, (angle,), np.arange(len(columns["case"])))
        axes.set(title=f"$\\{angle}$", xlabel=_MODEL)
        if summary["explained"]:
            said = "far above the line: singular\nat the nominal pose only"
            axes.text(0.04, 0.96, said, transform=axes.transAxes, va="top")
    parity[0].set_ylabel(_SIMULATED)
    right.set(
        title="$\\alpha$", xlabel="struts failed, locked or free", xlim=(-0.6, 6.6), xticks=range(7)
    )
    _legend(figure, found)
    return figure


def _legend(figure: Figure, found: list[Verdict]) -> None:
    """A colour for each verdict, a marker for each Jacobian."""
    points: list[Any] = [
        tuple(Line2D([], [], ls="", marker=mark, **_style(each.name)) for mark in MARKERS.values())
        for each in found
    ]
    marks = [Line2D([], [], ls="", marker=m, **_style("none")) for m in MARKERS.values()]
    diagonal = Line2D([], [], color=BLACK, lw=0.6)
    figure.legend(
        [*points, *marks, diagonal],
        [*(each.label for each in found), *JACOBIANS.values(), "equal"],
        loc="outside lower center",
        ncols=4,
        handler_map={tuple: HandlerTuple(ndivide=None)},
    )


def _style(verdict: str) -> dict[str, Any]:
    return {"color": VERDICTS[verdict], "ms": 3.5, "mew": 0.6, "mfc": "none"}


def _over_failures(axes: Axes, columns: Columns, verdict: Verdict, jacobian: str) -> None:
    """Error of alpha over the number of failed struts, verdicts and Jacobians side by side."""
    runs = _worst(columns, verdict.name, jacobian, "alpha")
    aside = 0.12 * (list(VERDICTS).index(verdict.name) - 2) + 0.03 * (jacobian == "analytic")
    failures, (_, simulated) = columns["failures"][runs], _errors(columns, "alpha", runs)
    axes.plot(failures + aside, simulated, MARKERS[jacobian], **_style(verdict.name))


def _worst(columns: Columns, verdict: str, jacobian: str, angle: str) -> np.ndarray:
    """Rows of a verdict and Jacobian, one for each condition: the weight with the largest error."""
    error = columns[f"{angle}_rms_urad"]
    chosen = (columns["verdict"] == verdict) & (columns["jacobian"] == jacobian)
    rows = np.flatnonzero(chosen & np.isfinite(error))
    rows = rows[ascending(-error[rows])]
    _, first = np.unique(columns["struts"][rows].astype(str), return_index=True)
    return rows[np.sort(first)]
