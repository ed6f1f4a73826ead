"""A sweep as data: the contents of `sweep.json`, from the columns of its dataset, one at a time."""

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import spearmanr

from experiments.hexapod.checks import CLOSURE_LIMIT_M
from experiments.output.provenance import versions
from experiments.sweep import parquet
from experiments.sweep.design import Design
from experiments.sweep.factors import Range
from experiments.sweep.run import INPUT_PEAK
from experiments.sweep.study import Ran
from sim import Array, model_sha256

ANGLES = ("alpha", "beta")

PREDICTION_TOLERANCE = 0.01
"""Largest relative distance of an RMS from the linear model's under the same noise, beside one step
of the converters. Of 40 runs of varied weights, failures, loops, noise and converters the furthest
used 44 % of both."""


class Columns:
    """Columns of a Parquet file, read when they are asked for; numbers that are missing are NaN."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __getitem__(self, name: str) -> np.ndarray:
        return parquet.read(self.path, [name])[name].to_numpy()


def origin(experiment: str, ran: Ran, design: Design, path: Path) -> dict[str, Any]:
    """What a summary begins with: where its numbers are from; arguments as in `summarize`."""
    return {
        "experiment": experiment,
        "seed": ran.basis["seed"],
        "versions": versions(),
        "model_sha256": model_sha256(),
        "basis": ran.basis,
        "dataset": path.name,
        "runs": design.runs,
        "duration_s": design.duration_s,
        "took": ran.took,
    }


def summarize(ran: Ran, design: Design, path: Path) -> dict[str, Any]:
    """All numbers that are told of a sweep, ready for JSON.

    Args:
        ran: The sweep.
        design: What it varied.
        path: Its rows.
    """
    columns = Columns(path)
    return origin("sweep", ran, design, path) | {
        "status": dict(sorted(Counter(columns["status"].tolist()).items())),
        "groups": _groups(columns, design.duration_s),
        "prediction": prediction(columns),
        "influence": _influence(columns, design),
    }


def complaint(summary: dict[str, Any]) -> str | None:
    """One sentence on what makes a sweep unsound; None when nothing does."""
    found = summary["prediction"]
    if found["off"]:
        return (
            f"{found['off']} of {found['compared']} runs are off the linear model by more than "
            f"{100 * PREDICTION_TOLERANCE:g} % and a step of the converters, case "
            f"{found['worst_case']} the most"
        )
    opened_m = found["closure_residual_max_m"]
    if opened_m is not None and not opened_m < CLOSURE_LIMIT_M:
        return f"a closed loop opened by {opened_m:.1e} m, more than {CLOSURE_LIMIT_M:.0e} m"
    return None


def comparable(columns: Columns) -> np.ndarray:
    """Runs that the linear model is a model of: foretold, ended, amplifiers not saturated."""
    peaks = np.max([columns[name] for name in INPUT_PEAK], axis=0)
    return np.isfinite(columns["predicted_alpha_rms_urad"]) & (peaks < 99.9)


def off_by(columns: Columns) -> tuple[Array, Array]:
    """Largest distance of each run from the linear model, over both angles, shape (runs,).

    Returns:
        In parts of the predicted RMS; and over what is allowed, one and more being too much.
    """
    relative, allowed = [], []
    for angle in ANGLES:
        predicted = columns[f"predicted_{angle}_rms_urad"]
        off = np.abs(columns[f"{angle}_rms_urad"] - predicted)
        relative.append(off / predicted)
        allowed.append(off / (PREDICTION_TOLERANCE * predicted + columns["dac_step_urad"]))
    return np.max(relative, axis=0), np.max(allowed, axis=0)


def prediction(columns: Columns) -> dict[str, Any]:
    """Simulation and linear model side by side, where they can be."""
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
        "worst_case": int(columns["case"][compared][allowed.argmax()]),
        "closure_residual_max_m": float(columns["closure_residual_max_m"][compared].max()),
    }


def _groups(columns: Columns, duration_s: float) -> list[dict[str, Any]]:
    """Runs by how many struts fail while they last, and whether the mapping is told."""
    failing = np.array([sum(letter != "S" for letter in struts) for struts in columns["struts"]])
    failing[columns["failure_time_s"] >= duration_s] = 0
    known = columns["known"].astype(bool)
    groups = []
    for count in np.unique(failing).tolist():
        for told in (True, False) if count else (None,):
            chosen = (failing == count) & (True if told is None else known == told)
            if chosen.any():
                group = {"failures": count, "told": told, "runs": int(chosen.sum())}
                groups.append(group | _spread(columns, chosen))
    return groups


def _spread(columns: Columns, chosen: np.ndarray) -> dict[str, Any]:
    """Median and 95th percentile of the RMS errors of the runs that came to their end."""
    found = {}
    for angle in ANGLES:
        values = columns[f"{angle}_rms_urad"][chosen]
        values = values[np.isfinite(values)]
        quantiles = np.quantile(values, (0.5, 0.95)).tolist() if len(values) else (None, None)
        found |= dict(
            zip((f"{angle}_median_urad", f"{angle}_percentile_95_urad"), quantiles, strict=True)
        )
    return found


def _influence(columns: Columns, design: Design) -> dict[str, dict[str, float]]:
    """Rank correlation of each range with the RMS errors, by its name; the strongest first."""
    varied = [each.name for each in design.factors if isinstance(each, Range)]
    rms = {angle: columns[f"{angle}_rms_urad"] for angle in ANGLES}
    ended = np.isfinite(rms["alpha"])
    if np.count_nonzero(ended) < 3:
        return {}
    found = {}
    for name in varied:
        values = columns[name][ended]
        if np.ptp(values) > 0:
            found[name] = {
                angle: float(spearmanr(values, rms[angle][ended]).statistic) for angle in ANGLES
            }
    return dict(sorted(found.items(), key=lambda item: -max(map(abs, item[1].values()))))
