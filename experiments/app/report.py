"""The command `fjh report`: the main studies, one after another, on one page."""

import shlex
from collections.abc import Sequence
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

from experiments.app.chapter import Chapter, Edition, former_entry, run_chapter
from experiments.app.command import show, with_options
from experiments.studies import studies
from experiments.study.files import published, usable_folder, write_index
from experiments.study.interrupts import INTERRUPTION
from experiments.study.page import named_versions, rendered
from experiments.study.results import Results
from experiments.study.study import Interrupted, NotInstalled, Progress, Unsound
from experiments.study.tables import Column, tabulate
from experiments.study.terminal import Ending, print_ending, progress

INDEX = "report.json"

HELP = """Run the main studies and write one HTML page on all of them.

For each study the page has tables, figures, the result of its checks, and the command that
reproduces it; at the end computer, versions and commit. It needs no other file. An estimated two
hours on two cores; track and atlas are left out. The last chapter, bench, measures times:
do nothing else on the computer meanwhile. Where its packages are not installed it is left out, and
the page says so.

After Ctrl-C the same command continues, within a sweep with the missing runs. A chapter is run
again only if its files, its options, the code, the package versions or the processor have changed.
The page is rewritten after every chapter. If a check of a chapter fails, the other chapters are run
nevertheless.

Writes report.json, report.html, and a folder for each chapter with the files of its own command and
chapter.json, from which a later report recognizes the chapter.

Example: fjh report --quick --out /tmp/report
"""


def chapters() -> tuple[Chapter, ...]:
    """The studies of the report, in its order."""
    return tuple(Chapter(study) for study in studies() if study.in_report is not None)


def _report(*, out: Path, seed: int, quick: bool, quiet: bool, json: bool) -> None:
    edition = Edition(usable_folder(out), seed, quick, _origin())
    summary = run_report(chapters(), edition, partial(progress, shown=not quiet))
    columns = (
        Column("", "name"),
        Column("checks", lambda chapter: "failed" if chapter["complaint"] else "passed"),
        Column("time", lambda chapter: span(chapter["wall_time_s"])),
    )
    entries = summary["chapters"]
    tables = [tabulate("All studies", columns, entries)]
    left_out = [f"{name} is left out, since {why}." for name, why in summary["left_out"].items()]
    show(Results(summary, tables, left_out), quiet=quiet, json=json)
    failed = [f"{each['name']}: {each['complaint']}" for each in entries if each["complaint"]]
    if not (quiet or json):
        checked = f"{len(failed)} of {len(entries)} studies failed: {'; '.join(failed)}."
        if not failed:
            checked = f"All checks passed ({len(entries)} studies)."
        following = "fjh report" if quick else "fjh track --help"  # the whole; a robot of one's own
        print_ending(Ending(checked, out / "report.html", following))
    if failed:
        raise Unsound(f"a study failed: {'; '.join(failed)}")


QUICK = "Every study with its own --quick: 5 minutes."
report = with_options(_report, "report", HELP, seed="every study", quick=QUICK)


def run_report(chapters: Sequence[Chapter], edition: Edition, progress: Progress) -> dict[str, Any]:
    """Run every chapter that is not complete in its folder; `report.html` grows with each.

    A chapter whose study needs a package that is not installed is left out.

    Returns:
        The contents of `report.json`.

    Raises:
        Interrupted: By Ctrl-C; finished chapters are whole and on the page.
        OutputError: The disk or the folder refuses.
    """
    former = {chapter.name: former_entry(chapter, edition) for chapter in chapters}
    entries = {name: entry for name, entry in former.items() if entry}
    left_out: dict[str, str] = {}
    summary: dict[str, Any] = {}
    for k, chapter in enumerate(chapters, 1):
        if chapter.name not in entries:
            try:
                entries[chapter.name] = run_chapter(
                    chapter, edition, lambda work, k=k: progress(f"{k}/{len(chapters)} {work}")
                )
            except NotInstalled as absent:
                left_out[chapter.name] = str(absent)
            except (KeyboardInterrupt, Interrupted):
                raise Interrupted(
                    f"{INTERRUPTION}; finished chapters stay, and the same command continues with "
                    f"{chapter.name}, chapter {k} of {len(chapters)}"
                ) from None
        summary = _publish(chapters, entries, left_out, edition)
    return summary


def _origin() -> dict[str, Any]:
    """All that distinguishes one report from another with the same options."""
    from experiments.study import provenance  # late: the help text does not wait for these imports
    from sim import model_sha256

    return {
        "versions": provenance.versions(),
        "model_sha256": model_sha256(),
        "machine": provenance.machine(),
        "commit": provenance.commit(),
        "code_sha256": provenance.code_sha256(),
    }


def _publish(
    chapters: Sequence[Chapter],
    entries: dict[str, dict[str, Any]],
    left_out: dict[str, str],
    edition: Edition,
) -> dict[str, Any]:
    """Write page and index of the chapters that are finished; returns the index."""
    quick = ["--quick"] if edition.quick else []
    options = [*quick, "--seed", str(edition.seed), "--out", str(edition.folder)]
    summary = {
        "experiment": "report",
        "seed": edition.seed,
        "quick": edition.quick,
        "command": shlex.join(["fjh", "report", *options]),
        **edition.origin,
        "written": datetime.now(UTC).isoformat(timespec="seconds"),
        "missing": [each.name for each in chapters if each.name not in entries | left_out],
        "left_out": left_out,
        "chapters": [entries[chapter.name] for chapter in chapters if chapter.name in entries],
    }
    with published(edition.folder, index=INDEX) as staging:
        (staging / "report.html").write_text(page(summary, edition.folder), encoding="utf-8")
        return write_index(staging / INDEX, summary)


def page(summary: dict[str, Any], folder: Path) -> str:
    """The contents of `report.json` as HTML, with the figures that lie below `folder` inside."""
    machine = summary["machine"]
    cores = f"{machine['cores']} cores, {machine['threads']} threads"
    origin = {
        "processor": f"{machine['processor']}; {cores}",
        "memory": f"{machine['memory_gib']} GiB",
        "system": machine["system"],
        "versions": named_versions(summary["versions"]),
        "commit": summary["commit"],
        "code": f"SHA-256 {summary['code_sha256']}",
        "hexapod": f"SHA-256 of fjh.xml {summary['model_sha256']}",
        "seed": summary["seed"],
        "written": when(summary["written"]),
    }
    shown = {"report": summary, "folder": folder, "origin": origin, "span": span, "when": when}
    return rendered("experiments.app", "report.html.j2", **shown)


def when(moment: str) -> str:
    """A time of day in ISO 8601, to the minute, for people."""
    return f"{datetime.fromisoformat(moment):%Y-%m-%d %H:%M %Z}"


def span(seconds: float) -> str:
    """A duration for people."""
    if seconds < 100:
        return f"{seconds:.0f} s"
    return f"{seconds // 60:.0f} min {seconds % 60:.0f} s"
