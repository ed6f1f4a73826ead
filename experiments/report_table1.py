"""Everything that `fjh table1` leaves in its folder."""

from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

from experiments import figures
from experiments.files import write_arrays, write_json, write_text, write_whole
from experiments.recording import write_recording
from experiments.summary import summarize
from experiments.table1 import Table1
from experiments.table_text import markdown
from sim import model_sha256

FIGURES = {
    "figure4.png": figures.figure_4,
    "figure5.png": figures.figure_5,
    "figure6.png": figures.figure_6,
}


def write(folder: Path, table: Table1, mjcf: Path | None) -> dict[str, Any]:
    """Write data, recordings, figures and tables; the JSON, which names them, comes last."""
    summary = summarize(table, model_sha256(mjcf))
    properties = _properties(summary)
    for column in summary["columns"]:
        name = column["name"]
        run, notes = table.trajectories[name], _notes(column, summary)
        write_arrays(folder / column["data"], asdict(run))
        recorder = partial(write_recording, name=name, run=run, notes=notes, properties=properties)
        write_whole(folder / column["recording"], recorder)
    for name, draw in FIGURES.items():
        write_whole(folder / name, partial(draw(table.trajectories).savefig, dpi=150))
    write_text(folder / "table1.md", markdown(summary))
    write_json(folder / "table1.json", summary)
    return summary


def _properties(summary: dict[str, Any]) -> dict[str, Any]:
    """What makes a recording self-describing, flat as Rerun's properties are."""
    plain = {key: summary[key] for key in ("seed", "model_sha256", "jacobian")}
    packages = {
        f"version_{name.replace('-', '_')}": value for name, value in summary["versions"].items()
    }
    return plain | packages | summary["bench"]


def _notes(column: dict[str, Any], summary: dict[str, Any]) -> str:
    """The run in words, shown beside its plots."""
    locked = ", ".join(f"strut {k + 1}" for k in column["locked"]) or "none"
    rows = [
        ("alpha", "alpha_rms_urad"),
        ("beta", "beta_rms_urad"),
    ]
    lines = [
        f"# {column['name']}",
        "",
        f"Seed {summary['seed']}, {summary['duration_s']:g} s, {summary['jacobian']} Jacobian; "
        f"locked: {locked}.",
        "",
        "| RMS, urad | here | linear model | paper |",
        "| --- | --- | --- | --- |",
        *(
            f"| {angle} | {column[key]:.4f} | {column[f'predicted_{key}']:.4f} "
            f"| {column[f'paper_{key}']:.4f} |"
            for angle, key in rows
        ),
        "",
        f"Largest closure residual {column['closure_residual_max_m']:.1e} m.",
    ]
    return "\n".join(lines)
