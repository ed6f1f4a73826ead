"""The result of a study as data frames: its numbers, checks, printed tables, figures and files."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from experiments.study.provenance import versions
from experiments.study.results import Check, Picture, Results
from experiments.study.tables import Table
from sim import model_sha256


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

    def table(self) -> Table:
        """The cells as text."""
        entries = [entry.partition(":")[::2] for entry in self.columns.split()]
        rows = [
            tuple(_cell(row[name], digits) for name, digits in entries)
            for row in self.frame.to_dict("records")
        ]
        return Table(self.title, tuple(name for name, _ in entries), rows, self.legend)


def _cell(value: Any, digits: str) -> str:
    if value is None or (isinstance(value, float) and np.isnan(value)):
        return ""
    return format(value, digits)


@dataclass(frozen=True)
class Result:
    """What a study found.

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
    """

    settings: Mapping[str, Any]
    tables: Mapping[str, pd.DataFrame]
    checks: Sequence[Check] = ()
    shown: Sequence[Shown] = ()
    notes: Sequence[str] = ()
    pictures: Sequence[Picture] = ()
    arrays: Mapping[str, Mapping[str, NDArray[Any]]] = field(default_factory=dict)
    records: Sequence[Callable[[Path], None]] = ()

    def summary(self, name: str) -> dict[str, Any]:
        """The contents of the JSON file of the study of this name: each table is its rows."""
        return {
            "experiment": name,
            "settings": list(self.settings),
            **_plain(dict(self.settings)),
            **{key: rows_of(frame) for key, frame in self.tables.items()},
            "checks": [_plain(check.row()) for check in self.checks],
        }

    def results(self, name: str) -> Results:
        """The result of the study of this name, to be published."""
        return Results(
            self.summary(name),
            tables=[shown.table() for shown in self.shown],
            notes=self.notes,
            checks=self.checks,
            pictures=self.pictures,
            arrays=self.arrays,
            frames=self.tables,
            records=self.records,
        )


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


def rows_of(frame: pd.DataFrame) -> list[dict[str, Any]]:
    """The rows of a data frame, ready for JSON: what is missing is None."""
    return [_plain(row) for row in frame.to_dict("records")]


def _plain(value: Any) -> Any:
    """The value in types of Python: None for NaN, lists for arrays."""
    if isinstance(value, Mapping):
        return {str(key): _plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [_plain(each) for each in value]
    if isinstance(value, np.generic):
        value = value.item()
    return None if value is pd.NA or (isinstance(value, float) and np.isnan(value)) else value
