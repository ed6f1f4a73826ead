"""The study's figures: both ratios of every candidate, and what the paper's Fig. 5 would show."""

from collections.abc import Mapping
from functools import partial
from typing import Any

from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from experiments.recording.plots import spiral
from experiments.rig.run import Run
from experiments.study.palette import BLUE, GREEN, VERMILION
from experiments.study.plotting import PAGE_IN, name_rows, new_figure
from experiments.study.results import Picture
from experiments.uncorrected.candidates import CLOCKWISE, RETUNED
from experiments.uncorrected.runs import Uncorrected

ANGLES = (("alpha", "$\\alpha$", BLUE, "o"), ("beta", "$\\beta$", VERMILION, "s"))

BAND = 0.15
"""Opacity of what lies within the tolerance."""

SHOWN = (CLOCKWISE.name, RETUNED.name)
"""Candidates whose uncorrected spiral is drawn: a limit on the demand, and a lock off centre."""


def pictures(study: Uncorrected, summary: dict[str, Any]) -> list[Picture]:
    """The figures and their captions; that of the spirals where their candidates were run."""
    candidates = Picture(
        "uncorrected",
        "Candidate explanations of Table I's last column: RMS error with strut 1 locked, the "
        "mapping not informed, over that of W_a. Hollow: W_a, W_d or W_e is no longer Table I's.",
        "A row for each candidate with the ratios of alpha and beta, beside bands of the paper's "
        "ratios. Only those with a limit on the demanded pointing, marked in green, have filled "
        "marks in both bands.",
        partial(figure_uncorrected, summary),
    )
    spirals = Picture(
        "demand_limit",
        "What Fig. 5 would show of a limit on the pointing that the compensators demand, and of "
        "a lock off centre: strut 1 locked, not known to the mapping.",
        "Two uncorrected spirals. The limited one, marked as meeting Table I, is cut off along "
        "alpha in its outer turns; the one locked off centre begins with a tail.",
        partial(figure_demand_limit, study.runs, summary),
    )
    return [candidates, spirals] if study.runs.keys() >= set(SHOWN) else [candidates]


def figure_uncorrected(summary: dict[str, Any]) -> Figure:
    """Both ratios of every candidate; filled where the other columns stay Table I's."""
    shown = [one for one in summary["candidates"] if one["ratio"]]
    figure = new_figure(PAGE_IN, 1.4 + 0.17 * len(shown))
    names, axes = figure.subplots(1, 2)
    names.set_axis_off()  # the room for those of the candidates
    for name, _, color, _ in ANGLES:
        axes.axvspan(*_band(summary, name), color=color, alpha=BAND, lw=0)
    for row, one in enumerate(shown):
        for (_, _, color, marker), ratio in zip(ANGLES, one["ratio"], strict=True):
            face = color if one["meets_w_a"] and one["meets_corrected"] else "white"
            axes.plot(ratio, row, marker, color=color, mfc=face, ms=4.5)
        if one["explains"]:
            axes.axhspan(row - 0.45, row + 0.45, color=GREEN, alpha=BAND, lw=0, zorder=0)
    name_rows(axes, [one["what"].replace("W_a", "$W_a$") for one in shown])
    axes.set_yticks(range(len(shown)), [""] * len(shown))
    axes.set(xscale="log", ylim=(len(shown) - 0.5, -0.5), xlim=(1, 6))
    axes.set_xlabel("error uncorrected / error with all struts sound")
    axes.set_xticks([1, 1.5, 2, 3, 4, 6], ["1", "1.5", "2", "3", "4", "6"])
    axes.minorticks_off()
    figure.suptitle(_conclusion(summary))
    figure.legend(handles=_legend(summary), loc="outside lower center", ncols=3)
    return figure


def _conclusion(summary: dict[str, Any]) -> str:
    """How many candidates reproduce Table I, and what they have in common."""
    met = [one for one in summary["candidates"] if one["explains"]]
    said = f"{len(met)} of {len(summary['candidates']) - 1} explanations reproduce all of Table I"
    limited = met and all("demand_limit_urad" in one["differs"] for one in met)
    return f"{said}, each with a limit on the demanded pointing" if limited else said


def _band(summary: dict[str, Any], name: str) -> tuple[float, float]:
    """Ratios within the tolerance of the paper's."""
    ratio, tolerance = summary["paper"][f"{name}_ratio"], summary["paper"]["ratio_tolerance"]
    return ratio * (1 - tolerance), ratio * (1 + tolerance)


def _legend(summary: dict[str, Any]) -> list[Line2D | Patch]:
    within = f"within {100 * summary['paper']['ratio_tolerance']:.0f} % of the paper's"
    points, bands = [], []
    for name, symbol, color, marker in ANGLES:
        ratio = f"{symbol}, {within} {summary['paper'][f'{name}_ratio']:.2f}"
        points.append(Line2D([], [], ls="", marker=marker, color=color, label=symbol))
        bands.append(Patch(color=color, alpha=BAND, lw=0, label=ratio))
    hollow = Line2D([], [], ls="", marker="o", color=BLUE, mfc="white")
    hollow.set_label("hollow: another column is off")
    met = Patch(color=GREEN, alpha=BAND, lw=0, label="reproduces all of Table I")
    return [points[0], bands[0], hollow, points[1], bands[1], met]


def figure_demand_limit(
    runs: Mapping[str, Mapping[str, Run | float]], summary: dict[str, Any]
) -> Figure:
    """What Fig. 5 would show of a limit on the demand, and of a lock off centre."""
    figure = new_figure(PAGE_IN, 3.75)
    by_name = {one["name"]: one for one in summary["candidates"]}
    limit, lock = (by_name[name] for name in SHOWN)
    reach = limit["signature"]["outer_reach_percent"][0]
    error_urad = lock["signature"]["largest_error_first_turn_urad"]
    titles = (
        f"{_verdict(limit)}: a limit of {limit['differs']['demand_limit_urad']:g} µrad on the\n"
        f"demand; the outer turns reach {reach:.0f} % in $\\alpha$",
        f"{_verdict(lock)}: a lock {1e6 * abs(lock['differs']['lock_m']):g} µm off\n"
        f"centre; the first turn is up to {error_urad:.0f} µrad off",
    )
    for axes, name, title in zip(figure.subplots(1, 2), SHOWN, titles, strict=True):
        run = runs[name]["W_a_uncorrected"]
        if isinstance(run, Run):
            spiral(axes, run, title)
        if by_name[name]["explains"]:
            axes.spines[:].set(color=GREEN, linewidth=2)
    return figure


def _verdict(candidate: dict[str, Any]) -> str:
    return "✓ Reproduces Table I" if candidate["explains"] else "Does not reproduce Table I"
