"""The goals as data: the contents of `goals.json`, and whether to believe it."""

from dataclasses import asdict
from typing import Any

import numpy as np

from experiments.goals.arm import ARM_MJCF
from experiments.goals.demonstration import REFERENCE, Demonstration, Outcome, Way, ways
from experiments.goals.study import DEMONSTRATIONS, Outcomes
from experiments.hexapod.checks import CLOSURE_LIMIT_M
from experiments.hexapod.metrics import rms
from experiments.hexapod.provenance import plant_constants
from experiments.hexapod.testbed import Bench
from experiments.output.provenance import versions
from sim import load_model, model_sha256

CHANGES = {
    "rms_change_urad": "the RMS of the pointing error changes",
    "peak_change_urad": "its peak changes",
    "difference_rms_urad": "the pointing changes, tick by tick in RMS,",
    "difference_peak_urad": "the pointing changes, at one tick,",
}
"""What another seed does to the two angles, and what a goal must stay below."""


def summarize(outcomes: Outcomes, seed: int, quick: bool) -> dict[str, Any]:
    """All numbers of the experiment, ready for JSON; units are in the names."""
    return {
        "experiment": "goals",
        "seed": seed,
        "versions": versions(),
        "model_sha256": {"fjh": model_sha256(), "arm": model_sha256(ARM_MJCF)},
        "jacobian": "constant",
        "bench": asdict(Bench()) | plant_constants(load_model()),
        "goals": [_entry(one, outcomes[one.name], ways(seed, quick)) for one in DEMONSTRATIONS],
    }


def complaint(summary: dict[str, Any]) -> str | None:
    """One sentence on what makes the experiment unsound; None when nothing does."""
    for goal in summary["goals"]:
        runs = {run["name"]: run for run in goal["runs"]}
        for name, run in runs.items():
            if not run["closure_residual_max_m"] < CLOSURE_LIMIT_M:
                gap_m = run["closure_residual_max_m"]
                return f"{goal['name']}, {name}: a loop opened by {gap_m:.1e} m"
        pursued, measure = runs["pursued"], goal["measure"]
        if not pursued["kept"]:
            return f"{goal['name']}: pursued, {measure} reaches {pursued[measure]:.4g}"
        if runs["nothing"]["kept"]:
            return f"{goal['name']}: nothing was at stake, {measure} keeps clear by itself"
        for key, words in CHANGES.items():
            change, noise = max(map(abs, pursued[key])), goal["another_seed"][key]
            if not change < noise:
                return (
                    f"{goal['name']}: {words} by {change:.3g} urad, another seed does {noise:.3g}"
                )
    return None


def _entry(
    one: Demonstration, outcomes: dict[str, Outcome], ran: tuple[Way, ...]
) -> dict[str, Any]:
    reference = outcomes[REFERENCE]
    runs = [_run(one, way, outcomes[way.name], reference) for way in ran]
    return {
        "name": one.name,
        "title": one.title,
        "machine": one.machine,
        "measure": one.measure,
        "limit": one.limit,
        "keeps_below": one.keeps_below,
        "angles": one.angles,
        "judged_from_s": one.judged_from_s,
        "settings": one.settings,
        "another_seed": _another_seed([run for run in runs if not run["limited"]]),
        "runs": runs,
        "recording": f"{one.name}.rrd",
        "data": f"{one.name}.npz",
    }


def _run(one: Demonstration, way: Way, outcome: Outcome, reference: Outcome) -> dict[str, Any]:
    worst = one.worst(outcome)
    judged = outcome.time_s >= one.judged_from_s
    error_urad, expected_urad = (1e6 * run.error_rad[judged] for run in (outcome, reference))
    difference_urad = 1e6 * (outcome.error_rad - reference.error_rad)
    peak, expected_peak = (np.abs(error).max(axis=0) for error in (error_urad, expected_urad))
    return {
        **asdict(way),
        one.measure: worst,
        "kept": one.is_kept(worst),
        "rms_urad": rms(error_urad).tolist(),
        "peak_urad": peak.tolist(),
        "rms_change_urad": (rms(error_urad) - rms(expected_urad)).tolist(),
        "peak_change_urad": (peak - expected_peak).tolist(),
        "difference_rms_urad": rms(difference_urad).tolist(),
        "difference_peak_urad": np.abs(difference_urad).max(axis=0).tolist(),
        "closure_residual_max_m": outcome.closure_residual_max_m,
    }


def _another_seed(references: list[dict[str, Any]]) -> dict[str, float]:
    """What the seed alone changes, the most in either angle: between any two, and to the first."""

    def spread(key: str) -> float:
        return float(np.ptp([run[key] for run in references], axis=0).max())

    return {
        "rms_change_urad": spread("rms_urad"),
        "peak_change_urad": spread("peak_urad"),
        **{
            key: float(np.max([run[key] for run in references]))
            for key in ("difference_rms_urad", "difference_peak_urad")
        },
    }
