"""Everything that `fjh table1` leaves in its folder."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

from experiments.files import published, write_arrays, write_json
from experiments.provenance import recording_properties
from experiments.recording import write_recording
from experiments.table1 import figures
from experiments.table1.study import Table1
from experiments.table1.text import markdown

FIGURES = {
    "figure4.png": figures.figure_4,
    "figure5.png": figures.figure_5,
    "figure6.png": figures.figure_6,
}


def write(folder: Path, table: Table1, summary: dict[str, Any]) -> None:
    """Write data, recordings, figures and tables; all of them or none.

    Raises:
        OutputError: The disk or the folder refuses.
    """
    properties = recording_properties(summary)
    with published(folder, index="table1.json") as staging:
        for column in summary["columns"]:
            name = column["name"]
            run = table.trajectories[name]
            write_arrays(staging / column["data"], asdict(run))
            recording_id = f"table1-{name}-seed{table.seed}"
            write_recording(
                staging / column["recording"],
                recording_id,
                name,
                run,
                _notes(column, summary),
                properties,
            )
        for name, draw in FIGURES.items():
            draw(table.trajectories).savefig(staging / name, dpi=150)
        (staging / "table1.md").write_text(markdown(summary), encoding="utf-8")
        write_json(staging / "table1.json", summary)


def _notes(column: dict[str, Any], summary: dict[str, Any]) -> str:
    """The run in words, shown beside its plots."""
    locked = ", ".join(f"strut {k + 1}" for k in column["locked"]) or "none"
    lines = [
        f"# {column['name']}",
        "",
        f"Seed {summary['seed']}, {summary['duration_s']:g} s, {summary['jacobian']} Jacobian; "
        f"locked: {locked}.",
        "",
        "| RMS, urad | here | linear model | paper |",
        "| --- | --- | --- | --- |",
        *(
            f"| {angle} | {column[f'{angle}_rms_urad']:.4f} "
            f"| {column[f'predicted_{angle}_rms_urad']:.4f} "
            f"| {column[f'paper_{angle}_rms_urad']:.4f} |"
            for angle in ("alpha", "beta")
        ),
        "",
        f"Largest closure residual {column['closure_residual_max_m']:.1e} m.",
    ]
    return "\n".join(lines)
