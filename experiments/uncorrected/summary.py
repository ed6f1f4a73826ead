"""The study as data: the contents of `uncorrected.json`."""

from dataclasses import asdict
from typing import Any

import numpy as np

from experiments.hexapod.metrics import closure_residual_max_m, finite_or_none, pointing_rms_urad
from experiments.hexapod.paper import TABLE_I_URAD
from experiments.hexapod.provenance import plant_constants
from experiments.hexapod.simulation import Trajectory
from experiments.hexapod.testbed import Bench
from experiments.output.provenance import versions
from experiments.uncorrected.answer import paragraph
from experiments.uncorrected.candidate import COLUMNS, STRUT, Candidate
from experiments.uncorrected.candidates import BENCH, CLOCKWISE, RETUNED
from experiments.uncorrected.lost_strut import fast_loop_ratio, remaining_gain
from experiments.uncorrected.maps import (
    PAPER_RATIOS,
    RATIO_TOLERANCE,
    beam_walk,
    limit_map,
    stability_map,
)
from experiments.uncorrected.study import Uncorrected
from sim import NOMINAL, Array, hexapod, load_model, model_sha256

CORRECTED_TOLERANCE = 0.25
"""How near W_d and W_e must stay to the paper's."""

RECORDED = (BENCH.name, "together", RETUNED.name, CLOCKWISE.name)
"""Candidates with a recording of the uncorrected column; all have its data."""


def summarize(study: Uncorrected) -> dict[str, Any]:
    """All numbers of the study, ready for JSON; units are in the names."""
    summary = {
        "experiment": "uncorrected",
        "seed": study.seed,
        "versions": versions(),
        "model_sha256": model_sha256(),
        "jacobian": "constant",
        "duration_s": study.duration_s,
        "bench": asdict(Bench()) | plant_constants(load_model()),
        "paper": {
            "alpha_ratio": PAPER_RATIOS[0],
            "beta_ratio": PAPER_RATIOS[1],
            "ratio_tolerance": RATIO_TOLERANCE,
            "corrected_tolerance": CORRECTED_TOLERANCE,
            "strut_1_alpha_over_beta": _strut_direction(),
            "fast_loop_ratio": fast_loop_ratio(remaining_gain(load_model())).tolist(),
            "columns_urad": {name: list(TABLE_I_URAD[name]) for name in COLUMNS},
        },
        "candidates": [_candidate(study, candidate) for candidate in study.candidates],
        "map": stability_map(study),
        "limit_map": limit_map(study),
        "beam_walk": beam_walk(study),
        "checked_points": [_point(point) for point in study.checked],
    }
    best = min(summary["candidates"], key=_distance)
    summary["best"] = best["name"]
    summary["explained_by"] = [one["name"] for one in summary["candidates"] if one["explains"]]
    return summary | {"paragraph": paragraph(summary)}


def _strut_direction() -> float:
    """How much more a millimetre of strut 1 moves alpha than beta."""
    column = np.linalg.inv(hexapod(load_model()).inverse_jacobian(NOMINAL))[:, STRUT]
    return float(column[0] / column[1])


def _distance(candidate: dict[str, Any]) -> float:
    distance = candidate["ratio_distance"]
    return np.inf if distance is None else distance


def _candidate(study: Uncorrected, candidate: Candidate) -> dict[str, Any]:
    runs, predicted = study.runs[candidate.name], study.predicted[candidate.name]
    columns = [_column(study, candidate, name) for name in COLUMNS]
    rms = {column["name"]: column["rms_urad"] for column in columns}
    ratio = _ratio(rms["W_a_uncorrected"], rms["W_a"])
    distance = None if ratio is None else float(np.abs(ratio / PAPER_RATIOS - 1).max())
    verdict = {
        "meets_ratios": distance is not None and distance < RATIO_TOLERANCE,
        "meets_w_a": _near(rms, ["W_a"], RATIO_TOLERANCE),
        "meets_corrected": _near(rms, ["W_d", "W_e"], CORRECTED_TOLERANCE),
    }
    foretold = _ratio(predicted.rms_urad["W_a_uncorrected"], predicted.rms_urad["W_a"])
    settled = predicted.settled_urad
    recorded = isinstance(runs["W_a_uncorrected"], Trajectory) and candidate.name in RECORDED
    return {
        "name": candidate.name,
        "what": candidate.what,
        "differs": candidate.differs(),
        "numbers_changed": candidate.freedom[0],
        "choices_changed": candidate.freedom[1],
        "loops": [str(loop) for loop in predicted.loops],
        "gain_margin_db": [finite_or_none(loop.gain_margin_db) for loop in predicted.loops],
        "columns": columns,
        "ratio": _listed(ratio),
        "predicted_ratio": _listed(foretold),
        "ratio_distance": distance,
        **verdict,
        "explains": all(verdict.values()),
        "settled_corrected_urad": {k: _listed(v) for k, v in settled.items()},
        "explains_if_corrected_settled": verdict["meets_ratios"]
        and verdict["meets_w_a"]
        and _near(settled, ["W_d", "W_e"], CORRECTED_TOLERANCE),
        "signature": _signature(candidate, runs["W_a_uncorrected"]),
        "data": f"{candidate.name}.npz",
        "recording": f"{candidate.name}.rrd" if recorded else None,
    }


def _column(study: Uncorrected, candidate: Candidate, name: str) -> dict[str, Any]:
    run, predicted = study.runs[candidate.name].get(name), study.predicted[candidate.name]
    ended = run if isinstance(run, Trajectory) else None
    simulated = None if ended is None else pointing_rms_urad(ended).tolist()
    foretold = _listed(predicted.rms_urad[name])
    return {
        "name": name,
        "rms_urad": foretold if run is None else simulated,
        "simulated_urad": simulated,
        "predicted_urad": foretold,
        "sensitivity_peak": predicted.sensitivity[name],
        "strut_input_peak_percent": None
        if ended is None
        else float(np.abs(ended.strut_input_percent).max()),
        "closure_residual_max_m": None if ended is None else closure_residual_max_m(ended),
        "diverged_at_s": run if isinstance(run, float) else None,
    }


def _signature(candidate: Candidate, run: Trajectory | float) -> dict[str, Any] | None:
    """What Fig. 5 would show: how far the outer turns reach, and when the error arises."""
    if not isinstance(run, Trajectory):
        return None
    squared = np.square(run.desired_rad - run.true_rad).sum(axis=1)
    outer = run.time_s >= 0.75 * run.time_s[-1]
    reach = np.abs(run.true_rad[outer]).max(axis=0) / np.abs(run.desired_rad[outer]).max(axis=0)
    return {
        "outer_reach_percent": (100 * reach).tolist(),
        "largest_error_first_turn_urad": 1e6
        * float(np.sqrt(squared[run.time_s < Bench().spiral_period_s].max())),
        "error_share_last_quarter": float(squared[outer].sum() / squared.sum()),
    }


def _point(point: dict[str, Any]) -> dict[str, Any]:
    return point | {key: _listed(point[key]) for key in ("predicted_urad", "simulated_urad")}


def _near(rms: dict[str, Any], names: list[str], tolerance: float) -> bool:
    return all(
        rms[name] is not None
        and bool(np.all(np.abs(np.divide(rms[name], TABLE_I_URAD[name]) - 1) < tolerance))
        for name in names
    )


def _ratio(over: Any, under: Any) -> Array | None:
    return None if over is None or under is None else np.divide(over, under)


def _listed(values: Array | None) -> list[float] | None:
    return None if values is None else values.tolist()
