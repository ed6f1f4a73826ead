"""Recordings of `fjh goals`: the goal pursued, and nothing done, side by side."""

from dataclasses import fields
from pathlib import Path
from typing import Any

from experiments.goals import obstacle
from experiments.goals.arm import ARM_MJCF
from experiments.goals.demonstration import Outcome
from experiments.goals.figure import MEASURES
from experiments.hexapod.recording.notes import constants
from experiments.hexapod.recording.shown import Shown
from experiments.hexapod.recording.side_by_side import write_side_by_side
from experiments.hexapod.simulation import Trajectory
from experiments.output.provenance import version_properties
from experiments.output.recording.file import About
from experiments.output.recording.marks import Mark
from experiments.output.recording.mechanism import Driven, write_mechanism
from experiments.output.recording.series import Plot
from sim import load_model

_STRUTS = [f"strut {k} [um]" for k in range(1, 7)]
_DETAILS: dict[str, tuple[str, str, list[str], float]] = {
    "reliability": (
        "temperature_c",
        "Coil temperatures [C]",
        [f"coil {k} [C]" for k in range(1, 7)],
        1.0,
    ),
    "stroke": ("strut_displacement_m", "Strut displacements [um]", _STRUTS, 1e6),
    "obstacle": ("strut_displacement_m", "Strut displacements [um]", _STRUTS, 1e6),
    "singularity": ("singular_values", "Singular values of J_m [1]", ["largest", "smallest"], 1.0),
}
"""What else is shown: array, title, names of its columns, factor to their units."""


def write_goal(
    path: Path, goal: dict[str, Any], ours: dict[str, Outcome], summary: dict[str, Any]
) -> None:
    """Write one goal's `.rrd`: its entry in `goals.json`, its runs by way, all of `goals.json`."""
    properties = {
        "seed": summary["seed"],
        "model_sha256": summary["model_sha256"][goal["machine"]],
    }
    properties |= {f"goal_{name}": value for name, value in goal["settings"].items()}
    properties |= version_properties(summary) | (
        summary["bench"] if goal["machine"] == "fjh" else {}
    )
    name = f"goals-{goal['name']}-seed{summary['seed']}"
    about = About(name, goal["title"], _notes(goal, properties), properties)
    ways = {way: ours[way] for way in ("pursued", "nothing")}
    if goal["machine"] == "fjh":
        obstructed = goal["name"] == obstacle.DEMONSTRATION.name
        model = obstacle.cluttered() if obstructed else load_model()
        marks = [Mark(obstacle.STRUT, 0.0, "strut 1 locked")] if obstructed else []
        shown = {
            way: Shown(_flown(outcome), marks, _plots(goal, outcome))
            for way, outcome in ways.items()
        }
        write_side_by_side(path, about, model, shown)
    else:
        driven = {
            way: Driven(
                outcome.time_s,
                outcome.arrays["joint_rad"],
                [_error(goal, outcome), *_plots(goal, outcome)],
            )
            for way, outcome in ways.items()
        }
        write_mechanism(path, about, load_model(ARM_MJCF), driven)


def _flown(outcome: Outcome) -> Trajectory:
    """The hexapod's run among an outcome's arrays."""
    names = [field.name for field in fields(Trajectory) if field.name != "time_s"]
    return Trajectory(outcome.time_s, **{name: outcome.arrays[name] for name in names})


def _plots(goal: dict[str, Any], outcome: Outcome) -> list[Plot]:
    measure = MEASURES[goal["measure"]].replace("$", "")
    key, title, names, factor = _DETAILS[goal["name"]]
    return [
        Plot("measure", measure, [measure], outcome.time_s, outcome.measure[:, None]),
        Plot("details", title, names, outcome.time_s, factor * outcome.arrays[key]),
    ]


def _error(goal: dict[str, Any], outcome: Outcome) -> Plot:
    names = [f"{angle} [urad]" for angle in goal["angles"]]
    title = "Pointing error, desired - true [urad]"
    return Plot("error", title, names, outcome.time_s, 1e6 * outcome.error_rad)


def _notes(goal: dict[str, Any], properties: dict[str, Any]) -> str:
    """The goal in words and all ways in a table, shown beside the views."""
    clear = "below" if goal["keeps_below"] else "above"
    measure = MEASURES[goal["measure"]].replace("$", "")
    first, second = goal["angles"]
    rows = [
        f"| {run['name'].replace('_', ' ')} | {run[goal['measure']]:.4g} "
        f"| {run['rms_urad'][0]:.3f} | {run['rms_urad'][1]:.3f} |"
        for run in goal["runs"]
    ]
    return "\n".join(
        [
            f"# {goal['title']}",
            "",
            f"{measure}: must stay {clear} {goal['limit']:g}.",
            "",
            f"| way | {measure}, worst | {first}, urad RMS | {second}, urad RMS |",
            "| --- | --- | --- | --- |",
            *rows,
            "",
            *constants(properties),
        ]
    )
