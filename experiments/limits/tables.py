"""The tables of `fjh limits`: one row for each strategy."""

from typing import Any

from experiments.limits.measures import RECOVERED_RAD
from experiments.limits.out_of_reach import FARTHEST_RAD
from experiments.study.tables import Column, Table, tabulate

_STRATEGY = Column("strategy", lambda run: label(run["strategy"]))


def spiral_table(summary: dict[str, Any], condition: dict[str, Any]) -> Table:
    """One row for each spiral of a condition."""
    columns = (
        _STRATEGY,
        Column("RMS", "rms_urad", ".0f"),
        Column("peak", "peak_urad", ".0f"),
        Column("attainable", "attainable_rms_urad", ".0f"),
        Column("recovery", "recovery_s", ".2f"),
        Column("struts", "secondary_rms_um", ".0f"),
    )
    failure = "strut 1 stuck" if condition["stuck"] else "no failure"
    raised = "payload to be raised" if condition["heave"] else "no secondary reference"
    return tabulate(
        f"Hexapod, {failure}, {raised}: error, urad; times, s; struts, um",
        columns,
        [run for run in summary["spirals"] if run["condition"] == condition["name"]],
        "RMS, peak: of the distance between desired and true pointing. attainable: RMS while the "
        f"target is attainable; for {condition['not_attainable_s']:.2f} s it is not, which costs "
        f"an RMS of {condition['least_rms_urad']:.0f} urad at least. recovery: longest time for "
        f"which an attainable target is missed by {1e6 * RECOVERED_RAD:.0f} urad more than "
        "without limits. struts: RMS distance of the struts from the secondary goal. "
        f"{best(condition['tuned'])}",
    )


def arm_table(summary: dict[str, Any]) -> Table:
    """One row for each motion of the arm."""
    columns = (
        _STRATEGY,
        Column("RMS", "rms_mrad", ".2f"),
        Column("peak", "peak_mrad", ".2f"),
        Column("at limit", "at_limit_s", ".1f"),
    )
    return tabulate(
        "Arm: angle between desired and true line of sight, mrad; time at a joint limit, s",
        columns,
        summary["arm"]["runs"],
        f"Joints within {summary['arm']['range_rad']:g} rad, at most "
        f"{summary['arm']['acceleration_rad_per_s2']:g} rad/s^2; "
        f"joint {summary['arm']['locked_joint']} locks halfway. {best(summary['arm']['tuned'])}",
    )


def reach_table(summary: dict[str, Any]) -> Table:
    """One row for each strategy: errors over the least possible."""
    columns = (
        _STRATEGY,
        Column("median", "excess_median_percent", ".2g"),
        Column("largest", "excess_largest_percent", ".2g"),
    )
    found = summary["out_of_reach"]
    return tabulate(
        "Hexapod, demands out of reach: pointing error above the least possible, %",
        columns,
        found["strategies"],
        f"{found['demands']} random demands of up to {1e3 * FARTHEST_RAD:g} mrad, in all "
        "conditions; the mapping alone, no loop. Least possible: the distance from the outline of "
        "what is attainable.",
    )


def best(found: dict[str, dict[str, Any]]) -> str:
    """The best of each kind in a sentence."""
    each = (f"{label(one['strategy'])}: {one['rms_over_strict']:.2f}" for one in found.values())
    return f"Least RMS of each kind over that of strict priority: {'; '.join(each)}."


def label(name: str) -> str:
    """A name of the JSON for a reader."""
    named = name.replace("unlimited", "without limits").replace("_tracking_", ", tracking x")
    return named.replace("_", " ")
