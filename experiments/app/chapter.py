"""One chapter of the report: a study that is run, or found complete from a former report."""

import hashlib
import json
import shlex
import time
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from inspect import cleandoc
from pathlib import Path
from typing import Any

from experiments.app.command import conduct
from experiments.study.files import published, write_json
from experiments.study.results import Results
from experiments.study.study import Progress, Study, Unsound

ENTRY = "chapter.json"


@dataclass(frozen=True)
class Edition:
    """What all chapters share: a folder with one for each, seed, short runs or not.

    The origin is that of the report's beginning: code, versions, machine.
    """

    folder: Path
    seed: int
    quick: bool
    origin: dict[str, Any]


@dataclass(frozen=True)
class Chapter:
    """A study of the report."""

    study: Study

    @property
    def switches(self) -> dict[str, bool]:
        """Those of the study's options that are not as by default."""
        return self.study.in_report or {}

    @property
    def name(self) -> str:
        """That of the command."""
        return self.study.name

    @property
    def question(self) -> list[str]:
        """What the study asks, and how: the first two paragraphs of its help."""
        paragraphs = cleandoc(self.study.help).split("\n\n")
        return [" ".join(paragraph.split()) for paragraph in paragraphs[:2]]

    def command(self, edition: Edition) -> str:
        """The command line that gives the same numbers."""
        words = self.study.words(seed=edition.seed, quick=edition.quick, **self.switches)
        return shlex.join([*words, "--out", str(edition.folder / self.name)])

    def arguments(self, edition: Edition) -> dict[str, Any]:
        """All options of the study's runs; unfinished runs in the chapter's folder are used."""
        given = {option.name: option.default for option in self.study.options} | self.switches
        if self.study.streams:
            given["resume"] = None
        return {"seed": edition.seed, "quick": edition.quick, **given}

    def basis(self, edition: Edition) -> dict[str, Any]:
        """All that the numbers depend on; unchanged by writing it as JSON and reading it."""
        return {
            "options": {"seed": edition.seed, "quick": edition.quick, **self.switches},
            "code_sha256": edition.origin["code_sha256"],
            "versions": edition.origin["versions"],
            "processor": edition.origin["machine"]["processor"],
        }


def run_chapter(chapter: Chapter, edition: Edition, progress: Progress) -> dict[str, Any]:
    """Run the study into its folder.

    Returns:
        Its entry in `report.json`; kept in the folder, too, unless the study diverged.
    """
    out, start = edition.folder / chapter.name, time.perf_counter()
    try:
        results = conduct(chapter.study, out, progress, **chapter.arguments(edition))
        complaint = results.failed_check
    except Unsound as unsound:  # it diverged: there are no results
        results, complaint = Results({}), str(unsound)
    files = results.summary.get("files", [])
    entry = {
        "name": chapter.name,
        "question": chapter.question,
        "command": chapter.command(edition),
        "basis": chapter.basis(edition),
        "model_sha256": results.summary.get("model_sha256"),
        "finished": datetime.now(UTC).isoformat(timespec="seconds"),
        "wall_time_s": round(time.perf_counter() - start, 1),
        "complaint": complaint,
        "tables": [asdict(table) for table in results.tables],
        "notes": list(results.notes),
        "pictures": [
            {"file": picture.file, "caption": picture.caption, "alt": picture.alt}
            for picture in results.pictures
        ],
        "recordings": [file for file in files if file.endswith(".rrd")],
        "wrote": files,  # not `files`, which `published` would remove with this entry
        "index_sha256": _index_sha256(out, chapter.name),
    }
    if files:
        with published(out, index=ENTRY) as staging:
            write_json(staging / ENTRY, entry)
    return entry


def former_entry(chapter: Chapter, edition: Edition) -> dict[str, Any] | None:
    """The entry of a former report, if running the chapter again would only repeat it.

    It depended on the same things, and all that it wrote is there, its index unchanged.
    """
    out = edition.folder / chapter.name
    try:
        entry = json.loads((out / ENTRY).read_bytes())
        holds = (
            entry["basis"] == chapter.basis(edition)
            and entry["index_sha256"] == _index_sha256(out, chapter.name)
            and all((out / file).is_file() for file in entry["wrote"])
        )
    except (OSError, ValueError, LookupError, TypeError):
        return None  # there is none, or it is not one that we wrote
    return entry | {"command": chapter.command(edition)} if holds else None


def _index_sha256(out: Path, name: str) -> str | None:
    """SHA-256 of a study's index; None if there is none."""
    try:
        return hashlib.sha256((out / f"{name}.json").read_bytes()).hexdigest()
    except OSError:
        return None
