"""What came out of a study: its numbers, their checks, and tables, sentences and figures of them.

The terminal, the Markdown files, the recordings' notes and `fjh report` all show this one
description; :func:`publish` writes all files of a study, or none.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments.study.files import published, write_arrays, write_index
from experiments.study.tables import Table, literal

if TYPE_CHECKING:  # the help text need not wait for these imports
    import pandas as pd
    from matplotlib.figure import Figure
    from numpy.typing import NDArray


@dataclass(frozen=True)
class Check:
    """One number that must stay below its limit for the study to be trusted; NaN fails."""

    what: str  # with its unit
    where: str  # in which run or condition
    value: float
    limit: float

    @property
    def passed(self) -> bool:
        """Whether the value is below the limit."""
        return bool(self.value < self.limit)

    def row(self) -> dict[str, Any]:
        """The check for JSON; a value that is no number is None."""
        value = self.value if isfinite(self.value) else None
        return asdict(self) | {"value": value, "passed": self.passed}

    def __str__(self) -> str:
        return f"{self.where}: {self.what} is {self.value:.3g}, expected below {self.limit:.3g}"


@dataclass(frozen=True)
class Picture:
    """A figure of the study."""

    name: str  # of its files, without ending
    caption: str
    alt: str  # what there is to see, for a reader who cannot
    draw: "Callable[[], Figure]"
    formats: tuple[str, ...] = ("png", "pdf")  # a page shows the first
    printed: Mapping[str, bytes] | None = None  # its files by name, if they are made

    @property
    def file(self) -> str:
        """The file that a page shows."""
        return f"{self.name}.{self.formats[0]}"

    def files(self) -> Mapping[str, bytes]:
        """Their contents by name, the same every time."""
        from experiments.study.plotting import printed

        return self.printed or printed(self.draw(), self.name, self.formats)


@dataclass(frozen=True)
class Results:
    """What came out of a study; it is sound if all checks passed.

    `arrays` are the contents of `.npz` files, by file name; `frames` those of `.parquet` files, by
    what stands in their names after that of the study; each of the `records` writes further
    files, a run's data and its recording, into a folder that has these and the figures already.
    Nothing is written if a former run has `published` all of it.
    """

    summary: dict[str, Any]  # all numbers, as in its JSON file; units in the names
    tables: Sequence[Table] = ()
    notes: Sequence[str] = ()  # sentences below the tables
    checks: Sequence[Check] = ()
    pictures: Sequence[Picture] = ()
    arrays: "Mapping[str, Mapping[str, NDArray[Any]]]" = field(default_factory=dict)
    frames: "Mapping[str, pd.DataFrame]" = field(default_factory=dict)
    records: Sequence[Callable[[Path], None]] = ()
    published: bool = False
    caveat: str | None = None  # a sentence without which nobody is to read that checks passed

    @property
    def failed_check(self) -> str | None:
        """One sentence on the first check that failed; None where all passed."""
        return next((str(check) for check in self.checks if not check.passed), None)

    @property
    def checked(self) -> str:
        """One sentence on all checks: that they passed, or which failed."""
        if not self.checks:
            return "There is nothing to be checked."
        if failed := [str(check) for check in self.checks if not check.passed]:
            return f"{len(failed)} of {len(self.checks)} checks failed: {'; '.join(failed)}."
        passed = f"All checks passed ({len(self.checks)})."
        return passed if self.caveat is None else f"{self.caveat} {passed}"

    def markdown(self) -> str:
        """Tables and notes as a page."""
        parts = []
        for table in self.tables:
            parts += [f"## {literal(table.title)}", literal(table.legend), table.markdown()]
        parts.append("\n".join(f"- {literal(note)}" for note in self.notes))
        return "\n\n".join(part for part in parts if part) + "\n"


def publish(
    folder: Path,
    name: str,
    results: Results,
    on_progress: Callable[[int, int], None] = lambda done, total: None,
) -> Results:
    """Write `name.json`, `name.md`, figures, data and recordings; all of them or none.

    Args:
        folder: Where to.
        name: Of the study.
        results: What is written.
        on_progress: Called with the written and the total number of recordings and figures.

    Returns:
        The results, the names of all files in their summary.

    Raises:
        OutputError: The disk or the folder refuses.
    """
    if results.published:
        return results
    with published(folder, index=f"{name}.json") as staging:
        for file, arrays in results.arrays.items():
            write_arrays(staging / file, dict(arrays))
        for key, frame in results.frames.items():
            frame.to_parquet(staging / f"{name}_{key}.parquet", index=False)
        total = len(results.records) + len(results.pictures)
        for done, picture in enumerate(results.pictures):
            on_progress(done, total)
            for file, content in picture.files().items():
                (staging / file).write_bytes(content)
        for done, record in enumerate(results.records, len(results.pictures)):
            on_progress(done, total)
            record(staging)
        (staging / f"{name}.md").write_text(results.markdown(), encoding="utf-8")
        summary = {"checks": [check.row() for check in results.checks]} | results.summary
        return replace(results, summary=write_index(staging / f"{name}.json", summary))
