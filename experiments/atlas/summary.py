"""The atlas as data: the contents of `atlas.json`."""

from pathlib import Path
from typing import Any

import numpy as np

from experiments.atlas.conditions import classified
from experiments.hexapod.checks import CLOSURE_LIMIT_M
from experiments.hexapod.failure_atlas import verdicts
from experiments.sweep.design import Design
from experiments.sweep.study import Ran
from experiments.sweep.summary import ANGLES, Columns, comparable, off_by, origin

LOST = ("drifts", "one_direction", "none")
"""Verdicts without pointing."""


def summarize(ran: Ran, design: Design, path: Path) -> dict[str, Any]:
    """All numbers that are told of the atlas, ready for JSON.

    Args:
        ran: All runs.
        design: Conditions, weights and Jacobians.
        path: Their rows, with the verdicts.
    """
    columns = Columns(path)
    values = {factor.name: list(factor.values) for factor in design.factors}
    return origin("atlas", ran, design, path) | {
        "conditions": len(values["struts"]),
        "weights": values["weight"],
        "verdicts": _verdicts(columns),
        **_disagreement(columns),
        "closure_residual_max_m": _opened_m(columns),
    }


def complaint(summary: dict[str, Any]) -> str | None:
    """One sentence on where physics contradicts theory; None when it does nowhere."""
    if summary["contradicted"]:
        worst = summary["contradicted"][0]
        return (
            f"{len(summary['contradicted'])} runs contradict the theory, {worst['struts']} with "
            f"{worst['weight']} and the {worst['jacobian']} Jacobian the most: "
            f"{worst['off_over_allowed']:.3g} times what is allowed"
        )
    if not (opened_m := summary["closure_residual_max_m"]) < CLOSURE_LIMIT_M:
        return f"a closed loop opened by {opened_m:.1e} m, more than {CLOSURE_LIMIT_M:.0e} m"
    return None


def lost(columns: Columns) -> np.ndarray:
    """Runs in conditions in which the library says that pointing is lost, springs or not."""
    return np.isin(columns["verdict"], LOST)


def _verdicts(columns: Columns) -> list[dict[str, Any]]:
    """Prediction and simulation of each verdict with each Jacobian."""
    verdict, jacobian, ran = columns["verdict"], columns["jacobian"], comparable(columns)
    relative, _ = off_by(columns)
    found = []
    for each in verdicts(classified()):
        for name in ("constant", "analytic"):
            chosen = (verdict == each.name) & (jacobian == name)
            if not chosen.any():
                continue
            compared = relative[chosen & ran]
            of_rms = {
                f"{source}_{angle}_median_urad": _median(
                    columns[f"{prefix}{angle}_rms_urad"], chosen
                )
                for angle in ANGLES
                for source, prefix in (("predicted", "predicted_"), ("simulated", ""))
            }
            found.append(
                {
                    "verdict": each.name,
                    "label": each.label,
                    "jacobian": name,
                    "runs": int(chosen.sum()),
                    **of_rms,
                    "compared": len(compared),
                    "largest_off_percent": 100 * float(compared.max()) if len(compared) else None,
                }
            )
    return found


def _median(values: np.ndarray, chosen: np.ndarray) -> float | None:
    ended = values[chosen & np.isfinite(values)]
    return float(np.median(ended)) if len(ended) else None


def _disagreement(columns: Columns) -> dict[str, Any]:
    """Runs off their prediction: what theory explains, and what contradicts it.

    Explained is a condition that has lost pointing, flown with the Jacobian of the estimated pose:
    its singularity is one of the nominal pose only. Beside it the mapping reaches the lost
    direction with a gain of 1e5, and what the integrators wound up there saturates the amplifiers.
    With the constant Jacobian the same condition must be as predicted, and so must all others.
    """
    _, allowed = off_by(columns)
    status, possible = columns["status"], columns["elastic_possible"].astype(bool)
    # Runs that did not end, or have no prediction, are off as well.
    off = ~(allowed < 1) | ~comparable(columns) | ((status == "exact") != possible)
    explained = lost(columns) & (columns["jacobian"] == "analytic")
    order = np.argsort(-np.nan_to_num(allowed, nan=np.inf), kind="stable")

    def listed(chosen: np.ndarray) -> list[dict[str, Any]]:
        return [_entry(columns, status, allowed, k) for k in order if chosen[k]]

    return {"explained": listed(off & explained), "contradicted": listed(off & ~explained)}


def _entry(columns: Columns, status: np.ndarray, allowed: np.ndarray, k: int) -> dict[str, Any]:
    names = ("case", "struts", "weight", "jacobian", "verdict")
    numbers = [f"{source}{angle}_rms_urad" for angle in ANGLES for source in ("predicted_", "")]
    told = {name: columns[name][k] for name in names} | {"status": status[k]}
    told["case"] = int(told["case"])
    values = {name: float(columns[name][k]) for name in numbers} | {
        "off_over_allowed": float(allowed[k])
    }
    return told | {name: value if np.isfinite(value) else None for name, value in values.items()}


def _opened_m(columns: Columns) -> float:
    return float(columns["closure_residual_max_m"][comparable(columns)].max())
