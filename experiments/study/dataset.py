"""Rows on disk: a Parquet dataset that grows by whole parts, and all of them in one file."""

import os
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pyarrow as pa

from experiments.study import parquet
from experiments.study.basis import BASIS, Basis, digest
from experiments.study.campaign import Row, table_of
from experiments.study.files import OutputError, write_json
from experiments.study.parquet import Broken

PART = 256
"""Rows of a part, consecutive runs; and of a row group in the finished file."""

KEPT_EVERY_S = 10.0
"""How long a finished run may be in memory only."""

REST = "_rest.parquet"
"""A name that readers of Parquet datasets pass over."""

_BASIS_SHA256 = b"basis_sha256"
"""Key in the metadata of every file: the digest of the basis that its rows are of."""


class Dataset:
    """Rows of the runs 0 .. runs - 1, in a folder that the first of them makes.

    Complete parts are files of their own; finished runs of the others are together in one more.
    Every file is renamed into its place when it is whole, and says which basis it is of. `broken`
    is what was wrong with files that were there; their runs are missing again. Where the disk or
    the folder refuses, an OutputError is raised.
    """

    def __init__(self, folder: Path, runs: int, basis: Basis, schema: pa.Schema) -> None:
        """Read what is there; the caller knows that it is of this basis."""
        self.folder, self.runs, self.basis, self.schema = folder, runs, basis, schema
        self.broken: list[Broken] = []
        self._whole = {part for part in range(self._parts) if self._has(part)}
        self._open: dict[int, dict[int, Row]] = {}
        self._kept_s = time.monotonic()
        for row in self._rest():
            part = row["case"] // PART
            if part not in self._whole:  # it may have been completed since
                self._open.setdefault(part, {})[row["case"]] = row
        for part in list(self._open):
            self._write_if_whole(part)

    def missing(self) -> Iterator[int]:
        """Numbers of the runs without a row, in order."""
        for part in range(self._parts):
            if part not in self._whole:
                have = frozenset(self._open.get(part, ()))
                yield from (number for number in self._numbers(part) if number not in have)

    def add(self, row: Row) -> None:
        """Keep a finished run; the last of a part writes it."""
        part = row["case"] // PART
        self._open.setdefault(part, {})[row["case"]] = row
        self._write_if_whole(part)
        if time.monotonic() - self._kept_s > KEPT_EVERY_S:
            self.keep()

    def keep(self) -> None:
        """Write the finished runs of unfinished parts."""
        if self._open:
            rows = [row for part in self._open.values() for row in part.values()]
            self._write(self.folder / REST, rows)
        self._kept_s = time.monotonic()

    def files(self) -> list[Path]:
        """Those of the parts, in order; all of them exist when no run is missing."""
        return [self._file(part) for part in range(self._parts)]

    def rows(self) -> list[Row]:
        """Those of all parts, in order."""
        return [row for file in self.files() for row in parquet.read(file).to_pylist()]

    def merge(
        self, path: Path, extended: Callable[[pa.Table], pa.Table] = lambda part: part
    ) -> None:
        """Write all parts into one file, a row group each, of which one at a time is in memory.

        A part may be extended by further columns. `Broken` is raised where one is not what was
        written, `OSError` where the disk or the folder refuses.
        """
        parquet.write(path, (extended(parquet.read(file)) for file in self.files()))

    def remove(self) -> None:
        """Remove the folder, in one step: what was in it is published."""
        try:
            with tempfile.TemporaryDirectory(dir=self.folder.parent, prefix=".fjh-") as gone:
                self.folder.rename(Path(gone) / self.folder.name)
        except OSError as error:
            raise OutputError(f"{self.folder} could not be removed: {error.strerror}") from None

    def _write_if_whole(self, part: int) -> None:
        rows = self._open[part]
        if len(rows) == len(self._numbers(part)):
            self._write(self._file(part), list(rows.values()))
            self._whole.add(part)
            del self._open[part]

    def _has(self, part: int) -> bool:
        numbers = self._numbers(part)
        return self._read(self._file(part), lambda n: np.array_equal(n, numbers)) is not None

    def _rest(self) -> list[Row]:
        def ascend(numbers: np.ndarray) -> bool:
            return bool(np.all(np.diff([-1, *numbers, self.runs]) > 0))

        table = self._read(self.folder / REST, ascend)
        return [] if table is None else table.to_pylist()

    def _read(self, path: Path, are_ours: Callable[[np.ndarray], bool]) -> pa.Table | None:
        """The rows of a file, if they are what was written there."""
        if not path.exists():
            return None
        try:
            table = parquet.read(path)
            if not (table.schema.equals(self.schema) and _is_of(table, self.basis)):
                raise Broken(path, "it is of another study")
            if not are_ours(table["case"].to_numpy()):
                raise Broken(path, "it has other cases")
        except Broken as broken:
            self.broken.append(broken)
            return None
        return table

    def _write(self, path: Path, rows: list[Row]) -> None:
        table = table_of(rows, self.schema).replace_schema_metadata(
            {_BASIS_SHA256: digest(self.basis)}
        )
        try:
            if not (self.folder / BASIS).exists():
                self.folder.mkdir(parents=True, exist_ok=True)
                _replace(self.folder / BASIS, lambda staged: write_json(staged, self.basis))
            _replace(path, lambda staged: parquet.write(staged, [table]))
        except OSError as error:
            reason = error.strerror or error
            raise OutputError(f"{self.folder} could not be written: {reason}") from None

    @property
    def _parts(self) -> int:
        return -(-self.runs // PART)

    def _numbers(self, part: int) -> range:
        return range(part * PART, min((part + 1) * PART, self.runs))

    def _file(self, part: int) -> Path:
        return self.folder / f"part-{part:06d}.parquet"


def _is_of(table: pa.Table, basis: Basis) -> bool:
    return (table.schema.metadata or {}).get(_BASIS_SHA256) == digest(basis).encode()


def _replace(path: Path, write: Callable[[Path], None]) -> None:
    """Write beside the path and rename: whoever sees the file sees all of it."""
    staged = path.with_name(f".{path.name}")
    try:
        write(staged)
        with staged.open("rb") as file:
            os.fsync(file.fileno())  # or after a power cut the name may be there without the rows
        staged.replace(path)
    finally:
        staged.unlink(missing_ok=True)


def check_merged(path: Path, runs: int, basis: Basis, schema: pa.Schema) -> None:
    """Raise `Broken` unless a file holds the rows of so many runs of the basis, all of them."""
    found = 0
    for table in parquet.row_groups(path):
        if table.schema.names[: len(schema)] != schema.names or not _is_of(table, basis):
            raise Broken(path, "it is of another study")
        if not np.array_equal(table["case"].to_numpy(), np.arange(found, found + len(table))):
            raise Broken(path, "it has other cases")
        found += len(table)
    if found != runs:
        raise Broken(path, f"it has {found} runs instead of {runs}")


@dataclass(frozen=True)
class Columns:
    """Columns of Parquet files as arrays, read when they are asked for; a missing number is NaN."""

    files: Sequence[Path]
    further: Mapping[str, np.ndarray] = field(default_factory=dict)  # in memory

    def __getitem__(self, name: str) -> np.ndarray:
        if name in self.further:
            return self.further[name]
        return pa.concat_tables(parquet.read(file, [name]) for file in self.files)[name].to_numpy()
