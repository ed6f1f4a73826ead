"""The result of a study as data frames: its numbers, checks, printed tables, figures and files."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from fjh.study.files import published, write_arrays, write_index
from fjh.study.provenance import versions
from sim.mjcf import model_sha256

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MARKUP = re.compile(
    r"[|*`$]|(?<!\w)_|_(?!\w)|<(?=[a-zA-Z/!?])|\[(?=[^]]*\]\()|\\(?=[!-/:-@[-`{-~])"
    r"|&(?=#?\w+;)|~~|^[#>]"
)


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

    @property
    def file(self) -> str:
        """The file that a page shows."""
        return f"{self.name}.{self.formats[0]}"

    def files(self) -> Mapping[str, bytes]:
        """Their contents by name, the same every time."""
        from fjh.study.plotting import printed

        return printed(self.draw(), self.name, self.formats)


@dataclass(frozen=True)
class Shown:
    """A table for people.

    Attributes:
        title: What its rows are.
        frame: A table of the result, or some of its rows.
        columns: Names of the columns that are shown, each with a format after a colon if need be:
            "strategy rms_urad:.0f". Values that are missing leave their cell empty.
        legend: What the columns mean, where title and names do not say it.
    """

    title: str
    frame: pd.DataFrame
    columns: str
    legend: str = ""

    @property
    def headings(self) -> list[str]:
        """Names of the columns; the first has the labels of the rows."""
        return [entry.partition(":")[0] for entry in self.columns.split()]

    def cells(self) -> list[list[str]]:
        """The rows as text."""
        formats = [entry.partition(":")[::2] for entry in self.columns.split()]
        rows = self.frame.to_dict("records")
        return [[_cell(row[name], digits) for name, digits in formats] for row in rows]

    def markdown(self) -> str:
        """The table as Markdown, title and legend included."""
        lines = [self.headings, ["---"] * len(self.headings), *self.cells()]
        table = "\n".join("| " + " | ".join(map(literal, line)) + " |" for line in lines)
        return "\n\n".join(filter(None, (f"## {literal(self.title)}", literal(self.legend), table)))


def _cell(value: Any, digits: str) -> str:
    if value is None or (isinstance(value, float) and np.isnan(value)):
        return ""
    return format(value, digits)


def literal(text: str) -> str:
    """Markdown that shows a text as it is: names are anybody's."""
    return _MARKUP.sub(r"\\\g<0>", text)


@dataclass(frozen=True)
class Result:
    """What a study found; it is sound if all checks passed.

    Attributes:
        settings: What the numbers depend on and rows do not say; units are in the names.
        tables: Data frames by name, a row for each run or condition; units are in the names of
            the columns. The first is that of the runs.
        checks: What must hold for the numbers to be trusted.
        shown: The tables that are printed.
        notes: Sentences below them.
        pictures: The figures.
        arrays: Contents of `.npz` files by file name.
        records: Each writes further files, as recordings, into the folder that it is given.
        found: Results of the whole study, which are in no row; units are in the names.
        rows: Of a study of many runs: a row for each, in NAME.parquet alone.
    """

    settings: Mapping[str, Any]
    tables: Mapping[str, pd.DataFrame] = field(default_factory=dict)
    checks: Sequence[Check] = ()
    shown: Sequence[Shown] = ()
    notes: Sequence[str] = ()
    pictures: Sequence[Picture] = ()
    arrays: Mapping[str, Mapping[str, NDArray[Any]]] = field(default_factory=dict)
    records: Sequence[Callable[[Path], None]] = ()
    found: Mapping[str, Any] = field(default_factory=dict)
    rows: pd.DataFrame | None = None

    def summary(self, name: str) -> dict[str, Any]:
        """The contents of the JSON file of the study of this name: each table is its rows."""
        dataset = {} if self.rows is None else {"dataset": f"{name}.parquet"}
        return {
            "experiment": name,
            "settings": list(self.settings),
            **dataset,
            **plain(dict(self.settings)),
            **{key: records_of(frame) for key, frame in self.tables.items()},
            **plain(dict(self.found)),
            "checks": [plain(check.row()) for check in self.checks],
        }

    @property
    def failed(self) -> list[str]:
        """A sentence on each check that failed."""
        return [str(check) for check in self.checks if not check.passed]

    @property
    def checked(self) -> str:
        """One sentence on all checks: that they passed, or which failed."""
        if failed := self.failed:
            return f"{len(failed)} of {len(self.checks)} checks failed: {'; '.join(failed)}."
        return f"All checks passed ({len(self.checks)})." if self.checks else "Nothing is checked."

    def markdown(self) -> str:
        """Tables, notes and figures as a page."""
        notes = "\n".join(f"- {literal(note)}" for note in self.notes)
        figures = [
            f"![{literal(each.alt)}]({each.file})\n\n{literal(each.caption)}"
            for each in self.pictures
        ]
        parts = [*(each.markdown() for each in self.shown), notes, *figures]
        return "\n\n".join(part for part in parts if part) + "\n"

    def publish(
        self,
        name: str,
        folder: Path,
        on_progress: Callable[[int, int], None] = lambda done, total: None,
    ) -> dict[str, Any]:
        """Write NAME.json, NAME.md, Parquet, figures, data and recordings: all of them, or none.

        Args:
            name: Of the study.
            folder: Where to.
            on_progress: Called with the written and the total number of recordings and figures.

        Returns:
            The contents of the JSON file, which name all files.

        Raises:
            OutputError: The disk or the folder refuses.
        """
        frames = {f"{name}_{key}": frame for key, frame in self.tables.items()}
        if self.rows is not None:
            frames[name] = self.rows
        total = len(self.pictures) + len(self.records)
        with published(folder, index=f"{name}.json") as staging:
            for file, arrays in self.arrays.items():
                write_arrays(staging / file, dict(arrays))
            for file, frame in frames.items():
                frame.to_parquet(staging / f"{file}.parquet", index=False)
            for done, picture in enumerate(self.pictures):
                on_progress(done, total)
                for file, content in picture.files().items():
                    (staging / file).write_bytes(content)
            for done, record in enumerate(self.records, len(self.pictures)):
                on_progress(done, total)
                record(staging)
            (staging / f"{name}.md").write_text(self.markdown(), encoding="utf-8")
            return write_index(staging / f"{name}.json", self.summary(name))


def origin(seed: int, **models: Path) -> dict[str, Any]:
    """Settings that every result has: seed, versions of packages, SHA-256 of the machine file.

    Args:
        seed: Of all that is random in the study.
        models: Further machine files by name; then the SHA-256 are by name, the hexapod's `fjh`.
    """
    own = model_sha256()
    found = {"fjh": own} | {name: model_sha256(file) for name, file in models.items()}
    return {"seed": seed, "versions": versions(), "model_sha256": found if models else own}


def check(what: str, values: Any, below: float, where: str = "") -> list[Check]:
    """Checks that numbers stay below a limit; one that is NaN fails.

    Args:
        what: The number, with its unit in brackets.
        values: A number, or a series whose index says where each is from.
        below: The limit.
        where: Where a single number is from, or what stands before the index.
    """
    if isinstance(values, pd.Series):
        places = [index if isinstance(index, tuple) else (index,) for index in values.index]
        names = [", ".join(filter(None, (where, *map(str, each)))) for each in places]
        return [
            Check(what, name, float(value), below)
            for name, value in zip(names, values, strict=True)
        ]
    return [Check(what, where, float(values), below)]


def records_of(frame: pd.DataFrame) -> list[dict[str, Any]]:
    """The rows of a data frame, ready for JSON: what is missing is None."""
    return [plain(row) for row in frame.to_dict("records")]


def plain(value: Any) -> Any:
    """The value in types of Python: None for NaN, lists for arrays."""
    if isinstance(value, Mapping):
        return {str(key): plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [plain(each) for each in value]
    if isinstance(value, np.generic):
        value = value.item()
    return None if value is pd.NA or (isinstance(value, float) and np.isnan(value)) else value
