"""The command `fjh paper report`: the main studies, one after another, on one page."""

import inspect
import json
import re
import shlex
import time
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

from experiments.app.command import Out, Quiet, conduct
from experiments.app.terminal import print_ending
from experiments.studies import LINES, PAPER, command_of, study
from fjh.study.errors import Interrupted, Unsound
from fjh.study.files import published, usable_folder, write_index
from fjh.study.interrupts import INTERRUPTION
from fjh.study.option import Option, Study, command_arguments, seed_of
from fjh.study.page import data_uri, rendered, version_text

INDEX = "report.json"

CHAPTERS: dict[str, dict[str, Any]] = {
    name: {} for name in (*PAPER, "survey") if name != "atlas"
} | {"jacobian": {"loop": True}}
"""The studies of the report, in its order, with options that are not as by default."""


def report(
    *,
    seed: Annotated[int, seed_of("every study")] = 0,
    quick: Annotated[bool, Option(help="Every study with its own --quick: 5 minutes.")] = False,
    out: Out = Path("results", "report"),
    quiet: Quiet = False,
) -> None:
    """Run the main studies and write one HTML page on all of them.

    For each study the page has tables, figures, the result of its checks, and the command that
    reproduces it; at the end computer, versions and commit. It needs no other file. An estimated
    two hours on two cores; track and atlas are left out.

    After Ctrl-C the same command continues, within a sweep with the missing runs. A finished
    chapter is run again only if its files, the options, the code, the package versions or the
    processor have changed. The page is rewritten after every chapter. If a check of a chapter
    fails, the others are run nevertheless.

    Writes report.json, report.html, and a folder for each chapter with the files of its command.

    Example: fjh paper report --quick --out /tmp/report
    """
    usable_folder(out)
    summary = run_report(CHAPTERS, out, seed=seed, quick=quick, shown=not quiet)
    found = {each["name"]: each["complaint"] for each in summary["chapters"]}
    failed = "; ".join(f"{name}: {complaint}" for name, complaint in found.items() if complaint)
    if not quiet:
        following = "fjh paper report" if quick else "fjh track --help"  # one's own robot
        checked = f"Failed: {failed}." if failed else f"All checks passed ({len(found)} studies)."
        print_ending(checked, out / "report.html", following)
    if failed:
        raise Unsound(f"a study failed: {failed}")


def run_report(
    chapters: Mapping[str, Mapping[str, Any]], folder: Path, *, seed: int, quick: bool, shown: bool
) -> dict[str, Any]:
    """Run every chapter that is not complete in the folder; the page grows with each.

    Returns:
        The contents of `report.json`.

    Raises:
        Interrupted: By Ctrl-C; finished chapters are whole and on the page.
        OutputError: The disk or the folder refuses.
    """
    from fjh.study import provenance  # late: the help text does not wait for these imports

    basis = {"seed": seed, "quick": quick, "code_sha256": provenance.code_sha256()}
    basis |= {"versions": provenance.versions(), "machine": provenance.machine()}
    entries = _former(folder, basis)
    summary: dict[str, Any] = {}
    for k, (name, options) in enumerate(chapters.items(), 1):
        if name not in entries:
            given, label = {"seed": seed, "quick": quick, **options}, f"{k}/{len(chapters)} {name}"
            try:
                entries[name] = _run(name, folder / name, given, label, shown)
            except (KeyboardInterrupt, Interrupted):
                where = f"{name}, chapter {k} of {len(chapters)}"
                again = f"finished chapters stay, and the same command continues with {where}"
                raise Interrupted(f"{INTERRUPTION}; {again}") from None
        summary = {
            "experiment": "report",
            "command": _command(report, basis, folder),
            **basis,
            "commit": provenance.commit(),
            "written": datetime.now(UTC).isoformat(timespec="seconds"),
            "missing": [each for each in chapters if each not in entries],
            "chapters": [entries[each] for each in chapters if each in entries],
        }
        with published(folder, index=INDEX) as staging:
            (staging / "report.html").write_text(page(summary, folder), encoding="utf-8")
            summary = write_index(staging / INDEX, summary)
    return summary


def _run(
    name: str, folder: Path, given: Mapping[str, Any], label: str, shown: bool
) -> dict[str, Any]:
    """Run a study into its folder; its entry in `report.json`."""
    function, start = study(name), time.perf_counter()
    try:
        # Unfinished runs of the same study are used.
        more = {"resume": None, "shown": shown, "name": label}
        result, summary = conduct(function, folder, **more, **given)
        complaint, files = "; ".join(result.failed), summary["files"]
    except Unsound as unsound:  # it diverged: there are no results
        complaint, files = str(unsound), []
    return {
        "name": name,
        "command": _command(function, given, folder),
        "finished": datetime.now(UTC).isoformat(timespec="seconds"),
        "wall_time_s": round(time.perf_counter() - start, 1),
        "complaint": complaint,
        "wrote": files,
    }


def _command(function: Study, given: Mapping[str, Any], folder: Path) -> str:
    """The command line that gives the same numbers."""
    words = [*command_of(function.__name__), *command_arguments(function, given)]
    return shlex.join([*words, "--out", str(folder)])


def _former(folder: Path, basis: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Chapters of a former report that running again would only repeat, by name."""
    try:
        former = json.loads((folder / INDEX).read_bytes())
        same = {key: former[key] for key in basis} == basis
        found = {each["name"]: each for each in former["chapters"] if same and each["wrote"]}
        return {
            name: each
            for name, each in found.items()
            if all((folder / name / file).is_file() for file in each["wrote"])
        }
    except (OSError, ValueError, LookupError, TypeError):
        return {}  # there is none, or it is not one that we wrote


def page(summary: Mapping[str, Any], folder: Path) -> str:
    """The contents of `report.json` as HTML: the pages of all studies, their figures inside."""
    from markdown_it import MarkdownIt  # late, as above

    markdown = MarkdownIt("commonmark", {"html": False}).enable("table")

    def body(name: str) -> str:
        """The page NAME.md of a study, with its figures inside."""
        its = folder / name
        html = markdown.render((its / f"{name}.md").read_text()).replace("h2>", "h3>")
        return re.sub(r'src="([^"/:]+)"', lambda found: f'src="{data_uri(its / found[1])}"', html)

    def about(name: str) -> str:
        """What the study does, and how long it takes: the second paragraph of its help."""
        return inspect.cleandoc(study(name).__doc__ or "").split("\n\n")[1]

    machine = summary["machine"]
    origin = {
        "processor": f"{machine['processor']}; {machine['cores']} cores",
        "memory": f"{machine['memory_gib']} GiB",
        "system": machine["system"],
        "versions": version_text(summary["versions"]),
        "commit": summary["commit"],
        "code": f"SHA-256 {summary['code_sha256']}",
        "seed": summary["seed"],
    }
    shown = {
        "report": summary,
        "origin": origin,
        "lines": LINES,
        "about": about,
        "body": body,
    }
    return rendered("experiments.app", "report.html.j2", span=span, when=when, **shown)


def when(moment: str) -> str:
    """A time of day in ISO 8601, to the minute, for people."""
    return f"{datetime.fromisoformat(moment):%Y-%m-%d %H:%M %Z}"


def span(seconds: float) -> str:
    """A duration for people."""
    return f"{seconds:.0f} s" if seconds < 100 else f"{seconds // 60:.0f} min {seconds % 60:.0f} s"
