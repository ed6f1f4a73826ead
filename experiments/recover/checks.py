"""What must hold for the study to be trusted, and its goals."""

from math import nan
from typing import Any

from experiments.recover.comparison import controller_checks
from experiments.rig.hexapod.metrics import closure_check
from experiments.study.results import Check

NOT_ISOLATED, OVER_ORACLE, ALARMS_PER_HOUR = 0.01, 1.10, 0.1
"""Goals: the share of failures that may stay unidentified, the RMS over an informed controller's,
and the rate of false alarms."""

NAMED_MS = 300.0
"""Goal: median time until the failed strut is named, with all mismatches."""

ENOUGH_H = 30.0
"""Fewer hours could not show the rate of false alarms even without any alarm."""


def checks(summary: dict[str, Any]) -> list[Check]:
    """Checks: closure residuals, stability, identification, recovery, false alarms."""
    beliefs, sound = summary["beliefs"], summary["sound"]
    worst = f"{beliefs['worst_truth']}, {beliefs['worst_belief']} diagnosed"
    what = "number of unstable pairs of true and diagnosed fault"
    found = [
        closure_check("runs at the usual sizes", summary["closure_residual_max_m"]),
        Check("number of flights that diverged", "all runs", summary["diverged"], 1),
        Check(what, worst, beliefs["unstable"], 1),
    ]
    for plant, isolation in summary["isolation"].items():
        for which in ("strut_as_first_named", "strut_and_kind_in_the_end"):
            where = f"{_plant(plant)}, {which.replace('_', ' ')}"
            found.append(_isolated(where, isolation[which]["rate"]))
    for plant, ratios in summary["after_over_oracle"].items():
        what = "RMS after recovery divided by that of a controller informed at once"
        found.append(Check(what, _plant(plant), ratios["pooled"], OVER_ORACLE))
    [mixed] = [each for each in summary["failures"] if each["mismatch"] == "all"]
    median_ms = nan if mixed["named_ms"] is None else mixed["named_ms"]["median"]
    what = "median time until the failed strut is named [ms]"
    found.append(Check(what, _plant("all"), median_ms, NAMED_MS))
    named = sum(each["sound_named"]["right"] for each in summary["failures"])
    what = "number of flights in which a sound strut was named"
    found.append(Check(what, "flights with a failure", named, 1))
    found.append(Check(what, "flights without failures", sound["sound_named"], 1))
    what = "number of flights whose commands an alarm changed"
    found.append(Check(what, "flights without failures", sound["commands_changed"], 1))
    bound = "high_per_hour_95" if sound["hours"] >= ENOUGH_H else "low_per_hour_95"
    what = "95 % bound of the false alarms per hour"
    found.append(Check(what, "flights without failures", sound[bound], ALARMS_PER_HOUR))
    second = summary["second_failure"]["handled_or_declared"]["rate"]
    found.append(_isolated("two failures in a flight", second))
    for name, happened in summary["shown"].items():
        what = "wrong diagnosis of the failures or of the task (0 no, 1 yes),"
        found.append(Check(what, f"run {name}", float(not happened["right"]), 0.5))
    return found + controller_checks(summary)


def _plant(mismatch: str) -> str:
    return "all mismatches" if mismatch == "all" else "exact plant"


def _isolated(where: str, right: float | None) -> Check:
    what = "share of the isolable failures that is not identified"
    return Check(what, where, nan if right is None else 1 - right, NOT_ISOLATED)
