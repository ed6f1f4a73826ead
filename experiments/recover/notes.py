"""The results, one sentence each."""

from typing import Any

from experiments.recover.comparison import controller_notes
from experiments.recover.tables import percent
from experiments.study.resumable import rate as session_rate


def notes(summary: dict[str, Any]) -> list[str]:
    """What was found, from the JSON alone."""
    sound, beliefs = summary["sound"], summary["beliefs"]
    second, cost = summary["second_failure"], summary["dither_cost"]
    change, reseeded = (max(map(abs, cost[f"{key}_urad"])) for key in ("change", "reseeded"))
    each_s = round(3600 * sound["hours"] / sound["flights"], 3)
    lines = [
        *(_isolation(name, summary) for name in ("all", "exact")),
        f"{sound['flights']} flights of {each_s:g} s without failures and with all mismatches, "
        f"{sound['hours']:.3g} h: {sound['alarms']} alarms (below {sound['high_per_hour_95']:.2g} "
        f"per hour at 95 %; {sound['watched_hours']:.3g} h count, as none is possible in the first "
        f"{summary['rules']['learning_s']:g} s of each), {sound['sound_named']} flights in which a "
        f"strut was named, {sound['commands_changed']} whose commands changed.",
        f"Flights with two failures and all mismatches: both identified in "
        f"{_share(second['all_right'])}; identified or the task declared lost in "
        f"{_share(second['handled_or_declared'])}.",
        f"On the exact model the dither changes the RMS error without failures by {change:.1e} "
        f"urad, another seed by {reseeded:.1e} urad. On a plant with all mismatches it moves the "
        f"pointing by {cost['moved_urad']:.2g} urad RMS.",
        f"Of {beliefs['pairs_of_truth_and_belief']} pairs of true and diagnosed fault, "
        f"{beliefs['unstable']} give an unstable loop; the peak sensitivity is "
        f"{beliefs['sensitivity_peak_worst']:.2f} at most, "
        f"{beliefs['sensitivity_peak_nothing_failed']:.2f} without failures.",
    ]
    if cascade := summary["shown"].get("cascade"):
        ends = "is impossible" if cascade["task_lost"] else "is still possible"
        lines.append(
            f"After {len(cascade['happened'])} failures the pointing task {ends}, as diagnosed."
        )
    return lines + controller_notes(summary) + session_rate(summary)


def _isolation(mismatch: str, summary: dict[str, Any]) -> str:
    isolation, over = summary["isolation"][mismatch], summary["after_over_oracle"][mismatch]
    plant = "With all mismatches" if mismatch == "all" else "With an exact plant"
    return (
        f"{plant}, of the failures with a distance of at least "
        f"{isolation['separation_required']:g} in the exact linear model, the first diagnosis had "
        f"the right strut in {_share(isolation['strut_as_first_named'])}, the last one the right "
        f"strut and kind in {_share(isolation['strut_and_kind_in_the_end'])}. After recovery the "
        f"RMS error is {over['pooled']:.4f} times that of a controller informed at once; "
        f"{over['worst_case']:.4f} times in the worst case."
    )


def _share(counted: dict[str, Any]) -> str:
    return percent(counted) or "no case"
