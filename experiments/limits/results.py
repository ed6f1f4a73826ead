"""Limits in the loop as numbers, checks and files."""

from dataclasses import asdict
from typing import Any

from experiments.limits import arm, runs
from experiments.limits.allocation import UNLIMITED
from experiments.limits.figure import pictures
from experiments.limits.measures import (
    arm_entry,
    condition_entry,
    spiral_entry,
    tuned,
)
from experiments.limits.out_of_reach import COUNT, excesses
from experiments.limits.runs import Case, LimitsRuns
from experiments.limits.tables import arm_table, reach_table, spiral_table
from experiments.rig.arm import ARM_MJCF
from experiments.rig.checks import closure_check
from experiments.rig.hexapod.metrics import plant_constants
from experiments.study.provenance import versions
from experiments.study.results import Check, Results
from sim import load_model, model_sha256

CONVERTER_STEP_UM = 0.02
RECOVERY_LIMIT_S = 0.5
REST_LIMIT_URAD = 5.0
EXCESS_LIMIT_PERCENT = 1e-6
ARM_LIMIT_MRAD = 10.0
"""While joints brake at their limits the line of sight lags behind."""


def results(ran: LimitsRuns) -> Results:
    """Everything that `fjh limits` publishes."""
    summary = summarize(ran)
    kept = {"true_rad": "true", "strut_input_percent": "inputs"}
    first = next(iter(ran.spirals.values()))
    spiral_arrays = {"time_s": first.time_s, "desired_rad": first.desired} | {
        f"{case.name}_{key}": getattr(run, name)
        for case, run in ran.spirals.items()
        for key, name in kept.items()
    }
    arm_arrays = {
        f"{strategy.name}_{key}": value
        for strategy, run in ran.arm.items()
        for key, value in asdict(run).items()
    }
    return Results(
        summary,
        tables=(
            *(spiral_table(summary, each) for each in summary["conditions"]),
            arm_table(summary),
            reach_table(summary),
        ),
        checks=checks(summary),
        pictures=pictures(ran, summary),
        arrays={"spirals.npz": spiral_arrays, "arm.npz": arm_arrays},
    )


def summarize(ran: LimitsRuns) -> dict[str, Any]:
    """All numbers of the study, ready for JSON; units are in the names."""
    testbed, model = ran.testbed, load_model()
    of_condition: dict[str, Case] = {}
    for case in ran.spirals:
        if case.strategy == UNLIMITED:
            of_condition[case.condition] = case
    spirals = [
        spiral_entry(testbed, case, run, ran.spirals[of_condition[case.condition]])
        for case, run in ran.spirals.items()
    ]
    moved = [arm_entry(strategy, run) for strategy, run in ran.arm.items()]
    return {
        "experiment": "limits",
        "seed": ran.seed,
        "versions": versions(),
        "model_sha256": {"fjh": model_sha256(), "arm": model_sha256(ARM_MJCF)},
        "bench": asdict(testbed.bench) | plant_constants(model),
        "spiral": {
            "duration_s": next(iter(ran.spirals)).duration_s,
            "turn_s": next(iter(ran.spirals)).turn_s,
            "radius_urad": 1e6 * runs.RADIUS_RAD,
            "current_limit_a": runs.CURRENT_LIMIT_A.tolist(),
            "limits_um": [(1e6 * each).tolist() for each in runs.limits_of(testbed)],
            "stuck_strut": 1,
            "stuck_um": 1e6 * runs.STUCK_M,
            "heave_um": 1e6 * runs.HEAVE_M,
        },
        "conditions": [
            condition_entry(testbed, case, ran.spirals[case], spirals)
            for case in of_condition.values()
        ],
        "spirals": spirals,
        "out_of_reach": {
            "demands": COUNT * len(of_condition),
            "strategies": excesses(testbed, ran.spirals, ran.seed),
        },
        "arm": {
            "range_rad": arm.RANGE_RAD,
            "rate_rad_per_s": arm.RATE_RAD_PER_S,
            "acceleration_rad_per_s2": arm.ACCELERATION_RAD_PER_S2,
            "locked_joint": arm.LOCKED + 1,
            "duration_s": len(next(iter(ran.arm.values())).time_s) * arm.PERIOD_S,
            "runs": moved,
            "tuned": tuned(moved, "rms_mrad"),
        },
        "data": ["spirals.npz", "arm.npz"],
    }


def checks(summary: dict[str, Any]) -> list[Check]:
    """Checks: limits, priority, recovery, stability, closure."""
    found, ran = [], {spiral["name"]: spiral for spiral in summary["spirals"]}
    moved = {run["strategy"]: run for run in summary["arm"]["runs"]}
    over_clipping = "RMS error of strict priority over that of clipping, tuned"
    for condition in summary["conditions"]:
        where = condition["name"]
        strict, winding_up = ran[f"{where}_strict"], ran[f"{where}_strict_winding_up"]
        clipping = ran[f"{where}_{condition['tuned']['clipping']['strategy']}"]["rms_urad"]
        windup = strict["rms_urad"] / winding_up["rms_urad"]
        recovered = "time from an attainable target to recovered pointing, strict priority [s]"
        margin = "margin of the circle criterion below zero"
        found += [
            Check(over_clipping, where, strict["rms_urad"] / clipping, 1.0),
            Check("RMS error with anti-windup over that without", where, windup, 1.0),
            Check(recovered, where, strict["recovery_s"], RECOVERY_LIMIT_S),
            Check(margin, where, -condition["circle_margin"], 0.0),
        ]
    for name, spiral in ran.items():
        found.append(closure_check(name, spiral["closure_residual_max_m"]))
        if spiral["strategy"] == UNLIMITED.name:
            continue
        beyond = spiral["beyond_limit_um"]
        found.append(Check("command beyond its limit [um]", name, beyond, CONVERTER_STEP_UM))
        if spiral["strategy"] in ("strict", "scaled", "clipping", "redistributed"):
            what, rest = "pointing error at rest afterwards [urad]", spiral["rest_peak_urad"]
            found.append(Check(what, name, rest, REST_LIMIT_URAD))
    strict = moved["strict"]
    ratio, peak = strict["rms_mrad"] / moved["clipping"]["rms_mrad"], strict["peak_mrad"]
    found += [
        Check(over_clipping, "arm", ratio, 1.0),
        Check("peak error of strict priority [mrad]", "arm", peak, ARM_LIMIT_MRAD),
    ]
    excess = {run["strategy"]: run for run in summary["out_of_reach"]["strategies"]}["strict"]
    what = "error of strict priority above the least possible [%]"
    most = excess["excess_largest_percent"]
    found.append(Check(what, "demands out of reach", most, EXCESS_LIMIT_PERCENT))
    what = "joint beyond its limit [rad]"
    return found + [
        Check(what, f"arm, {name}", run["beyond_limit_rad"], 1e-9)
        for name, run in moved.items()
        if name != UNLIMITED.name
    ]
