"""The simulated failure conditions as numbers, checks, tables and files, compared with theory."""

import itertools
from dataclasses import replace
from typing import Any

import numpy as np
import pyarrow as pa

from argument_checks.ties import ascending
from experiments.rig.checks import closure_check
from experiments.rig.hexapod.fault_tolerance import pointing_verdicts
from experiments.rig.verdicts import KEPT
from experiments.study.dataset import Columns
from experiments.study.results import Check, Results
from experiments.study.resumable import Complete, Outcome, origin, rate
from experiments.study.tables import Column, Table, tabulate
from experiments.sweep.design import SweepRuns
from experiments.sweep.figure import atlas_picture
from experiments.sweep.results import comparable, off_by
from experiments.sweep.row import ANGLES, JACOBIANS, classified, verdict_columns


def results(outcome: Outcome[SweepRuns]) -> Results:
    """Everything that `fjh atlas` publishes."""
    if not isinstance(outcome, Complete):
        return replace(described(outcome), published=True)
    files = outcome.dataset.files()
    columns = Columns(files, verdict_columns(Columns(files)["struts"].tolist()))
    summary = summarize(outcome, columns)
    return replace(
        described(summary),
        pictures=[atlas_picture(columns, summary)],
        records=[lambda folder: outcome.dataset.merge(folder / summary["dataset"], _with_verdicts)],
    )


def described(summary: dict[str, Any]) -> Results:
    """Table, sentences and checks of the atlas, from `atlas.json` alone."""
    return Results(summary, [table(summary)], notes(summary), checks(summary))


def _with_verdicts(part: pa.Table) -> pa.Table:
    for name, values in verdict_columns(part["struts"].to_pylist()).items():
        part = part.append_column(name, pa.array(values))
    return part


def summarize(sweep: Complete[SweepRuns], columns: Columns) -> dict[str, Any]:
    """All numbers of the atlas, ready for JSON; the columns have the verdicts among them."""
    values = {factor.name: list(factor.values) for factor in sweep.campaign.runs.design.factors}
    compared = comparable(columns)
    return origin("atlas", sweep) | {
        "duration_s": sweep.campaign.runs.design.duration_s,
        "conditions": len(values["struts"]),
        "weights": values["weight"],
        "verdicts": _verdicts(columns, compared),
        **_disagreement(columns, compared),
        "closure_residual_max_m": float(columns["closure_residual_max_m"][compared].max()),
    }


def checks(summary: dict[str, Any]) -> list[Check]:
    """Checks: number of runs that contradict the classification, and closure residuals."""
    where, contradicted = "all conditions", summary["contradicted"]
    if contradicted:
        worst = contradicted[0]
        where = f"{worst['struts']} with {worst['weight']} and the {worst['jacobian']} Jacobian"
    number = Check("number of runs that contradict the classification", where, len(contradicted), 1)
    return [number, closure_check("all runs", summary["closure_residual_max_m"])]


def _verdicts(columns: Columns, compared: np.ndarray) -> list[dict[str, Any]]:
    """Prediction and simulation of each verdict with each Jacobian."""
    verdict, jacobian = columns["verdict"], columns["jacobian"]
    relative, _ = off_by(columns)
    rms = {
        f"{source}_{angle}_median_urad": columns[f"{prefix}{angle}_rms_urad"]
        for angle in ANGLES
        for source, prefix in (("predicted", "predicted_"), ("simulated", ""))
    }
    found = []
    for each, name in itertools.product(pointing_verdicts(classified()), JACOBIANS):
        chosen = (verdict == each.name) & (jacobian == name)
        off = relative[chosen & compared]
        entry = {
            "verdict": each.name,
            "label": each.label,
            "jacobian": name,
            "runs": int(chosen.sum()),
            **{key: _median(values[chosen]) for key, values in rms.items()},
            "compared": len(off),
            "largest_off_percent": 100 * float(off.max()) if len(off) else None,
        }
        found += [entry] if chosen.any() else []
    return found


def _median(values: np.ndarray) -> float | None:
    ended = values[np.isfinite(values)]
    return float(np.median(ended)) if len(ended) else None


def _disagreement(columns: Columns, compared: np.ndarray) -> dict[str, Any]:
    """Runs off their prediction: what theory explains, and what contradicts it.

    Explained is a condition that has lost pointing, simulated with the Jacobian of the estimated
    pose: its singularity is one of the nominal pose only. Beside it the mapping reaches the lost
    direction with a gain of 1e5, and what the integrators wound up there saturates the amplifiers.
    With the constant Jacobian the same condition must be as predicted, and so must all others.
    """
    _, allowed = off_by(columns)
    status, possible = columns["status"], columns["elastic_possible"].astype(bool)
    # Runs that did not end, or have no prediction, are off as well.
    off = ~(allowed < 1) | ~compared | ((status == "exact") != possible)
    lost = ~np.isin(columns["verdict"], KEPT)
    explained = lost & (columns["jacobian"] == "analytic")
    order = ascending(-np.nan_to_num(allowed, nan=np.inf))

    def listed(chosen: np.ndarray) -> list[dict[str, Any]]:
        return [_entry(columns, allowed, k) for k in order if chosen[k]]

    return {"explained": listed(off & explained), "contradicted": listed(off & ~explained)}


def _entry(columns: Columns, allowed: np.ndarray, k: int) -> dict[str, Any]:
    names = ("struts", "weight", "jacobian", "verdict", "status")
    numbers = [f"{source}{angle}_rms_urad" for angle in ANGLES for source in ("predicted_", "")]
    words = {"case": int(columns["case"][k])} | {name: columns[name][k] for name in names}
    values = {name: float(columns[name][k]) for name in numbers}
    values["off_over_allowed"] = float(allowed[k])
    return words | {name: value if np.isfinite(value) else None for name, value in values.items()}


def table(summary: dict[str, Any]) -> Table:
    """Predicted and simulated errors, one row for each verdict and Jacobian."""
    columns = (
        Column("", lambda each: each["verdict"].replace("_", " ")),
        Column("Jacobian", "jacobian"),
        Column("runs", "runs"),
        *(
            Column(heading.format(angle), f"{source}_{angle}_median_urad", ".3f")
            for angle in ANGLES
            for source, heading in (("predicted", "{}:\nmodel"), ("simulated", "simulated"))
        ),
        Column("off, %", "largest_off_percent", ".3f"),
    )
    labels = {each["verdict"].replace("_", " "): each["label"] for each in summary["verdicts"]}
    meaning = "; ".join(f"{verdict}: {label}" for verdict, label in labels.items())
    return tabulate(
        f"{summary['conditions']} failure conditions with {', '.join(summary['weights'])}, "
        f"{summary['duration_s']:g} s: RMS error, urad",
        columns,
        summary["verdicts"],
        f"{meaning}. Medians; model: the linear model; off: largest difference from it, over "
        "the runs without saturation of an amplifier, converter steps included.",
    )


def notes(summary: dict[str, Any]) -> list[str]:
    """Runs that differ from the linear model, and the rate."""
    off = summary["explained"]
    if not off:
        return rate(summary)
    conditions = sorted({each["struts"] for each in off})
    named = ", ".join(conditions[:6]) + (", ..." if len(conditions) > 6 else "")
    sentence = (
        f"{len(off)} runs in {len(conditions)} conditions without pointing differ from the linear "
        f"model, with the analytic Jacobian only ({named}): these conditions are singular at the "
        "nominal pose, and beside it the mapping reaches the lost direction with a gain of 1e5."
    )
    return [sentence, *rate(summary)]
