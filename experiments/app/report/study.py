"""Run what is missing of a report, and tell all of it after every chapter."""

import shlex
from collections.abc import Sequence
from contextlib import AbstractContextManager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from experiments.app.report.chapter import Chapter, Edition, former_entry, run_chapter
from experiments.app.report.page import page
from experiments.output.files import published, write_index
from experiments.output.provenance import origin
from experiments.output.study import Interrupted, OnProgress, Progress
from experiments.output.terminal import INTERRUPTION as SENTENCE

INDEX = "report.json"


def run_report(
    folder: Path, chapters: Sequence[Chapter], *, seed: int, quick: bool, progress: Progress
) -> dict[str, Any]:
    """Run every chapter that is not complete in the folder; `report.html` grows with each.

    Args:
        folder: Where page and index go, and below it a folder for each chapter.
        chapters: In reading order.
        seed: Of every study.
        quick: Short runs.
        progress: Shows the running study, with its number in front.

    Returns:
        The contents of `report.json`.

    Raises:
        Interrupted: By Ctrl-C; finished chapters are whole and told.
        OutputError: The disk or the folder refuses.
    """
    edition = Edition(folder, seed, quick, origin())
    former = {chapter.name: former_entry(chapter, edition) for chapter in chapters}
    entries = {name: entry for name, entry in former.items() if entry}
    summary: dict[str, Any] = {}
    for k, chapter in enumerate(chapters, 1):
        if chapter.name not in entries:
            try:
                shown = _numbered(progress, f"{k}/{len(chapters)} ")
                entries[chapter.name] = run_chapter(chapter, edition, shown)
            except KeyboardInterrupt:
                raise Interrupted(
                    f"{SENTENCE}; finished chapters stay, and the same command goes on with "
                    f"{chapter.name}, chapter {k} of {len(chapters)}"
                ) from None
        summary = _publish(chapters, entries, edition)
    return summary


def _publish(
    chapters: Sequence[Chapter], entries: dict[str, dict[str, Any]], edition: Edition
) -> dict[str, Any]:
    switches = ["--quick"] if edition.quick else []
    options = ["--seed", str(edition.seed), "--out", str(edition.folder)]
    summary = {
        "experiment": "report",
        "seed": edition.seed,
        "quick": edition.quick,
        "command": shlex.join(["fjh", "report", *switches, *options]),
        **edition.origin,
        "written": datetime.now(UTC).isoformat(timespec="seconds"),
        "missing": [chapter.name for chapter in chapters if chapter.name not in entries],
        "chapters": [entries[chapter.name] for chapter in chapters if chapter.name in entries],
    }
    with published(edition.folder, index=INDEX) as staging:
        (staging / "report.html").write_text(page(summary, edition.folder), encoding="utf-8")
        return write_index(staging / INDEX, summary)


def _numbered(progress: Progress, number: str) -> Progress:
    def shown(work: str) -> AbstractContextManager[OnProgress]:
        return progress(number + work)

    return shown
