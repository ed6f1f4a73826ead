"""The study of the last column as numbers, checks and files."""

from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from argument_checks.ties import least
from experiments.recording.record import About, write_run
from experiments.rig.checks import closure_check
from experiments.rig.hexapod.columns import hexapod_arrays
from experiments.rig.hexapod.metrics import (
    finite_or_none,
    is_cut,
    plant_constants,
    recording_properties,
)
from experiments.rig.hexapod.paper import TABLE_I_URAD
from experiments.rig.hexapod.rig import hexapod_rig
from experiments.rig.hexapod.testbed import TestbedConfig
from experiments.rig.run import Run
from experiments.study.provenance import versions
from experiments.study.results import Check, Results
from experiments.uncorrected.answer import paragraph, table
from experiments.uncorrected.candidates import (
    BENCH,
    CLOCKWISE,
    COLUMNS,
    CORRECTED_TOLERANCE,
    PAPER_RATIOS,
    RATIO_TOLERANCE,
    RETUNED,
    Candidate,
)
from experiments.uncorrected.figure import pictures
from experiments.uncorrected.predicted import (
    beam_walk,
    fast_loop_ratio,
    remaining_gain,
    strut_direction,
)
from experiments.uncorrected.runs import Uncorrected
from experiments.uncorrected.stability_map import map_arrays, map_numbers
from sim import Array, load_model, model_sha256

PREDICTION_TOLERANCE = 0.03
"""Largest relative distance of an RMS from the linear model's, under the same noise.

Measured: 2.3 % on a floor near resonance, where the physics step shows; 0.7 % everywhere else.
"""

RECORDED = (BENCH.name, "together", RETUNED.name, CLOCKWISE.name)
"""Candidates with a recording of the uncorrected column; all have its data."""


def results(study: Uncorrected) -> Results:
    """Everything that `fjh uncorrected` publishes."""
    summary = summarize(study)
    arrays = {"map.npz": map_arrays(study.grid, study.map_rad, study.map_poles)}
    records = []
    for candidate in summary["candidates"]:
        run = study.runs[candidate["name"]]["W_a_uncorrected"]
        if not isinstance(run, Run):
            continue
        if candidate["recording"]:
            records.append(partial(_record, summary, candidate, run))
        else:
            arrays[candidate["data"]] = hexapod_arrays(run)
    return Results(
        summary,
        tables=(table(summary),),
        notes=(summary["paragraph"],),
        checks=checks(summary),
        pictures=pictures(study, summary),
        arrays=arrays,
        records=records,
    )


def summarize(study: Uncorrected) -> dict[str, Any]:
    """All numbers of the study, ready for JSON; units are in the names."""
    model = load_model()
    summary = {
        "experiment": "uncorrected",
        "seed": study.seed,
        "versions": versions(),
        "model_sha256": model_sha256(),
        "jacobian": "constant",
        "duration_s": study.duration_s,
        "bench": asdict(TestbedConfig()) | plant_constants(model),
        "paper": {
            "alpha_ratio": PAPER_RATIOS[0],
            "beta_ratio": PAPER_RATIOS[1],
            "ratio_tolerance": RATIO_TOLERANCE,
            "corrected_tolerance": CORRECTED_TOLERANCE,
            "strut_1_alpha_over_beta": strut_direction(model),
            "fast_loop_ratio": fast_loop_ratio(remaining_gain(model)).tolist(),
            "columns_urad": {name: list(TABLE_I_URAD[name]) for name in COLUMNS},
        },
        "candidates": [_candidate(study, candidate) for candidate in study.candidates],
        "map": map_numbers(study.grid, study.map_rad, study.map_poles),
        "beam_walk": beam_walk(study.offset_m, study.beam_walk_urad),
        "checked_points": study.checked,
    }
    compared = [one for one in summary["candidates"] if one["ratio_distance"] is not None]
    summary["best"] = compared[least([one["ratio_distance"] for one in compared])]["name"]
    summary["explained_by"] = [one["name"] for one in summary["candidates"] if one["explains"]]
    return summary | {"paragraph": paragraph(summary)}


def checks(summary: dict[str, Any]) -> list[Check]:
    """Checks: closure residuals of stable loops, and RMS errors against the linear model."""
    found = []
    for candidate in summary["candidates"]:
        for column in candidate["columns"]:
            where = f"{column['name']} of {candidate['name']}"
            gap = column["closure_residual_max_m"]
            if column["sensitivity_peak"] is not None and gap is not None:
                found.append(closure_check(where, gap))
            found += _prediction_check(where, column)
    for point in summary["checked_points"]:
        at = f"{point['damping_ratio']:g}, {point['alpha_crossover_hz']:g} Hz"
        found += _prediction_check(f"{point['name']} at {at} of the map", point)
    return found


def _prediction_check(where: str, run: dict[str, Any]) -> list[Check]:
    """Check of a run that is stable in the linear model; empty for others."""
    simulated, predicted = run["simulated_urad"], run["predicted_urad"]
    if predicted is not None and run.get("diverged_at_s") is not None:
        return [Check("divergence of a run that is stable in the linear model", where, 1, 0.5)]
    if predicted is None or simulated is None:
        return []
    off = float(np.abs(np.divide(simulated, predicted) - 1).max())
    what = "relative difference between the RMS errors and the linear model's"
    return [Check(what, where, off, PREDICTION_TOLERANCE)]


def _candidate(study: Uncorrected, candidate: Candidate) -> dict[str, Any]:
    runs, predicted = study.runs[candidate.name], study.predicted[candidate.name]
    columns = [_column(study, candidate, name) for name in COLUMNS]
    rms = {column["name"]: column["rms_urad"] for column in columns}
    ratio, settled = _ratio(rms), predicted.settled_urad
    distance = None if ratio is None else float(np.abs(ratio / PAPER_RATIOS - 1).max())
    ratios = distance is not None and distance < RATIO_TOLERANCE
    w_a = _near(rms, ["W_a"], RATIO_TOLERANCE)
    corrected, if_settled = (
        _near(each, ["W_d", "W_e"], CORRECTED_TOLERANCE) for each in (rms, settled)
    )
    recorded = isinstance(runs["W_a_uncorrected"], Run) and candidate.name in RECORDED
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
        "predicted_ratio": _listed(_ratio(predicted.rms_urad)),
        "ratio_distance": distance,
        "meets_ratios": ratios,
        "meets_w_a": w_a,
        "meets_corrected": corrected,
        "explains": ratios and w_a and corrected,
        "settled_corrected_urad": {name: _listed(urad) for name, urad in settled.items()},
        "explains_if_corrected_settled": ratios and w_a and if_settled,
        "signature": _signature(runs["W_a_uncorrected"]),
        "data": f"{candidate.name}.npz",
        "recording": f"{candidate.name}.rrd" if recorded else None,
    }


def _column(study: Uncorrected, candidate: Candidate, name: str) -> dict[str, Any]:
    run, of_model = study.runs[candidate.name].get(name), study.predicted[candidate.name]
    ended = run if isinstance(run, Run) else None
    predicted = _listed(of_model.rms_urad[name])
    simulated = ended and (1e6 * ended.rms()).tolist()
    return {
        "name": name,
        "rms_urad": predicted if run is None else simulated,
        "simulated_urad": simulated,
        "predicted_urad": predicted,
        "sensitivity_peak": of_model.sensitivity[name],
        "strut_input_peak_percent": ended and float(np.abs(ended.inputs).max()),
        "closure_residual_max_m": ended and ended.closure_max_m,
        "diverged_at_s": run if isinstance(run, float) else None,
    }


def _signature(run: Run | float) -> dict[str, Any] | None:
    """What Fig. 5 would show: how far the outer turns reach, and when the error arises."""
    if not isinstance(run, Run):
        return None
    squared = np.square(run.error).sum(axis=1)
    outer = run.time_s >= 0.75 * run.time_s[-1]
    reach = np.abs(run.true[outer]).max(axis=0) / np.abs(run.desired[outer]).max(axis=0)
    first_turn = squared[run.time_s < TestbedConfig().spiral_period_s]
    return {
        "outer_reach_percent": (100 * reach).tolist(),
        "largest_error_first_turn_urad": 1e6 * float(np.sqrt(first_turn.max())),
        "error_share_last_quarter": float(squared[outer].sum() / squared.sum()),
    }


def _near(rms: dict[str, Any], names: list[str], tolerance: float) -> bool:
    """Whether all of these columns exist and are within the tolerance of the paper's."""
    return all(
        rms[name] is not None
        and bool(np.all(np.abs(np.divide(rms[name], TABLE_I_URAD[name]) - 1) < tolerance))
        for name in names
    )


def _ratio(rms: dict[str, Any]) -> Array | None:
    """RMS errors of the uncorrected column over those of W_a; None where there are none."""
    sound, uncorrected = rms["W_a"], rms["W_a_uncorrected"]
    return None if sound is None or uncorrected is None else np.divide(uncorrected, sound)


def _listed(values: Array | None) -> list[float] | None:
    return None if values is None else values.tolist()


def _record(summary: dict[str, Any], candidate: dict[str, Any], run: Run, folder: Path) -> None:
    """Write the data and the recording of a candidate's uncorrected column."""
    name, ratio, seed = candidate["name"], candidate["ratio"], summary["seed"]
    said = [f"Strut 1 locked, W_a uncorrected: {candidate['what']}.", ""]
    said.append(f"Seed {seed}, {summary['duration_s']:g} s, constant Jacobian.")
    if ratio:
        said.append(f"RMS over W_a's: alpha {ratio[0]:.3f}, beta {ratio[1]:.3f}.")
    compared = {}
    if not is_cut(summary):
        said.append(f"The paper's: {', '.join(f'{each:.2f}' for each in PAPER_RATIOS)}.")
        compared["paper"] = TABLE_I_URAD["W_a_uncorrected"]
    differs = {f"candidate_{key}": value for key, value in candidate["differs"].items()}
    about = About(
        study="uncorrected",
        identity=f"uncorrected-{name}-seed{seed}",
        title=name,
        said=said,
        parameters=recording_properties(summary) | differs,
        compared=compared,
        checks=checks(summary),
    )
    write_run(
        folder / f"{name}.rrd",
        hexapod_rig(),
        run,
        about,
        arrays=hexapod_arrays(run),
        known="not known to the mapping",
    )
