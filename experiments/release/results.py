"""The released strut as numbers, checks, tables and files."""

from dataclasses import asdict, fields
from functools import partial
from itertools import product
from typing import Any

import mujoco
import numpy as np

from experiments.recording.hexapod import Mark
from experiments.recording.keep import record_run
from experiments.recording.shown import Shown
from experiments.release.figure import pictures
from experiments.release.runs import Case, Release, twist
from experiments.rig.hexapod.metrics import (
    closure_check,
    percent,
    plant_constants,
    pointing_rms_urad,
    prediction_checks,
    prediction_tolerance,
    recording_properties,
)
from experiments.rig.hexapod.testbed import TestbedConfig
from experiments.study.provenance import versions
from experiments.study.results import Check, Results
from experiments.study.tables import Column, Table, tabulate
from prioritized import Classes, FailureAtlas
from sim import Array, load_model, model_sha256, weightless

MISMATCH_LIMIT_PERCENT = 1.0
"""Largest difference between simulated and predicted motion."""

KNOWN = {
    "uncorrected": "failure unknown to the mapping",
    "corrected": "failure known, mapped by the springs' statics",
    "as_locked": "failure known, mapped as a locked strut",
}


def results(release: Release) -> Results:
    """Everything that `fjh release` publishes."""
    summary = summarize(release)
    return Results(
        summary,
        tables=(spirals(summary), sweep(summary)),
        checks=checks(summary),
        pictures=pictures(release, summary),
        arrays={"atlas.npz": _atlas_arrays(release.atlas)},
        records=[partial(_record, release, summary, spiral) for spiral in summary["spirals"]],
    )


def summarize(release: Release) -> dict[str, Any]:
    """All numbers of the experiment, ready for JSON; units are in the names."""
    model: mujoco.MjModel = load_model()
    run = release.trajectories["sound"]
    orbit = plant_constants(weightless(model))
    return {
        "experiment": "release",
        "seed": release.seed,
        "versions": versions(),
        "model_sha256": model_sha256(),
        "jacobian": "constant",
        "duration_s": len(run.time_s) * TestbedConfig().control_period_s,
        "bench": asdict(TestbedConfig()) | plant_constants(model),
        "spirals": [_spiral(release, case, orbit) for case in release.cases],
        "sweep": release.sweep,
        "on_the_ground_without_spring": release.fall,
        "atlas": _atlas(release.atlas),
    }


def checks(summary: dict[str, Any]) -> list[Check]:
    """Checks: closure residuals, and motion, rest position and errors against the predictions."""
    tolerance, off = prediction_tolerance(summary["duration_s"]), MISMATCH_LIMIT_PERCENT
    found = []
    for spiral in summary["spirals"]:
        found.append(closure_check(spiral["name"], spiral["closure_residual_max_m"]))
        if spiral["kind"]:
            mismatch = spiral["motion_mismatch_linear_model_percent"]
            what = "difference between the simulated motion and the linear model [%]"
            found.append(Check(what, spiral["name"], mismatch, off))
        found += prediction_checks(spiral, tolerance)
    for point in summary["sweep"]:
        where = f"stiffness ratio {point['suspension_over_swing']:g}"
        for model in ("elastic", "linear_model"):
            what = f"difference between the {model.replace('_', ' ')} and the simulation [%]"
            found.append(Check(what, where, point[f"mismatch_{model}_percent"], off))
        error = abs(point["alpha_corrected_urad"] - 100)
        found.append(Check("pointing error of the corrected mapping [%]", where, error, off))
    fall = summary["on_the_ground_without_spring"]
    error = 100 * abs(fall["strut_1_um"] / fall["stop_um"] - 1)
    found.append(Check("distance of strut 1 from its stop [%]", "without its spring", error, off))
    return found


def spirals(summary: dict[str, Any]) -> Table:
    """One row for each spiral."""
    columns = (
        Column("", lambda spiral: spiral["name"].replace("_", " ")),
        Column("alpha", "alpha_rms_urad", ".3f"),
        Column("model", "predicted_alpha_rms_urad", ".3f"),
        Column("beta", "beta_rms_urad", ".3f"),
        Column("model", "predicted_beta_rms_urad", ".3f"),
        Column("peak", "alpha_peak_urad", ".1f"),
        Column("Ms", "sensitivity_peak", ".2f"),
    )
    return tabulate(
        "Strut 1 without coil force: RMS of desired minus true angle, urad",
        columns,
        summary["spirals"],
        "free: without coil force; loose: without coil force and spring, no gravity. model: RMS of "
        "the linear model. peak: of the alpha error, urad. Ms: peak sensitivity of the loops.",
    )


def sweep(summary: dict[str, Any]) -> Table:
    """One row for each stiffness."""
    reached = {"simulated": "simulated", "elastic": "elastic"}
    reached |= {"as locked": "as_if_locked", "corrected": "corrected"}
    columns = [Column("stiffness", "suspension_over_swing", ".0e")]
    columns += [Column(what, f"alpha_{key}_urad", ".2f") for what, key in reached.items()]
    return tabulate(
        "Alpha reached at rest for a command of 100 urad, urad",
        columns,
        summary["sweep"],
        "stiffness: of the suspension, relative to that against the strut's swing. Failure unknown "
        "to the mapping: simulated, predicted by the elastic mapping (elastic), and predicted for "
        "a strut locked at its centre (as locked). corrected: simulated, failure known.",
    )


def _spiral(release: Release, case: Case, orbit: dict[str, Any]) -> dict[str, Any]:
    run, name = release.trajectories[case.name], case.name
    alpha, beta = pointing_rms_urad(run)
    alpha_peak, beta_peak = 1e6 * np.abs(run.desired_rad - run.true_rad).max(axis=0)
    predicted, true = release.predicted_rad.get(name), twist(run)
    return {
        "name": name,
        "kind": case.kind,
        "failure_time_s": case.time_s if case.kind else None,
        "told": case.told,
        "plant": orbit if case.kind == "loose" else {},
        "alpha_rms_urad": alpha,
        "beta_rms_urad": beta,
        "predicted_alpha_rms_urad": None if predicted is None else 1e6 * predicted[0],
        "predicted_beta_rms_urad": None if predicted is None else 1e6 * predicted[1],
        "alpha_peak_urad": alpha_peak,
        "beta_peak_urad": beta_peak,
        "sensitivity_peak": release.sensitivity[name],
        "motion_mismatch_linear_model_percent": percent(true - release.linear[name], true),
        "motion_mismatch_quasi_static_percent": percent(true - release.quasi_static[name], true),
        "strut_1_peak_um": 1e6 * float(np.abs(run.strut_displacement_m[:, 0]).max()),
        "closure_residual_max_m": float(run.closure_residual_m.max()),
        "recording": f"{name}.rrd",
        "data": f"{name}.npz",
    }


def _atlas(atlas: FailureAtlas) -> dict[str, Any]:
    assert atlas.elastic is not None  # the hexapod has springs
    elastic, singles = atlas.elastic, []
    for strut, kind in product(range(6), ("locked", "free")):
        row = atlas.row(**{kind: [strut]})
        verdicts = {"rigid": _verdict(atlas, row), "elastic": _verdict(elastic, row)}
        singles.append({"strut": strut + 1, "kind": kind, **verdicts})
    return {
        "conditions": len(atlas.codes),
        "possible_rigid": int(atlas.possible.sum()),
        "possible_elastic": int(elastic.possible.sum()),
        "smallest_gap": float(min(atlas.gap.min(), elastic.gap.min())),
        "single_failures": singles,
    }


def _verdict(classes: Classes, row: int) -> dict[str, Any]:
    lost = classes.lost_secondary[row]
    return {
        "possible": bool(classes.possible[row]),
        "worst_gain_rad_per_m": float(classes.worst_gain[row]),
        "unstable_major": bool(classes.unstable_major[row]),
        "lost_gamma_t_x_t_y_t_z": (lost[:, lost.any(axis=0)].T + 0.0).tolist(),
    }


def _atlas_arrays(atlas: FailureAtlas) -> dict[str, Array]:
    """Rigid and elastic verdicts in one file; rows are conditions."""
    assert atlas.elastic is not None  # the hexapod has springs
    both = product((("rigid", atlas), ("elastic", atlas.elastic)), fields(Classes))
    verdicts = {f"{which}_{f.name}": getattr(classes, f.name) for (which, classes), f in both}
    # Without limits nothing is said of what they cost.
    return {"codes": atlas.codes} | {name: A for name, A in verdicts.items() if A is not None}


def _record(release: Release, summary: dict[str, Any], spiral: dict[str, Any], folder: Any) -> None:
    name, kind, known = spiral["name"], spiral["kind"], spiral["told"]
    marks, what = [], "no failure"
    if kind is not None:
        when = spiral["failure_time_s"]
        marks = [Mark(0, when, f"strut 1 {kind}, {known.replace('_', ' ')}")]
        lost = "coil" if kind == "free" else "coil and suspension spring"
        what = f"strut 1 loses its {lost}; {KNOWN[known]} (at {when:g} s)"
    orbit = " No gravity, no preload." if kind == "loose" else ""
    seed, duration_s = summary["seed"], summary["duration_s"]
    predicted = spiral["predicted_alpha_rms_urad"], spiral["predicted_beta_rms_urad"]
    record_run(
        folder,
        name,
        f"release-{name}-seed{seed}",
        load_model(),
        Shown(release.trajectories[name], marks),
        said=[f"Seed {seed}, {duration_s:g} s, constant Jacobian, W_a; {what}.{orbit}"],
        beside={"linear model": predicted},
        properties=recording_properties(summary) | spiral["plant"],
        further={"linear": release.linear[name], "quasi_static": release.quasi_static[name]},
    )
