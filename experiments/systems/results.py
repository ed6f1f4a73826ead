"""The examined mechanisms as numbers, checks, a table and files."""

from functools import partial
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from experiments.recording.file import RecordingInfo
from experiments.recording.layout import write_scenes
from experiments.recording.plane import Plane
from experiments.recording.properties import checked, constants
from experiments.recording.scene import Scene, condition_scene
from experiments.recording.signals import Plot
from experiments.rig.conditions import FREE, LOCKED
from experiments.study.provenance import version_properties, versions
from experiments.study.results import Check, Results
from experiments.study.tables import Column, Table, tabulate
from experiments.systems.figure import pictures
from experiments.systems.probe import PERIOD_S, STEP
from experiments.systems.runs import Mechanism, Probing, Systems
from sim import Array, load_model, model_sha256

LIMIT = 0.01
"""Largest relative distance between simulated and predicted motions, displacements and torques."""


def results(systems: Systems) -> Results:
    """Everything that `fjh systems` publishes."""
    summary = summarize(systems)
    examined = systems.examinations.items()
    return Results(
        summary,
        tables=(table(summary),),
        checks=checks(summary),
        pictures=pictures(systems),
        arrays={f"{mechanism.name}.npz": _arrays(ours) for mechanism, ours in examined},
        records=[partial(_record, mechanism, ours, summary) for mechanism, ours in examined],
    )


def summarize(systems: Systems) -> dict[str, Any]:
    """All numbers of the experiment, ready for JSON."""
    examined = systems.examinations
    return {
        "experiment": "systems",
        "seed": systems.seed,
        "versions": versions(),
        "model_sha256": {mechanism.name: model_sha256(mechanism.path) for mechanism in examined},
        "step_m_or_rad": STEP,
        "systems": [_entry(one) for ours in examined.values() for one in ours],
    }


def checks(summary: dict[str, Any]) -> list[Check]:
    """Checks: directions and sizes of the simulated motion against classification and mapping."""
    found = []
    for one in summary["systems"]:
        where = f"{one['mechanism']}, {one['condition']}"
        what = "difference between simulation and classification in directions of motion (0 or 1)"
        found.append(Check(what, where, float(not one["agrees"]), 0.5))
        found += [Check(name, where, one[name], LIMIT) for name in checked_errors(one)]
    return found


def checked_errors(one: dict[str, Any]) -> list[str]:
    """Names of the errors of an entry that are checked."""
    always = ["motion_error", "drift_error", "torque_error", "closure_error", "yielded_steps"]
    # No actuator holds self-motion of the major task: each corner passes its motion on to the next.
    return always if one["unstable_major"] else [*always, "major_error"]


def table(summary: dict[str, Any]) -> Table:
    """One row for each mechanism and condition."""
    columns = (
        Column("mechanism", "mechanism"),
        Column("failed", "condition"),
        Column("major task", lambda one: one["verdict"].replace("_", " ")),
        Column("self-motion", _self_motion_words),
        Column("constraints", lambda one: one["constrained_active"] or "-"),
        Column("error", lambda one: max(one[name] for name in checked_errors(one)), ".0e"),
    )
    return tabulate(
        "Classification of each condition, and the largest error of its prediction",
        columns,
        summary["systems"],
        "major task: exact, drifts (self-motion moves it), or what is left of it. self-motion: "
        "number of motions with all actuators at rest, and whether they move the major task. "
        "constraints: number of combinations of actuator rates that the loops forbid. error: "
        "largest relative difference between simulated and predicted motions, torques and forces.",
    )


def _self_motion_words(one: dict[str, Any]) -> str:
    if not one["self_motion"]:
        return "-"
    return f"{one['self_motion']}, {'major' if one['self_motion_major'] else 'not major'}"


_FLAGS = ("unmanipulable", "unmanipulable_task", "irresolvable")
_FLAGS += ("unstable", "unstable_major", "unstable_secondary")


def _entry(one: Probing) -> dict[str, Any]:
    mechanism, report = one.mechanism, one.report
    predicted = ("self_motion", "self_motion_major", "constrained_active")
    return {
        "mechanism": mechanism.name,
        "index": mechanism.conditions.index(one.condition),
        "condition": one.in_words,
        "locked": one.failed(LOCKED),
        "free": one.failed(FREE),
        "major": mechanism.major_names,
        "verdict": one.verdict,
        **{flag: getattr(report, flag) for flag in _FLAGS},
        **{count: one.predicted[count] for count in predicted},
        "internal_forces": len(report.bases["irresolvable"]),
        "lost_task_directions": report.bases["unmanipulable_task"].shape[1],
        f"worst_gain_{mechanism.major_unit}_per_actuator_unit": report.worst_gain,
        "smallest_gap": min(report.gaps.values()),
        "simulated": one.simulated,
        "agrees": one.simulated == one.predicted,
        **one.errors,
        "recording": f"{mechanism.name}.rrd",
        "data": f"{mechanism.name}.npz",
    }


def _arrays(ours: list[Probing]) -> dict[str, Array]:
    """Every condition's run around the polygon, its number at the end of the names."""
    arrays = {}
    for k, one in enumerate(ours):
        unit, polygon = one.mechanism.major_unit, one.polygon
        arrays |= {f"time_s_{k}": one.time_s, f"qpos_{k}": polygon.qpos}
        arrays |= {f"{what}_{unit}_{k}": getattr(polygon, what) for what in ("desired", "reached")}
    return arrays


def _record(
    mechanism: Mechanism, ours: list[Probing], summary: dict[str, Any], folder: Path
) -> None:
    properties = {key: summary[key] for key in ("seed", "step_m_or_rad")}
    properties |= {"model_sha256": summary["model_sha256"][mechanism.name], "period_s": PERIOD_S}
    properties |= version_properties(summary)
    notes = [
        f"# {mechanism.title}",
        "",
        "The payload follows an octagon in its major task, without and with failures.",
        "",
    ]
    for one in ours:
        sentences = [f"- {sentence}" for sentence in str(one.report).splitlines()]
        notes += [f"## {one.in_words}", "", *sentences, ""]
    identity = f"systems-{mechanism.name}-seed{summary['seed']}"
    text = "\n".join([*notes, *constants(properties)])
    found = {"study": "systems", "robot": mechanism.name, "verdict": notes[2]}
    found |= {"failures": "; ".join(one.in_words for one in ours)}
    found["checks"] = checked(checks(summary))
    about = RecordingInfo(identity, mechanism.title, text, properties, found)
    model = load_model(mechanism.path)
    scenes = {one.in_words: _scene(model, one) for one in ours}
    write_scenes(folder / f"{mechanism.name}.rrd", about, scenes, pages=False)


def _scene(model: mujoco.MjModel, one: Probing) -> Scene:
    desired, reached = 1e6 * one.polygon.desired, 1e6 * one.polygon.reached
    names, unit = one.mechanism.major_names, f"u{one.mechanism.major_unit}"
    title, labels = f"desired - reached [{unit}]", [f"{name} off [{unit}]" for name in names]
    plot = Plot("off", title, labels, one.time_s, desired - reached)
    curves = desired[:, :2], reached[:, :2]
    right, up = names[:2]
    plane = Plane(f"{up} over {right}", (right, up), unit, *curves, np.concatenate(curves))
    return condition_scene(model, one.time_s, one.polygon.qpos, [plot], plane=plane)
