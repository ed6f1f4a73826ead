"""The mechanisms as data: the contents of `systems.json`, and whether to believe it."""

from typing import Any

from experiments.output.provenance import versions
from experiments.systems.mechanisms import MECHANISMS
from experiments.systems.probe import STEP
from experiments.systems.study import Examination
from sim import model_sha256

LIMIT = 0.01
"""Largest relative distance between simulated and predicted motions, displacements and torques."""


def summarize(examinations: list[Examination], seed: int) -> dict[str, Any]:
    """All numbers of the experiment, ready for JSON."""
    return {
        "experiment": "systems",
        "seed": seed,
        "versions": versions(),
        "model_sha256": {mechanism.name: model_sha256(mechanism.path) for mechanism in MECHANISMS},
        "step_m_or_rad": STEP,
        "systems": [_entry(one) for one in examinations],
    }


def complaint(summary: dict[str, Any]) -> str | None:
    """One sentence on what the simulation does otherwise than predicted; None when nothing."""
    for one in summary["systems"]:
        where = f"{one['mechanism']}, {one['condition']}"
        if not one["agrees"]:
            return f"{where}: the simulation moves in other directions than the classification says"
        for name in checked_errors(one):
            if not one[name] < LIMIT:
                return f"{where}: {name} is {one[name]:.2g}, more than {LIMIT:g}"
    return None


def checked_errors(one: dict[str, Any]) -> list[str]:
    """Which errors of an entry must be small."""
    always = ["motion_error", "drift_error", "torque_error", "closure_error", "yielded_steps"]
    # Self-motion of the major task is held by nothing: each corner hands its drift on.
    return always if one["unstable_major"] else [*always, "major_error"]


def _entry(one: Examination) -> dict[str, Any]:
    report = one.report
    unit = one.mechanism.major_unit
    return {
        "mechanism": one.mechanism.name,
        "index": one.mechanism.conditions.index(one.condition),
        "condition": str(one.condition),
        "locked": list(one.condition.locked),
        "free": list(one.condition.free),
        "major": one.mechanism.major_names,
        "unmanipulable": report.unmanipulable,
        "unmanipulable_task": report.unmanipulable_task,
        "unstable": report.unstable,
        "unstable_major": report.unstable_major,
        "unstable_secondary": report.unstable_secondary,
        "irresolvable": report.irresolvable,
        "self_motion": report.bases["unstable"].shape[1],
        "self_motion_major": report.bases["unstable_major"].shape[1],
        "constrained_active": len(report.bases["constrained_active"]),
        "internal_forces": len(report.bases["irresolvable"]),
        "lost_task_directions": report.bases["unmanipulable_task"].shape[1],
        f"worst_gain_{unit}_per_actuator_unit": report.worst_gain,
        "smallest_gap": min(report.gaps.values()),
        "simulated": {
            "major_directions": one.reach,
            "self_motion": one.drift,
            "self_motion_major": one.drift_major,
            "constrained_active": one.bound,
        },
        "agrees": one.agrees,
        "motion_error": one.motion_error,
        "drift_error": one.drift_error,
        "major_error": one.polygon.error,
        "torque_error": one.held.torque_error,
        "closure_error": one.held.closure_error,
        "yielded_steps": one.held.yielded,
        "recording": f"{one.mechanism.name}.rrd",
        "data": f"{one.mechanism.name}.npz",
    }
