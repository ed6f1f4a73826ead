"""The goals in print, from `goals.json`."""

from typing import Any

from experiments.goals.demonstration import REFERENCE
from experiments.goals.summary import complaint
from experiments.output.findings import Findings, Picture, Table

PICTURES = [
    Picture(
        "goals.png",
        "Four secondary goals pursued through the mapping, not at all, and conventionally.",
        "Four rows of panels over time: coil temperature, stroke left, clearance and condition "
        "number keep clear of their limits only when pursued. Beside them the pointing errors, and "
        "their changes, which stay below those of another seed where the goal is pursued.",
    )
]


def findings(summary: dict[str, Any]) -> Findings:
    """One table for all goals."""
    return Findings(summary, [table(summary)], [], PICTURES, complaint(summary))


def table(summary: dict[str, Any]) -> Table:
    """One row for each goal and way, and one for what another seed changes."""
    rows = []
    for goal in summary["goals"]:
        for run in goal["runs"]:
            if run["name"].startswith(f"{REFERENCE}_seed"):
                continue
            label = way_label(run)
            measures = (f"{round(run[goal['measure']], 1) + 0.0:.1f}", f"{goal['limit']:g}")
            keys = ("rms_urad", "peak_urad", "rms_change_urad", "difference_rms_urad")
            rows.append((f"{goal['name']}, {label}", *measures, *(_larger(run[k]) for k in keys)))
        noise = goal["another_seed"]
        changes = [_larger([noise[key]]) for key in ("rms_change_urad", "difference_rms_urad")]
        rows.append((f"{goal['name']}, other seed", "", "", "", "", *changes))
    return Table(
        "Secondary measure at its worst; desired minus true pointing, larger angle, urad",
        ("", "worst", "limit", "RMS", "peak", "change", "by tick"),
        rows,
        "RMS and peak of the pointing error, the change of that RMS, and the RMS of the change. "
        "reliability: hottest coil, C; stroke: stroke left, um; obstacle: clearance, um; "
        "singularity: condition number.",
    )


def way_label(run: dict[str, Any]) -> str:
    """A run in a word; pseudo-inverses by their weight."""
    return "w = {:g}".format(run["major_weight"]) if run["major_weight"] else run["name"]


def _larger(values: list[float]) -> str:
    value = max(map(abs, values))
    return f"{value:.3f}" if value < 100 else f"{value:.0f}"
