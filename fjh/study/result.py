"""Result of a study: data frames, checks, printed tables, figures and files."""

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
from fjh.study.option import OnProgress
from fjh.study.provenance import versions
from sim.mjcf import model_sha256

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MARKUP = re.compile(
    r"[|*`$]|(?<!\w)_|_(?!\w)|<(?=[a-zA-Z/!?])|\[(?=[^]]*\]\()|\\(?=[!-/:-@[-`{-~])"
    r"|&(?=#?\w+;)|~~|^[#>]"
)


UNITS = {unit: unit for unit in ("urad", "mrad", "rad", "um", "mm", "m", "s", "deg")}
UNITS |= {"hz": "Hz", "db": "dB", "percent": "%", "n": "N", "n_m": "N m"}
UNITS |= {"m_per_rad": "m/rad", "rad_per_m": "rad/m"}
"""Units in headings, by the end of the name of a column."""
_UNIT = re.compile(f"(.+?)_({'|'.join(UNITS)})")


@dataclass(frozen=True)
class Check:
    """Number that must stay below its limit for the study to be valid; NaN fails."""

    what: str  # name of the number, with its unit
    where: str  # run or condition
    value: float
    limit: float

    @property
    def passed(self) -> bool:
        """True if the value is below the limit."""
        return bool(self.value < self.limit)

    def row(self) -> dict[str, Any]:
        """Return the check for JSON; an infinite value or NaN becomes None."""
        value = self.value if isfinite(self.value) else None
        return asdict(self) | {"value": value, "passed": self.passed}

    def __str__(self) -> str:
        return f"{self.where}: {self.what} is {self.value:.3g}, expected below {self.limit:.3g}"


@dataclass(frozen=True)
class Picture:
    """A figure of a study."""

    name: str  # name of its files, without suffix
    caption: str
    alt: str  # description for readers who cannot see the figure
    plot: "Callable[[], Figure]"
    formats: tuple[str, ...] = ("png", "pdf")  # the first one is for pages

    @property
    def file(self) -> str:
        """Name of the file for pages."""
        return f"{self.name}.{self.formats[0]}"

    def files(self) -> Mapping[str, bytes]:
        """Return the contents of its files by name; they are reproducible to the byte."""
        from fjh.study.plotting import printed

        return printed(self.plot(), self.name, self.formats)


@dataclass(frozen=True)
class TableView:
    """View of a data frame as a printed table.

    Attributes:
        title: Description of the rows.
        frame: A table of the result, or some of its rows.
        columns: Names of the printed columns, the most important ones first, each with an optional
            name for its heading and an optional format: "strategy rms_urad=error_urad:.0f". The
            heading is "error [urad]". Cells of missing values are empty.
        legend: Meaning of the columns, where title and names are not sufficient.
    """

    title: str
    frame: pd.DataFrame
    columns: str
    legend: str = ""

    @property
    def headings(self) -> list[str]:
        """Headings of the printed columns; the first column has the labels of the rows."""
        return [_heading(entry.partition(":")[0]) for entry in self.columns.split()]

    def cells(self) -> list[list[str]]:
        """Return the rows as text."""
        formats = [entry.partition(":")[::2] for entry in self.columns.split()]
        columns = [(name.partition("=")[0], digits) for name, digits in formats]
        rows = self.frame.to_dict("records")
        return [[_cell(row[name], digits) for name, digits in columns] for row in rows]

    def markdown(self) -> str:
        """Return the table as Markdown, with title and legend."""
        lines = [self.headings, ["---"] * len(self.headings), *self.cells()]
        table = "\n".join("| " + " | ".join(map(literal, line)) + " |" for line in lines)
        return "\n\n".join(filter(None, (f"## {literal(self.title)}", literal(self.legend), table)))


def _heading(entry: str) -> str:
    name = entry.rpartition("=")[2]
    if name != name.lower():
        return name  # a run, such as W_a
    unit = _UNIT.fullmatch(name)
    words = f"{unit[1]} [{UNITS[unit[2]]}]" if unit else name
    return words.replace("_", " ")


def _cell(value: Any, digits: str) -> str:
    if value is None or (isinstance(value, float) and np.isnan(value)):
        return ""
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    return format(value, digits)


def literal(text: str) -> str:
    """Escape a text for Markdown: names in files of users may contain markup."""
    return _MARKUP.sub(r"\\\g<0>", text)


@dataclass(frozen=True)
class Result:
    """Result of a study; it is valid if all checks passed.

    Attributes:
        settings: Conditions of the study that are not in the rows; units are in the names.
        tables: Data frames by name, a row for each run or condition; units are in the names of
            the columns. The first is that of the runs.
        checks: Conditions for the numbers to be valid.
        views: Printed tables.
        notes: Sentences below the tables.
        pictures: Figures.
        arrays: Contents of `.npz` files by file name.
        records: Functions that write further files, such as recordings, into a given folder.
        overall: Results of the whole study, not of single rows; units are in the names.
        rows: Row for each run of a study of many runs, written to NAME.parquet only.
    """

    settings: Mapping[str, Any]
    tables: Mapping[str, pd.DataFrame] = field(default_factory=dict)
    checks: Sequence[Check] = ()
    views: Sequence[TableView] = ()
    notes: Sequence[str] = ()
    pictures: Sequence[Picture] = ()
    arrays: Mapping[str, Mapping[str, NDArray[Any]]] = field(default_factory=dict)
    records: Sequence[Callable[[Path], None]] = ()
    overall: Mapping[str, Any] = field(default_factory=dict)
    rows: pd.DataFrame | None = None

    def summary(self, name: str) -> dict[str, Any]:
        """Return the contents of the JSON file of a study of this name: tables as lists of rows."""
        dataset = {} if self.rows is None else {"dataset": f"{name}.parquet"}
        return {
            "experiment": name,
            "settings": list(self.settings),
            **dataset,
            **plain(dict(self.settings)),
            **{key: records_of(frame) for key, frame in self.tables.items()},
            **plain(dict(self.overall)),
            "checks": [plain(check.row()) for check in self.checks],
        }

    @property
    def failed(self) -> list[str]:
        """Sentence on each check that failed."""
        return [str(check) for check in self.checks if not check.passed]

    @property
    def checked(self) -> str:
        """Sentence on all checks: passed, or the list of those that failed."""
        if failed := self.failed:
            return f"{len(failed)} of {len(self.checks)} checks failed: {'; '.join(failed)}."
        return f"All checks passed ({len(self.checks)})." if self.checks else "No checks."

    def markdown(self) -> str:
        """Return tables, notes and figures as one page of Markdown."""
        notes = "\n".join(f"- {literal(note)}" for note in self.notes)
        figures = [
            f"![{literal(picture.alt)}]({picture.file})\n\n{literal(picture.caption)}"
            for picture in self.pictures
        ]
        parts = [*(view.markdown() for view in self.views), notes, *figures]
        return "\n\n".join(part for part in parts if part) + "\n"

    def publish(
        self, name: str, folder: Path, on_progress: OnProgress = lambda done, total: None
    ) -> dict[str, Any]:
        """Write NAME.json, NAME.md, Parquet, figures, data and recordings: all of them, or none.

        The progress is that of recordings and figures. Returns the contents of the JSON file, which
        name all files.

        Raises:
            OutputError: The folder cannot be written.
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
    """Return the settings of every result: seed, package versions, SHA-256 of the machine file.

    Args:
        seed: Seed of all random numbers of the study.
        models: Further machine files by name; then the SHA-256 are by name, the hexapod's `fjh`.
    """
    hexapod = model_sha256()
    hashes = {"fjh": hexapod} | {name: model_sha256(file) for name, file in models.items()}
    return {"seed": seed, "versions": versions(), "model_sha256": hashes if models else hexapod}


def check(what: str, values: Any, below: float, where: str = "") -> list[Check]:
    """Return checks that numbers stay below a limit; NaN fails.

    Args:
        what: Name of the number, with its unit in brackets.
        values: One number, or a series whose index identifies run or condition.
        below: The limit.
        where: Run or condition of a single number, or prefix of the index.
    """
    if isinstance(values, pd.Series):
        places = [index if isinstance(index, tuple) else (index,) for index in values.index]
        names = [", ".join(filter(None, (where, *map(str, place)))) for place in places]
        pairs = zip(names, values, strict=True)
        return [Check(what, name, float(value), below) for name, value in pairs]
    return [Check(what, where, float(values), below)]


def records_of(frame: pd.DataFrame) -> list[dict[str, Any]]:
    """Return the rows of a data frame for JSON; missing values are None."""
    return [plain(row) for row in frame.to_dict("records")]


def plain(value: Any) -> Any:
    """Convert a value to built-in types of Python: NaN to None, arrays to lists."""
    if isinstance(value, Mapping):
        return {str(key): plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [plain(entry) for entry in value]
    if isinstance(value, np.generic):
        value = value.item()
    return None if value is pd.NA or (isinstance(value, float) and np.isnan(value)) else value
