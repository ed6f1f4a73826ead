"""The figures of `fjh sweep` and `fjh atlas`: simulation against prediction, and what matters."""

from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from argument_checks.ties import ascending
from experiments.rig.verdicts import KEPT
from experiments.study.dataset import Columns
from experiments.study.palette import BLACK, BLUE, GREEN, PURPLE, VERMILION
from experiments.study.plotting import COLUMN_IN, PAGE_IN, logarithmic, new_figure, one_legend
from experiments.study.results import Picture
from experiments.sweep.row import ANGLES
from experiments.sweep.words import WORDS

COLORS = {"alpha": BLUE, "beta": VERMILION}
LEFT = {
    "both pointing directions left": (KEPT, BLUE),
    "one left": (("one_direction",), VERMILION),
    "none left": (("none",), BLACK),
    "payload drifts": (("drifts",), PURPLE),
}
"""What is left of pointing: the verdicts that say so, and a colour."""

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
        partial(_sweep, columns, compared, summary),
    )


def atlas_picture(columns: Columns, summary: dict[str, Any]) -> Picture:
    """The figure of the atlas and its caption."""
    return Picture(
        "atlas_flown",
        "The failure conditions that differ by symmetry, each with the weight and the Jacobian "
        "that make its error largest: the larger of the errors of alpha and beta, and the linear "
        "model's. Crosses are conditions that are singular at the nominal pose only: near it the "
        "Jacobian of the estimated pose gives the mapping a gain of 1e5, and amplifiers saturate.",
        "Over the number of failed struts: points that keep both pointing directions lie on one "
        "low level, up to four failures; those that have lost one or both lie about ten times as "
        "high, where the linear model is, and some crosses far above it.",
        partial(_atlas, columns, summary),
    )


def _sweep(columns: Columns, compared: np.ndarray, summary: dict[str, Any]) -> Figure:
    """Both RMS errors over their predictions; bars of rank correlation."""
    influence = summary["influence"]
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
    _diagonal(left, columns, chosen)
    left.set_title(_agreement(summary["prediction"]))
    left.set(xlabel=_MODEL, ylabel=_SIMULATED)
    _bars(right, influence)
    figure.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


def _agreement(found: dict[str, Any]) -> str:
    """How many runs the linear model predicts, within what the study allows."""
    if not found["compared"]:
        return "The linear model covers none of the runs"
    agree = found["compared"] - found["off"]
    said = f"The error is as predicted in {agree} of {found['compared']} runs:"
    return f"{said}\nmedian difference {found['median_percent']:.2g} %"


def _errors(columns: Columns, angle: str, runs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """RMS errors of some runs, predicted and simulated."""
    rms = f"{angle}_rms_urad"
    return columns[f"predicted_{rms}"][runs], columns[rms][runs]


def _diagonal(axes: Axes, columns: Columns, runs: np.ndarray) -> None:
    """Where simulation and prediction are equal, and logarithmic scales, if there are any runs."""
    predicted = np.array([_errors(columns, angle, runs)[0] for angle in ANGLES])
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
        xlabel="Spearman's rank correlation",
        xlim=(-1, 1),
        xticks=(-1, -0.5, 0, 0.5, 1),
        ylim=(len(influence) - 0.4, -0.6),
    )
    axes.set_title(_strongest(influence), loc="right")
    axes.legend(loc="lower right")


def _strongest(influence: dict[str, dict[str, float]]) -> str:
    """What the error depends on most, and how little on the weights."""
    size = {name: max(map(abs, found.values())) for name, found in influence.items()}
    if not size:
        return ""
    first = next(iter(size))
    words = WORDS[first].rsplit(",", 1)[0]
    weights = [value for name, value in size.items() if "_weight_" in name]
    least = f"; weights at most {max(weights):.2f}" if weights else ""
    return f"The error depends most on the\n{words}, {size[first]:.2f}{least}"


def _atlas(columns: Columns, summary: dict[str, Any]) -> Figure:
    """Error of each condition and Jacobian, over the number of failed struts."""
    figure = new_figure(COLUMN_IN, 3.6)
    axes = figure.subplots()
    simulated, predicted = (
        np.max([columns[f"{of}{angle}_rms_urad"] for angle in ANGLES], axis=0)
        for of in ("", "predicted_")
    )
    runs = _worst(columns, simulated)
    place = _beside(columns["failures"][runs])
    off = np.isin(columns["case"][runs], [run["case"] for run in summary["explained"]])
    for label, (names, color) in LEFT.items():
        left = np.isin(columns["verdict"][runs], names)
        for some, marker, note in ((left & ~off, "o", ""), (left & off, "x", ", singular pose")):
            if some.any():
                style = {"color": color, "mfc": "none", "label": label + note}
                axes.plot(place[some], simulated[runs[some]], marker, **style)
    axes.plot(place, predicted[runs], "_", color=GREEN, label="linear model")
    safe = _always_possible(columns)
    none, largest = (simulated[columns["failures"] <= k].max() for k in (0, safe))
    axes.set_title(
        f"With any {safe} struts failed both angles are tracked:\n"
        f"RMS error at most {largest:.2f} µrad, {none:.2f} with none failed"
    )
    axes.set(xlabel="struts failed, locked or free", ylabel="RMS error, larger angle, µrad")
    axes.set_xticks(range(7))
    logarithmic(axes, "y")
    one_legend(figure, 2)
    return figure


def _always_possible(columns: Columns) -> int:
    """Up to how many failed struts every condition keeps both angles."""
    return int(columns["failures"][~columns["elastic_possible"].astype(bool)].min()) - 1


def _beside(failures: np.ndarray) -> np.ndarray:
    """Places of as many points side by side around each number of failures."""
    place = failures.astype(float)
    for count in np.unique(failures):
        alike = failures == count
        place[alike] += np.linspace(-0.35, 0.35, alike.sum()) if alike.sum() > 1 else 0.0
    return place


def _worst(columns: Columns, error: np.ndarray) -> np.ndarray:
    """One row for each condition: the weight and the Jacobian with the largest error."""
    rows = np.flatnonzero(np.isfinite(error))
    rows = rows[ascending(-error[rows])]
    _, first = np.unique(columns["struts"][rows].astype(str), return_index=True)
    return rows[np.sort(first)]
