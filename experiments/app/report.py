"""Command `fjh paper report`, which runs all studies and puts them on one page."""

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
from experiments.app.terminal import print_summary
from experiments.studies import LINES, PAPER, command_of, study
from fjh.study.errors import Interrupted, Unsound
from fjh.study.files import published, usable_folder, write_index
from fjh.study.interrupts import INTERRUPTION
from fjh.study.option import Option, Study, command_arguments, seed_of
from fjh.study.page import data_uri, rendered, version_text

INDEX = "report.json"
MODELS = Path(__file__).parents[2] / "models"  # without the import of MuJoCo by `sim`

STUDIES: dict[str, tuple[str, dict[str, Any]]] = {name: (name, {}) for name in (*PAPER, "survey")}
"""Studies, by chapter, with options that differ from their defaults; a chapter is a folder."""
STUDIES["jacobian"] = ("jacobian", {"loop": True})
LOCK = {"major": (3, 5, 4), "size": 0.015, "fail": ["motor2:locked@3.25"], "duration": 6.5}
"""Options of the run of docs/pictures/animation.gif: the arm's shoulder locks."""
STUDIES["lock"] = ("track", {"model": MODELS / "arm.xml", **LOCK})
STUDIES["events"] = ("recover", {"events": True})
ROBOTS = {"platform": (3, 4), "hand": (3, 4), "arm": (0, 1), "arms": (3, 4, 5)}
"""Major rows of the bundled robots on which failures and events are simulated."""
for _robot, _rows in ROBOTS.items():
    _options = {"model": MODELS / f"{_robot}.xml", "major": _rows}
    STUDIES[_robot] = ("recover", _options)
    if _robot in ("arm", "hand"):
        STUDIES[f"{_robot}_events"] = ("recover", {**_options, "events": True})


def report(
    *,
    seed: Annotated[int, seed_of("every study")] = 0,
    quick: Annotated[bool, Option(help="Every study with its own --quick: 8 minutes.")] = False,
    out: Out = Path("results", "report"),
    quiet: Quiet = False,
) -> None:
    """Run all studies and write one HTML page on them.

    The page is a single file with the tables, figures and checks of each study, the command that
    reproduces it, and at the end computer, versions and commit. Takes about two hours on two cores.

    After Ctrl-C the same command continues, also within a sweep. A finished study is run again only
    if its files, the options, the code, the package versions or the processor have changed. The
    page is rewritten after every study. If a check fails, the other studies are run nevertheless.

    Writes report.json, report.html, and a folder for each study with the files of its command.

    Example: fjh paper report --quick --out /tmp/report
    """
    usable_folder(out)
    summary = run_report(STUDIES, out, seed=seed, quick=quick, show=not quiet)
    complaints = {entry["name"]: entry["complaint"] for entry in summary["chapters"]}
    failed = "; ".join(f"{name}: {text}" for name, text in complaints.items() if text)
    if not quiet:
        following = "fjh paper report" if quick else "fjh track --help"
        passed = f"All checks passed ({len(complaints)} studies)."
        checked = f"Failed: {failed}." if failed else passed
        print_summary(checked, out / "report.html", following)
    if failed:
        raise Unsound(f"a study failed: {failed}")


def run_report(
    studies: Mapping[str, tuple[str, Mapping[str, Any]]],
    folder: Path,
    *,
    seed: int,
    quick: bool,
    show: bool,
) -> dict[str, Any]:
    """Run every study that is not complete in the folder; return the contents of `report.json`.

    Raises:
        Interrupted: Ctrl-C was pressed; finished studies are on the page.
        OutputError: The folder cannot be written.
    """
    from fjh.study import provenance  # late, as the help text must not wait for these imports

    basis = {"seed": seed, "quick": quick, "code_sha256": provenance.code_sha256()}
    basis |= {"versions": provenance.versions(), "machine": provenance.machine()}
    entries = _former(folder, basis)
    summary: dict[str, Any] = {}
    for k, (name, (which, options)) in enumerate(studies.items(), 1):
        if name not in entries:
            values, label = {"seed": seed, "quick": quick, **options}, f"{k}/{len(studies)} {name}"
            try:
                ran = _run(which, folder / name, values, label, show)
                entries[name] = {"name": name, "study": which, **ran}
            except (KeyboardInterrupt, Interrupted):
                where = f"{name}, study {k} of {len(studies)}"
                again = f"finished studies are saved, and the same command continues with {where}"
                raise Interrupted(f"{INTERRUPTION}; {again}") from None
        summary = {
            "experiment": "report",
            "command": _command(report, basis, folder),
            **basis,
            "commit": provenance.commit(),
            "written": datetime.now(UTC).isoformat(timespec="seconds"),
            "missing": [other for other in studies if other not in entries],
            "chapters": [entries[other] for other in studies if other in entries],
        }
        with published(folder, index=INDEX) as staging:
            (staging / "report.html").write_text(page(summary, folder), encoding="utf-8")
            summary = write_index(staging / INDEX, summary)
    return summary


def _run(
    name: str, folder: Path, values: Mapping[str, Any], label: str, show: bool
) -> dict[str, Any]:
    function, start = study(name), time.perf_counter()
    try:
        # Unfinished runs of the same study are continued.
        run_options = {"resume": None, "show": show, "name": label}
        result, summary = conduct(function, folder, **run_options, **values)
        complaint, files = "; ".join(result.failed), summary["files"]
    except Unsound as unsound:  # it diverged: there are no results
        complaint, files = str(unsound), []
    return {
        "command": _command(function, values, folder),
        "finished": datetime.now(UTC).isoformat(timespec="seconds"),
        "wall_time_s": round(time.perf_counter() - start, 1),
        "complaint": complaint,
        "wrote": files,
    }


def _command(function: Study, values: Mapping[str, Any], folder: Path) -> str:
    arguments = [*command_of(function.__name__), *command_arguments(function, values)]
    return shlex.join([*arguments, "--out", str(folder)])


def _former(folder: Path, basis: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Return the still valid entries of an earlier report, by name."""
    try:
        former = json.loads((folder / INDEX).read_bytes())
        same = {key: former[key] for key in basis} == basis
        entries = {entry["name"]: entry for entry in former["chapters"] if same and entry["wrote"]}
        return {
            name: entry
            for name, entry in entries.items()
            if all((folder / name / file).is_file() for file in entry["wrote"])
        }
    except (OSError, ValueError, LookupError, TypeError):
        return {}  # there is no earlier report, or it has another format


def page(summary: Mapping[str, Any], folder: Path) -> str:
    """Return `report.json` as HTML, with the pages of all studies and embedded figures."""
    from markdown_it import MarkdownIt  # late, as above

    markdown = MarkdownIt("commonmark", {"html": False}).enable("table")

    def body(chapter: Mapping[str, Any]) -> str:
        """Return the page of a chapter's study as HTML, with embedded figures."""
        files = folder / chapter["name"]
        html = markdown.render((files / f"{chapter['study']}.md").read_text())
        html = html.replace("h2>", "h3>")
        return re.sub(r'src="([^"/:]+)"', lambda match: f'src="{data_uri(files / match[1])}"', html)

    def about(name: str) -> str:
        """Return the second paragraph of a study's help, on its method and duration."""
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
    context = {"report": summary, "origin": origin, "lines": LINES, "about": about, "body": body}
    return rendered("experiments.app", "report.html.j2", span=span, when=when, **context)


def when(moment: str) -> str:
    """Format a time of ISO 8601 for people, to the minute."""
    return f"{datetime.fromisoformat(moment):%Y-%m-%d %H:%M %Z}"


def span(seconds: float) -> str:
    """Format a duration [s] in minutes and seconds."""
    return f"{seconds:.0f} s" if seconds < 100 else f"{seconds // 60:.0f} min {seconds % 60:.0f} s"
