"""A sweep on disk while it runs: a Parquet dataset that grows by whole parts."""

import os
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import numpy as np
import pyarrow as pa

from experiments.output.files import OutputError, write_json
from experiments.sweep import parquet
from experiments.sweep.basis import BASIS, OF, Basis, digest, is_of
from experiments.sweep.parquet import Broken
from experiments.sweep.run import Row
from experiments.sweep.table import SCHEMA, table_of

PART = 256
"""Rows of a part, consecutive cases; and of a row group in the finished file."""

KEPT_EVERY_S = 10.0
"""So long a finished run may be in memory alone."""

REST = "_rest.parquet"
"""A name that readers of Parquet datasets pass over."""


class Dataset:
    """Rows of the cases 0 .. runs - 1, in a folder that the first of them makes.

    Complete parts are files of their own; finished runs of the others are together in one more.
    Every file is renamed into its place when it is whole, and says which basis it is of. Where the
    disk or the folder refuses, an OutputError is raised.

    Attributes:
        folder: Of the files.
        runs: How many there will be.
        broken: What was wrong with files that were there; their cases are missing again.
    """

    def __init__(self, folder: Path, runs: int, basis: Basis) -> None:
        """Read what is there; the caller knows that it is of this basis."""
        self.folder = folder
        self.runs = runs
        self.broken: list[Broken] = []
        self._basis = basis
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
        """Cases without a row, in order."""
        for part in range(self._parts):
            if part not in self._whole:
                have = frozenset(self._open.get(part, ()))
                yield from (case for case in self._cases(part) if case not in have)

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

    def files(self) -> Iterable[Path]:
        """Those of the parts, in order; all are there when no case is missing."""
        return map(self._file, range(self._parts))

    def remove(self) -> None:
        """Take the folder away, all at once: what was in it is published."""
        try:
            with tempfile.TemporaryDirectory(dir=self.folder.parent, prefix=".fjh-") as gone:
                self.folder.rename(Path(gone) / self.folder.name)
        except OSError as error:
            raise OutputError(f"{self.folder} could not be removed: {error.strerror}") from None

    def _write_if_whole(self, part: int) -> None:
        rows = self._open[part]
        if len(rows) == len(self._cases(part)):
            self._write(self._file(part), list(rows.values()))
            self._whole.add(part)
            del self._open[part]

    def _has(self, part: int) -> bool:
        cases = self._cases(part)
        table = self._read(self._file(part), lambda found: np.array_equal(found, cases))
        return table is not None

    def _rest(self) -> list[Row]:
        def are_ascending(found: np.ndarray) -> bool:
            return bool(np.all(np.diff([-1, *found, self.runs]) > 0))

        table = self._read(self.folder / REST, are_ascending)
        return [] if table is None else table.to_pylist()

    def _read(self, path: Path, are_ours: Callable[[np.ndarray], bool]) -> pa.Table | None:
        """The rows of a file, if they are what was written there."""
        if not path.exists():
            return None
        try:
            table = parquet.read(path)
            if not (table.schema.equals(SCHEMA) and is_of(table.schema, self._basis)):
                raise Broken(path, "it is of another sweep")
            if not are_ours(table["case"].to_numpy()):
                raise Broken(path, "it has other cases")
        except Broken as broken:
            self.broken.append(broken)
            return None
        return table

    def _write(self, path: Path, rows: list[Row]) -> None:
        table = table_of(rows).replace_schema_metadata({OF: digest(self._basis)})
        try:
            if not (self.folder / BASIS).exists():
                self.folder.mkdir(parents=True, exist_ok=True)
                _replace(self.folder / BASIS, lambda staged: write_json(staged, self._basis))
            _replace(path, lambda staged: parquet.write(staged, [table]))
        except OSError as error:
            reason = error.strerror or error
            raise OutputError(f"{self.folder} could not be written: {reason}") from None

    @property
    def _parts(self) -> int:
        return -(-self.runs // PART)

    def _cases(self, part: int) -> range:
        return range(part * PART, min((part + 1) * PART, self.runs))

    def _file(self, part: int) -> Path:
        return self.folder / f"part-{part:06d}.parquet"


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
