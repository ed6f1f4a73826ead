"""Everything that `fjh release` leaves in its folder."""

from dataclasses import fields
from pathlib import Path
from typing import Any

from experiments.hexapod.provenance import recording_properties
from experiments.hexapod.recording.keep import keep_run
from experiments.hexapod.recording.notes import run_notes
from experiments.hexapod.recording.shown import Shown
from experiments.hexapod.simulation import Trajectory
from experiments.output.files import published, write_arrays, write_index
from experiments.output.plotting import save_figure
from experiments.output.recording.file import About
from experiments.output.recording.marks import Mark
from experiments.release.figure import figure_release
from experiments.release.study import Release
from prioritized import Classes
from sim import Array, load_model


def write(folder: Path, release: Release, summary: dict[str, Any]) -> dict[str, Any]:
    """Write data, recordings and figures; all of them or none.

    Returns:
        The contents of `release.json`: the summary and the names of all files.

    Raises:
        OutputError: The disk or the folder refuses.
    """
    properties, model = recording_properties(summary), load_model()
    with published(folder, index="release.json") as staging:
        for spiral in summary["spirals"]:
            name = spiral["name"]
            run = release.trajectories[name]
            predicted = {"linear": release.linear[name], "quasi_static": release.quasi_static[name]}
            own = properties | spiral["plant"]
            notes = _notes(spiral, summary, run, own)
            about = About(f"release-{name}-seed{summary['seed']}", name, notes, own)
            keep_run(staging, name, about, model, Shown(run, _marks(spiral)), predicted)
        write_arrays(staging / "atlas.npz", _atlas_arrays(release))
        save_figure(figure_release(release, summary), staging, "release")
        return write_index(staging / "release.json", summary)


def _atlas_arrays(release: Release) -> dict[str, Array]:
    """Rigid and elastic verdicts side by side; rows are conditions."""
    atlas = release.atlas
    assert atlas.elastic is not None  # the hexapod has springs
    names = [field.name for field in fields(Classes)]
    rigid = {f"rigid_{name}": getattr(atlas, name) for name in names}
    elastic = {f"elastic_{name}": getattr(atlas.elastic, name) for name in names}
    return {"codes": atlas.codes} | rigid | elastic


def _marks(spiral: dict[str, Any]) -> list[Mark]:
    """Strut 1 from when it fails."""
    if spiral["kind"] is None:
        return []
    told = spiral["told"].replace("_", " ")
    return [Mark(0, spiral["failure_time_s"], f"strut 1 {spiral['kind']}, {told}")]


def _what(spiral: dict[str, Any]) -> str:
    if spiral["kind"] is None:
        return "all struts sound"
    lost = "coil" if spiral["kind"] == "free" else "coil and suspension spring"
    told = {
        "uncorrected": "the mapping is not told",
        "corrected": "the mapping is told, and reckons with the springs",
        "as_locked": "the mapping is told that it is locked",
    }
    return f"strut 1 loses its {lost}; {told[spiral['told']]}"


def _notes(
    spiral: dict[str, Any], summary: dict[str, Any], run: Trajectory, properties: dict[str, Any]
) -> str:
    """The run in words, shown beside its plots."""
    when = "" if spiral["kind"] is None else f" (at {spiral['failure_time_s']:g} s)"
    orbit = " In orbit: no weight, no preload." if spiral["kind"] == "loose" else ""
    said = [
        f"Seed {summary['seed']}, {summary['duration_s']:g} s, constant Jacobian, W_a; "
        f"{_what(spiral)}{when}.{orbit}",
        "",
    ]
    beside = {
        "linear model": (spiral["predicted_alpha_rms_urad"], spiral["predicted_beta_rms_urad"])
    }
    return run_notes(spiral["name"].replace("_", " "), said, run, beside, properties)
