"""The released strut as numbers, checks, tables and files."""

from dataclasses import asdict, fields, replace
from functools import partial
from itertools import product
from typing import Any

import mujoco
import numpy as np

from experiments.recording.record import About, write_run
from experiments.release.figure import pictures
from experiments.release.runs import Release
from experiments.rig.hexapod.columns import hexapod_arrays
from experiments.rig.hexapod.metrics import (
    CLOSURE,
    PEAK,
    PREDICTED,
    RMS,
    each_angle,
    percent,
    plant_constants,
    recording_properties,
)
from experiments.rig.hexapod.rig import hexapod_rig
from experiments.rig.hexapod.testbed import TestbedConfig
from experiments.study.provenance import versions
from experiments.study.quantity import Quantity, checks_of, columns_of, entry_of
from experiments.study.results import Check, Results
from experiments.study.tables import Column, Table, tabulate
from prioritized import Classes, FailureAtlas
from sim import Array, load_model, model_sha256, weightless

MISMATCH_LIMIT_PERCENT = 1.0
"""Largest difference between simulated and predicted motion."""

ALPHA_PEAK, BETA_PEAK = each_angle(PEAK)
SPIRAL = (
    Quantity("name", lambda s: s.case.name, heading="", format=lambda name: name.replace("_", " ")),
    Quantity("kind", lambda s: s.case.kind),
    Quantity("failure_time_s", lambda s: s.case.time_s if s.case.kind else None),
    Quantity("told", lambda s: s.case.told),
    *each_angle(
        replace(RMS, heading="*", format=".3f"), replace(PREDICTED, heading="model", format=".3f")
    ),
    replace(ALPHA_PEAK, heading="peak", format=".1f"),
    BETA_PEAK,
    Quantity("sensitivity_peak", lambda s: s.sensitivity, heading="Ms", format=".2f"),
    Quantity(
        "motion_mismatch_linear_model_percent",
        lambda s: percent(s.twist - s.linear, s.twist),
        "difference between the simulated motion and the linear model [%]",
        below=lambda entry: MISMATCH_LIMIT_PERCENT if entry["kind"] else None,
    ),
    Quantity(
        "motion_mismatch_quasi_static_percent",
        lambda s: percent(s.twist - s.quasi_static, s.twist),
    ),
    Quantity("strut_1_peak_um", lambda s: 1e6 * float(np.abs(s.run.displacement[:, 0]).max())),
    CLOSURE,
    Quantity("recording", lambda s: f"{s.case.name}.rrd"),
    Quantity("data", lambda s: f"{s.case.name}.npz"),
)
"""What is said of each spiral."""

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
    run = release.spirals["sound"].run
    orbit = plant_constants(weightless(model))
    return {
        "experiment": "release",
        "seed": release.seed,
        "versions": versions(),
        "model_sha256": model_sha256(),
        "jacobian": "constant",
        "duration_s": len(run.time_s) * TestbedConfig().control_period_s,
        "bench": asdict(TestbedConfig()) | plant_constants(model),
        "spirals": [
            entry_of(SPIRAL, each) | {"plant": orbit if each.case.kind == "loose" else {}}
            for each in release.spirals.values()
        ],
        "sweep": release.sweep,
        "on_the_ground_without_spring": release.fall,
        "atlas": _atlas(release.atlas),
    }


def checks(summary: dict[str, Any]) -> list[Check]:
    """Checks: closure residuals, and motion, rest position and errors against the predictions."""
    off, found = MISMATCH_LIMIT_PERCENT, []
    for spiral in summary["spirals"]:
        found += checks_of(SPIRAL, summary | spiral, spiral["name"])
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
    return tabulate(
        "Strut 1 without coil force: RMS of desired minus true angle, urad",
        columns_of(SPIRAL),
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
    flown = release.spirals[name]
    what = "no failure"
    if kind is not None:
        when = spiral["failure_time_s"]
        lost = "coil" if kind == "free" else "coil and suspension spring"
        what = f"strut 1 loses its {lost}; {KNOWN[known]} (at {when:g} s)"
    orbit = " No gravity, no preload." if kind == "loose" else ""
    seed, duration_s = summary["seed"], summary["duration_s"]
    expected = spiral["predicted_alpha_rms_urad"], spiral["predicted_beta_rms_urad"]
    predicted = None if None in expected else [1e-6 * urad for urad in expected]
    about = About(
        study="release",
        identity=f"release-{name}-seed{seed}",
        title=name,
        said=[f"Seed {seed}, {duration_s:g} s, constant Jacobian, W_a; {what}.{orbit}"],
        parameters=recording_properties(summary) | spiral["plant"],
        compared={"linear model": expected},
        predicted=(predicted, predicted),
        checks=checks(summary),
    )
    further = {"linear": flown.linear, "quasi_static": flown.quasi_static}
    write_run(
        folder / f"{name}.rrd",
        hexapod_rig(),
        flown.run,
        about,
        arrays=hexapod_arrays(flown.run) | further,
        known="" if known is None else known.replace("_", " "),
    )
