"""The report in print, from `report.json`."""

from pathlib import Path
from typing import Any

from experiments.app.report.page import span
from experiments.output.findings import Findings, Table


def findings(summary: dict[str, Any], folder: Path) -> Findings:
    """One row for each chapter; what is wrong with any of them."""
    rows = [_row(chapter) for chapter in summary["chapters"]]
    table = Table("All experiments", ("", "verdict", "took"), rows)
    notes = [f"Open {folder / 'report.html'} in a browser."]
    wrong = [
        f"{chapter['name']}: {chapter['complaint']}"
        for chapter in summary["chapters"]
        if chapter["complaint"]
    ]
    return Findings(summary, [table], notes, [], "; ".join(wrong) or None)


def _row(chapter: dict[str, Any]) -> tuple[str, ...]:
    verdict = "unsound" if chapter["complaint"] else "sound"
    return (chapter["name"], verdict, span(chapter["wall_time_s"]))
