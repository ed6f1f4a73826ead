"""Everything that `fjh goals` leaves in its folder."""

from pathlib import Path
from typing import Any

import numpy as np

from experiments.files import published, write_arrays, write_json
from experiments.goals.demonstration import REFERENCE, Outcome
from experiments.goals.figure import MEASURES, figure_goals
from experiments.goals.study import Outcomes
from experiments.goals.summary import markdown
from experiments.provenance import version_properties
from experiments.rerun_file import write_series
from sim import Array

_RATE_HZ = 200
_STRUTS = [f"strut {k} [um]" for k in range(1, 7)]
_DETAILS: dict[str, tuple[str, list[str], float]] = {
    "reliability": ("temperature_c", [f"coil {k} [C]" for k in range(1, 7)], 1.0),
    "stroke": ("strut_displacement_m", _STRUTS, 1e6),
    "obstacle": ("strut_displacement_m", _STRUTS, 1e6),
    "singularity": ("singular_values", ["largest [1]", "smallest [1]"], 1.0),
}
"""What else a recording shows: array, names of its columns, factor to their units."""


def write(folder: Path, outcomes: Outcomes, summary: dict[str, Any]) -> None:
    """Write data, recordings, figure and table; all of them or none.

    Raises:
        OutputError: The disk or the folder refuses.
    """
    with published(folder, index="goals.json") as staging:
        for goal in summary["goals"]:
            ours = outcomes[goal["name"]]
            write_arrays(staging / goal["data"], _arrays(goal, ours))
            _write_recording(staging / goal["recording"], goal, ours, summary)
        figure_goals(outcomes, summary).savefig(staging / "goals.png", dpi=130)
        (staging / "goals.md").write_text(markdown(summary), encoding="utf-8")
        write_json(staging / "goals.json", summary)


def _arrays(goal: dict[str, Any], ours: dict[str, Outcome]) -> dict[str, Array]:
    """Arrays of all ways, their names in front; of the other seeds the errors alone."""
    arrays = {"time_s": ours[REFERENCE].time_s}
    for name, outcome in ours.items():
        kept = {"error_rad": outcome.error_rad}
        if not name.startswith(f"{REFERENCE}_seed"):
            kept |= {goal["measure"]: outcome.measure} | outcome.arrays
        arrays |= {f"{name}_{key}": value for key, value in kept.items()}
    return arrays


def _write_recording(
    path: Path, goal: dict[str, Any], ours: dict[str, Outcome], summary: dict[str, Any]
) -> None:
    shown = [name for name in ours if not name.startswith(f"{REFERENCE}_seed")]
    time_s = ours[REFERENCE].time_s
    every = slice(None, None, max(1, round(1 / (_RATE_HZ * float(time_s[1] - time_s[0])))))

    def side_by_side(values: list[Array]) -> tuple[Array, list[str], Array]:
        names = [name.replace("_", " ") for name in shown]
        return time_s[every], names, np.column_stack(values)[every]

    plots = {MEASURES[goal["measure"]]: side_by_side([ours[name].measure for name in shown])}
    for k, angle in enumerate(goal["angles"]):
        errors = [1e6 * ours[name].error_rad[:, k] for name in shown]
        plots[f"{angle} error [urad]"] = side_by_side(errors)
    key, names, factor = _DETAILS[goal["name"]]
    for way in ("pursued", "nothing"):
        plots[f"{way}: {key}"] = (time_s[every], names, factor * ours[way].arrays[key][every])
    sha256 = summary["model_sha256"][goal["machine"]]
    properties = {"seed": summary["seed"], "model_sha256": sha256}
    write_series(
        path,
        f"goals-{goal['name']}-seed{summary['seed']}",
        goal["title"],
        plots,
        _notes(goal),
        properties | version_properties(summary),
    )


def _notes(goal: dict[str, Any]) -> str:
    """The goal in words, shown beside its plots."""
    clear = "below" if goal["keeps_below"] else "above"
    lines = [f"# {goal['title']}", "", f"It must stay {clear} {goal['limit']:g}.", ""]
    for run in goal["runs"]:
        first, second = run["rms_urad"]
        lines.append(
            f"- {run['name'].replace('_', ' ')}: {run[goal['measure']]:.4g} at its worst; "
            f"pointing error {first:.3f}, {second:.3f} urad RMS"
        )
    settings = [f"- {key}: {value}" for key, value in goal["settings"].items()]
    return "\n".join([*lines, "", "Chosen:", "", *settings])
