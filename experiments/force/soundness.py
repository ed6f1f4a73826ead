"""When the force experiment may be believed."""

from typing import Any

from experiments.hexapod.checks import CLOSURE_LIMIT_M

LIMIT_PERCENT = 1.0
"""Largest distance of a simulated force, or of a motion, from what was said of it."""
COST_LIMIT = 1e-9
"""Largest excess over the least cost, relative: two ways to one least-squares problem."""
ROUND_OFF_N = 1e-9


def complaint(summary: dict[str, Any]) -> str | None:
    """One sentence on what makes the experiment unsound; None when nothing does."""
    found = [_condition(one) for one in summary["conditions"]]
    found += [_tradeoff(summary["tradeoff"])]
    found += [_internal(one) for one in summary["internal_force"]]
    return next(filter(None, found), None)


def _condition(one: dict[str, Any]) -> str | None:
    if not (gap := one["closure_residual_max_m"]) < CLOSURE_LIMIT_M:
        return f"{one['condition']}: a loop opened by {gap:.1e} m"
    checked = ["pressed_off_percent", "held_off_percent", "moved_percent"]
    # Clamped, a lock and the fixture share what no torque sees: no major force is claimed.
    if one["kind"] != "locked":
        checked.append("pressed_major_off_percent")
    for trial in one["theorems"]:
        where = f"{one['condition']}, theorem {trial['theorem']}"
        if not trial["exact"]:
            return f"{where}: the mapping does not call it exact"
        if not (excess := trial["cost_excess"]) < COST_LIMIT:
            return f"{where}: it costs {excess:.1e} more than the least"
        if sentence := _too_far(where, trial, *checked):
            return sentence
    for held in one["prescribed"]:
        where = f"{one['condition']}, prescribed wrench, {held['mapping']} mapping"
        if sentence := _too_far(where, held, "off_percent"):
            return sentence
    return None


def _tradeoff(trade: dict[str, Any]) -> str | None:
    others = trade["others"]
    if not others["cheapest_over_mapping"] >= 1:
        return "another torque of the same major force is cheaper than the mapping's"
    return _too_far("the mapping", trade["mapping"], "major_off_percent") or _too_far(
        "another torque of the same major force", others, "major_off_percent"
    )


def _internal(use: dict[str, Any]) -> str | None:
    where = f"platform, {use['name']}"
    if not use["saved_at_least_n"] > -ROUND_OFF_N:
        return f"{where}: with internal force the torques cost more than without"
    for how in ("without", "used"):
        exerted = f"{where}, internal force {how}"
        if sentence := _too_far(exerted, use[how], "wrench_off_percent", "legs_off_percent"):
            return sentence
    return None


def _too_far(where: str, numbers: dict[str, Any], *names: str) -> str | None:
    for name in names:
        if not (off := numbers[name]) < LIMIT_PERCENT:
            return f"{where}: {name} is {off:.2g}, more than {LIMIT_PERCENT:g}"
    return None
