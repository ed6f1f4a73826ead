"""Everything that `fjh table1` leaves in its folder."""

from pathlib import Path
from typing import Any

from experiments.hexapod.provenance import recording_properties
from experiments.hexapod.recording.keep import keep_run
from experiments.hexapod.recording.notes import run_notes
from experiments.hexapod.recording.shown import Shown
from experiments.hexapod.simulation import Trajectory
from experiments.output.files import published, write_index
from experiments.output.findings import is_cut
from experiments.output.plotting import save_figure
from experiments.output.recording.file import About
from experiments.output.recording.marks import Mark
from experiments.table1 import figures
from experiments.table1.study import Table1
from experiments.table1.text import findings
from sim import load_model

FIGURES = {
    "figure4": figures.figure_4,
    "figure5": figures.figure_5,
    "figure6": figures.figure_6,
}

_CHOICES = ("locked", "free", "joint_weight", "secondary_weight_t_x_t_y_t_z_gamma")


def write(folder: Path, table: Table1, summary: dict[str, Any]) -> dict[str, Any]:
    """Write data, recordings, figures and tables; all of them or none.

    Returns:
        The contents of `table1.json`: the summary and the names of all files.

    Raises:
        OutputError: The disk or the folder refuses.
    """
    properties = recording_properties(summary)
    model = load_model(table.mjcf)
    with published(folder, index="table1.json") as staging:
        for column in summary["columns"]:
            name = column["name"]
            shown = Shown(table.trajectories[name], _marks(column))
            own = properties | {key: column[key] for key in _CHOICES if column[key]}
            notes = _notes(column, summary, shown.run, own)
            about = About(_identity(name, table), name, notes, own)
            keep_run(staging, name, about, model, shown)
        for name, draw in FIGURES.items():
            save_figure(draw(table.trajectories), staging, name)
        (staging / "table1.md").write_text(findings(summary).markdown(), encoding="utf-8")
        return write_index(staging / "table1.json", summary)


def _identity(name: str, table: Table1) -> str:
    """Of a recording; the viewer lays out all recordings of one identity alike."""
    chosen = table.configuration.name
    words = ["table1", *([] if chosen == "calibrated" else [chosen]), name, f"seed{table.seed}"]
    return "-".join(words)


def _marks(column: dict[str, Any]) -> list[Mark]:
    """Locked struts; whether the mapping knows of them."""
    known = "uncorrected" if "uncorrected" in column["name"] else "corrected"
    return [Mark(k, 0.0, f"strut {k + 1} locked, {known}") for k in column["locked"]]


def _notes(
    column: dict[str, Any], summary: dict[str, Any], run: Trajectory, properties: dict[str, Any]
) -> str:
    """The run in words, shown beside its plots."""
    weight = column["joint_weight"], column["secondary_weight_t_x_t_y_t_z_gamma"]
    locked = ", ".join(mark.failure for mark in _marks(column)) or "all struts sound"
    minimized = (
        f"strut displacements, weights {weight[0]}"
        if weight[0]
        else (f"secondary motion, weights on t_x, t_y, t_z, gamma {weight[1]}")
    )
    said = [
        f"Seed {summary['seed']}, {summary['duration_s']:g} s, {summary['jacobian']} Jacobian; "
        f"{locked}. Minimized: {minimized}.",
        "",
        *(f"Loop {name}: {loop['sentence']}." for name, loop in summary["loops"].items()),
    ]
    # The paper's numbers are of the whole spiral.
    sources = {"linear model": "predicted"} | ({} if is_cut(summary) else {"paper": "paper"})
    beside = {
        source: (column[f"{key}_alpha_rms_urad"], column[f"{key}_beta_rms_urad"])
        for source, key in sources.items()
    }
    return run_notes(column["name"], said, run, beside, properties)
