"""The mechanisms in print, from `systems.json`."""

from typing import Any

from experiments.output.findings import Findings, Picture, Table
from experiments.systems.summary import checked_errors, complaint

PICTURES = [
    Picture(
        "systems.png",
        "Each mechanism's major task around an octagon, sound and failed, in simulation.",
        "A panel for each mechanism: its paths pass through all corners, but for the dashed ones, "
        "whose task is lost as classified.",
    )
]


def findings(summary: dict[str, Any]) -> Findings:
    """One table for all mechanisms."""
    return Findings(summary, [table(summary)], [], PICTURES, complaint(summary))


def table(summary: dict[str, Any]) -> Table:
    """One row for each mechanism and condition."""
    rows = [
        (
            one["mechanism"],
            one["condition"],
            _task_words(one),
            _count_words(one["self_motion"], one["self_motion_major"]),
            str(one["constrained_active"] or "-"),
            f"{max(one[name] for name in checked_errors(one)):.0e}",
        )
        for one in summary["systems"]
    ]
    return Table(
        "Classification, and how far the simulation is off",
        ("mechanism", "broken", "major task", "self-motion", "bound", "off by"),
        rows,
        "self-motion: freedoms that no sound actuator holds, and whether they move the major task. "
        "bound: combinations of actuator rates that cannot be. off by: simulated motions and "
        "torques, as a part of the predicted.",
    )


def _task_words(one: dict[str, Any]) -> str:
    if one["unmanipulable"]:
        return "unreached"
    return "not held" if one["unstable_major"] else "exact"


def _count_words(count: int, major: int) -> str:
    if not count:
        return "-"
    return f"{count}, major" if major else f"{count}, aside"
