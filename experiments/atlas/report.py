"""Everything that `fjh atlas` leaves in its folder."""

from pathlib import Path
from typing import Any

import pyarrow as pa

from experiments.atlas.conditions import verdict_columns
from experiments.atlas.figure import figure_atlas_flown
from experiments.atlas.summary import summarize
from experiments.atlas.text import findings
from experiments.output.files import published, write_index
from experiments.output.plotting import save_figure
from experiments.sweep.design import Design
from experiments.sweep.merged import merge
from experiments.sweep.study import Ran
from experiments.sweep.summary import Columns


def write(folder: Path, ran: Ran, design: Design) -> dict[str, Any]:
    """Write rows with their verdicts, numbers, table and figure; all of them or none.

    Returns:
        The contents of `atlas.json`: the summary and the names of all files.

    Raises:
        OutputError: The disk or the folder refuses.
    """
    with published(folder, index="atlas.json") as staging:
        path = staging / "atlas.parquet"
        merge(ran.dataset.files(), path, _with_verdicts)
        summary = summarize(ran, design, path)
        save_figure(figure_atlas_flown(Columns(path), summary), staging, "atlas_flown")
        (staging / "atlas.md").write_text(findings(summary).markdown(), encoding="utf-8")
        content = write_index(staging / "atlas.json", summary)
    ran.dataset.remove()
    return content


def _with_verdicts(part: pa.Table) -> pa.Table:
    for name, values in verdict_columns(part["struts"]):
        part = part.append_column(name, values)
    return part
