"""A sweep as numbers, checks, tables and files, from its columns one at a time."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from scipy.stats import spearmanr

from argument_checks.ties import ascending, greatest, ranks
from experiments.rig.checks import closure_check
from experiments.rig.hexapod.metrics import each_angle
from experiments.study.dataset import Columns
from experiments.study.quantity import Quantity, columns_of, entry_of
from experiments.study.results import Check, Results
from experiments.study.resumable import Complete, Outcome, origin, rate
from experiments.study.tables import Column, Table, tabulate
from experiments.sweep.design import SweepRuns
from experiments.sweep.figure import sweep_picture
from experiments.sweep.row import ANGLES, INPUT_PEAK
from experiments.sweep.sweep_run import Range
from sim import Array

PREDICTION_TOLERANCE = 0.01
"""Largest relative distance of an RMS from the linear model's under the same noise, beside one step
of the converters. Of 40 runs of varied weights, failures, loops, noise and converters the furthest
used 44 % of both."""


def results(outcome: Outcome[SweepRuns]) -> Results:
    """Everything that `fjh sweep` publishes."""
    if not isinstance(outcome, Complete):
        return replace(described(outcome), published=True)
    columns = Columns(outcome.dataset.files())
    summary = summarize(outcome, columns)
    return replace(
        described(summary),
        pictures=[sweep_picture(columns, comparable(columns), summary)],
        records=[lambda folder: outcome.dataset.merge(folder / summary["dataset"])],
    )


def described(summary: dict[str, Any]) -> Results:
    """Tables, sentences and checks of a sweep, from `sweep.json` alone."""
    tables = groups(summary), influence(summary)
    return Results(summary, tables, notes(summary), checks(summary))


def summarize(sweep: Complete[SweepRuns], columns: Columns) -> dict[str, Any]:
    """All numbers of a sweep, ready for JSON; units are in the names."""
    design = sweep.campaign.runs.design
    varied = [each.name for each in design.factors if isinstance(each, Range)]
    return origin("sweep", sweep) | {
        "duration_s": design.duration_s,
        "status": dict(sorted(Counter(columns["status"].tolist()).items())),
        "groups": _groups(columns, design.duration_s),
        "prediction": prediction(columns),
        "influence": _influence(columns, varied),
    }


def checks(summary: dict[str, Any]) -> list[Check]:
    """Checks: RMS errors against the linear model, and closure residuals."""
    found = summary["prediction"]
    if not found["compared"]:
        return []
    what = (
        "difference between the RMS error and the linear model's, divided by "
        f"{100 * PREDICTION_TOLERANCE:g} % plus one converter step,"
    )
    worst = Check(what, f"run {found['worst_case']}", found["largest_over_allowed"], 1.0)
    return [worst, closure_check("all runs", found["closure_residual_max_m"])]


def comparable(columns: Columns) -> np.ndarray:
    """Which runs can be compared with the linear model: predicted, completed, not saturated."""
    peaks = np.max([columns[name] for name in INPUT_PEAK], axis=0)
    return np.isfinite(columns["predicted_alpha_rms_urad"]) & (peaks < 99.9)


def off_by(columns: Columns) -> tuple[Array, Array]:
    """Largest distance of each run from the linear model, over both angles, shape (runs,).

    First in parts of the predicted RMS; then over what is allowed, one and more being too much.
    """
    relative, allowed = [], []
    for angle in ANGLES:
        predicted = columns[f"predicted_{angle}_rms_urad"]
        off = np.abs(columns[f"{angle}_rms_urad"] - predicted)
        relative.append(off / predicted)
        allowed.append(off / (PREDICTION_TOLERANCE * predicted + columns["dac_step_urad"]))
    return np.max(relative, axis=0), np.max(allowed, axis=0)


def prediction(columns: Columns) -> dict[str, Any]:
    """Simulation compared with the linear model, over the runs that it covers."""
    compared = comparable(columns)
    relative, allowed = (off[compared] for off in off_by(columns))
    if not compared.any():
        return {"compared": 0, "off": 0, "closure_residual_max_m": None}
    return {
        "compared": int(compared.sum()),
        "off": int((allowed >= 1).sum()),
        "median_percent": 100 * float(np.median(relative)),
        "largest_percent": 100 * float(relative.max()),
        "largest_over_allowed": float(allowed.max()),
        "worst_case": int(columns["case"][compared][greatest(allowed)]),
        "closure_residual_max_m": float(columns["closure_residual_max_m"][compared].max()),
    }


def _groups(columns: Columns, duration_s: float) -> list[dict[str, Any]]:
    """Runs by the number of struts that fail in them, and whether the mapping knows."""
    failing = np.array([sum(letter != "S" for letter in struts) for struts in columns["struts"]])
    failing[columns["failure_time_s"] >= duration_s] = 0
    known = columns["known"].astype(bool)
    rms = [columns[f"{angle}_rms_urad"] for angle in ANGLES]
    groups = []
    for count in np.unique(failing).tolist():
        for told in (True, False) if count else (None,):
            chosen = (failing == count) & (True if told is None else known == told)
            if chosen.any():
                group = {"failures": count, "told": told, "runs": int(chosen.sum())}
                groups.append(group | entry_of(SPREAD, [values[chosen] for values in rms]))
    return groups


def _quantiles(level: float, rms: Sequence[Array]) -> list[float | None]:
    """Of the RMS errors of the runs that came to their end, for each angle."""
    ended = [values[np.isfinite(values)] for values in rms]
    return [float(np.quantile(values, level)) if len(values) else None for values in ended]


SPREAD = each_angle(
    Quantity("*_median_urad", partial(_quantiles, 0.5), heading="*", format=".3f"),
    Quantity("*_percentile_95_urad", partial(_quantiles, 0.95), heading="95 %", format=".3f"),
)


def _influence(columns: Columns, varied: list[str]) -> dict[str, dict[str, float]]:
    """Rank correlation of each range with the RMS errors, by its name; the strongest first."""
    rms = {angle: columns[f"{angle}_rms_urad"] for angle in ANGLES}
    ended = np.isfinite(rms["alpha"])
    if np.count_nonzero(ended) < 3:
        return {}
    ranked = {angle: ranks(values[ended]) for angle, values in rms.items()}
    if any(np.ptp(each) == 0 for each in ranked.values()):
        return {}  # all runs alike, as where no limit is reached
    values = {name: columns[name][ended] for name in varied}
    found = {
        name: {angle: float(spearmanr(each, ranked[angle]).statistic) for angle in ANGLES}
        for name, each in values.items()
        if np.ptp(each) > 0
    }
    names = list(found)
    strongest_first = ascending([-max(map(abs, found[name].values())) for name in names])
    return {names[k]: found[names[k]] for k in strongest_first}


def groups(summary: dict[str, Any]) -> Table:
    """One row for each number of failing struts, known and not known to the mapping."""
    known = {None: "none", True: "{}, known", False: "{}, not known"}
    columns = (
        Column("failed struts", lambda group: known[group["told"]].format(group["failures"])),
        Column("runs", "runs"),
        *columns_of(SPREAD),
    )
    return tabulate(
        "RMS of desired minus true angle, urad",
        columns,
        summary["groups"],
        "Median and 95th percentile over the runs.",
    )


def influence(summary: dict[str, Any]) -> Table:
    """One row for each range."""
    return tabulate(
        "Dependence of the errors on the varied quantities",
        (Column("", "name"), Column("alpha", "alpha", "+.2f"), Column("beta", "beta", "+.2f")),
        [{"name": name, **found} for name, found in summary["influence"].items()],
        "Spearman's rank correlation with the RMS error, over all completed runs.",
    )


def notes(summary: dict[str, Any]) -> list[str]:
    """Numbers of runs by status, comparison with the linear model, and the rate."""
    ended = ", ".join(f"{count} {status}" for status, count in summary["status"].items())
    found = summary["prediction"]
    sentences = [f"{summary['runs']} runs of {summary['duration_s']:g} s: {ended}."]
    if found["compared"]:
        sentences.append(
            f"{found['compared']} runs can be compared with the linear model. Its RMS error "
            f"differs by {found['median_percent']:.2g} % (median); the largest difference is "
            f"{found['largest_over_allowed']:.2g} of the allowed difference, "
            f"{100 * PREDICTION_TOLERANCE:g} % plus one converter step, which the model does not "
            "include."
        )
    return sentences + rate(summary)
