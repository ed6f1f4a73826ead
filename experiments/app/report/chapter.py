"""One chapter of the report: a study, run anew or found complete."""

import hashlib
import inspect
import json
import shlex
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from experiments.output.files import published, write_json
from experiments.output.findings import Findings
from experiments.output.study import Progress, Unsound

ENTRY = "chapter.json"


@dataclass(frozen=True)
class Edition:
    """What the chapters of a report share.

    Attributes:
        folder: Each chapter has one of its own below it.
        seed: Of every study.
        quick: Short runs.
        origin: Code, versions and machine, as when the report was begun.
    """

    folder: Path
    seed: int
    quick: bool
    origin: dict[str, Any]


@dataclass(frozen=True)
class Chapter:
    """A study of the report.

    Attributes:
        study: Takes `out`, `seed`, `quick` and `progress`; writes an index of its own name.
        options: Further ones, all of them switches.
    """

    study: Callable[..., Findings]
    options: dict[str, bool] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """As on the command line."""
        return self.study.__name__

    @property
    def question(self) -> list[str]:
        """What the study asks, and how: the first two paragraphs of its help."""
        paragraphs = (inspect.getdoc(self.study) or self.name).split("\n\n")
        return [" ".join(paragraph.split()) for paragraph in paragraphs[:2]]

    def command(self, edition: Edition) -> str:
        """What a person types to get the same numbers."""
        switches = [name for name, on in {"quick": edition.quick, **self.options}.items() if on]
        words = ["fjh", self.name, *(f"--{name}" for name in switches)]
        out = str(edition.folder / self.name)
        return shlex.join([*words, "--seed", str(edition.seed), "--out", out])

    def basis(self, edition: Edition) -> dict[str, Any]:
        """All that the numbers depend on; as JSON it is the same again."""
        return {
            "options": {"seed": edition.seed, "quick": edition.quick, **self.options},
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
    shared = {"seed": edition.seed, "quick": edition.quick}
    try:
        findings = chapter.study(out=out, progress=progress, **shared, **chapter.options)
    except Unsound as unsound:  # it diverged: nothing was found
        findings = Findings({}, [], [], [], str(unsound))
    files = findings.summary.get("files", [])
    entry = {
        "name": chapter.name,
        "question": chapter.question,
        "command": chapter.command(edition),
        "basis": chapter.basis(edition),
        "model_sha256": findings.summary.get("model_sha256"),
        "finished": datetime.now(UTC).isoformat(timespec="seconds"),
        "wall_time_s": round(time.perf_counter() - start, 1),
        "complaint": findings.complaint,
        "tables": [asdict(table) for table in findings.tables],
        "notes": findings.notes,
        "pictures": [asdict(picture) for picture in findings.pictures],
        "recordings": [file for file in files if file.endswith(".rrd")],
        "wrote": files,  # not `files`: these are another index's to remove
        "index_sha256": index_sha256(out, chapter.name),
    }
    if files:
        with published(out, index=ENTRY) as staging:
            write_json(staging / ENTRY, entry)
    return entry


def former_entry(chapter: Chapter, edition: Edition) -> dict[str, Any] | None:
    """The entry of a former report, if running the chapter again would only repeat it.

    It depended on the same things, and all that it wrote is there, its index untouched.
    """
    out = edition.folder / chapter.name
    try:
        entry = json.loads((out / ENTRY).read_bytes())
        holds = (
            entry["basis"] == chapter.basis(edition)
            and entry["index_sha256"] == index_sha256(out, chapter.name)
            and all((out / file).is_file() for file in entry["wrote"])
        )
    except (OSError, ValueError, LookupError, TypeError):
        return None  # there is none, or it is not one that we wrote
    return entry | {"command": chapter.command(edition)} if holds else None


def index_sha256(out: Path, name: str) -> str | None:
    """SHA-256 of a study's index; None if there is none."""
    try:
        return hashlib.sha256((out / f"{name}.json").read_bytes()).hexdigest()
    except OSError:
        return None
