"""Everything that `fjh bench` leaves in its folder."""

from pathlib import Path
from typing import Any

from experiments.benchmark.figure import figure_growth
from experiments.benchmark.text import findings
from experiments.output.files import published, write_index
from experiments.output.plotting import save_figure


def write(folder: Path, summary: dict[str, Any]) -> dict[str, Any]:
    """Write numbers, tables and figure; all of them or none.

    Returns:
        The contents of `bench.json`: the summary and the names of all files.

    Raises:
        OutputError: The disk or the folder refuses.
    """
    with published(folder, index="bench.json") as staging:
        save_figure(figure_growth(summary), staging, "bench")
        (staging / "bench.md").write_text(findings(summary).markdown(), encoding="utf-8")
        return write_index(staging / "bench.json", summary)
