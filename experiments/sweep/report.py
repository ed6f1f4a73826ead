"""Everything that `fjh sweep` leaves in its folder."""

from pathlib import Path
from typing import Any

from experiments.output.files import published, write_index
from experiments.output.plotting import save_figure
from experiments.sweep.design import Design
from experiments.sweep.figure import figure_sweep
from experiments.sweep.merged import merge
from experiments.sweep.study import Ran
from experiments.sweep.summary import Columns, summarize
from experiments.sweep.text import findings


def write(folder: Path, ran: Ran, design: Design) -> dict[str, Any]:
    """Write the dataset, now complete, as one file; numbers, table and figure; all or none.

    Returns:
        The contents of `sweep.json`: the summary and the names of all files.

    Raises:
        OutputError: The disk or the folder refuses.
    """
    with published(folder, index="sweep.json") as staging:
        path = staging / "sweep.parquet"
        merge(ran.dataset.files(), path, lambda part: part)
        summary = summarize(ran, design, path)
        save_figure(figure_sweep(Columns(path), summary), staging, "sweep")
        (staging / "sweep.md").write_text(findings(summary).markdown(), encoding="utf-8")
        content = write_index(staging / "sweep.json", summary)
    ran.dataset.remove()
    return content
