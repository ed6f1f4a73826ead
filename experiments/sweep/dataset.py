"""A sweep on disk while it runs: a Parquet dataset that grows by whole parts."""

import json
import shutil
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from experiments.files import OutputError, write_json
from experiments.sweep.run import Row
from experiments.sweep.table import table_of

PART = 256
"""Rows of a part, consecutive cases; and of a row group in the finished file."""

KEPT_EVERY_S = 10.0
"""So long a finished run may be in memory alone."""

BASIS, REST = "_basis.json", "_rest.parquet"
"""Names that readers of Parquet datasets pass over."""


class Dataset:
    """Rows of the cases 0 .. runs - 1, in a folder that the first of them makes.

    Complete parts are files of their own; finished runs of the others are together in one more.
    Every file is renamed into its place when it is whole. Where the disk or the folder refuses, an
    OutputError is raised.
    """

    def __init__(self, folder: Path, runs: int, basis: dict[str, Any]) -> None:
        """Read what is there; the caller knows that it is of this basis."""
        self.folder = folder
        self.runs = runs
        self._basis = basis
        self._open: dict[int, dict[int, Row]] = {}
        self._kept_s = time.monotonic()
        if (folder / REST).exists():
            for row in pq.read_table(folder / REST).to_pylist():
                part = row["case"] // PART
                if not self._file(part).exists():  # it may have been completed since
                    self._open.setdefault(part, {})[row["case"]] = row

    def missing(self) -> Iterator[int]:
        """Cases without a row, in order."""
        for part in range(self._parts):
            if not self._file(part).exists():
                have = frozenset(self._open.get(part, ()))
                yield from (case for case in self._cases(part) if case not in have)

    def add(self, row: Row) -> None:
        """Keep a finished run; the last of a part writes it."""
        part = row["case"] // PART
        rows = self._open.setdefault(part, {})
        rows[row["case"]] = row
        if len(rows) == len(self._cases(part)):
            self._write(self._file(part), list(rows.values()))
            del self._open[part]
        elif time.monotonic() - self._kept_s > KEPT_EVERY_S:
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
        """Take the folder away: what was in it is published."""
        shutil.rmtree(self.folder)

    def _write(self, path: Path, rows: list[Row]) -> None:
        table = table_of(rows)
        try:
            if not (self.folder / BASIS).exists():
                self.folder.mkdir(parents=True, exist_ok=True)
                _whole(self.folder / BASIS, lambda staged: write_json(staged, self._basis))
            _whole(path, lambda staged: pq.write_table(table, staged, **_FORMAT))
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


def basis_in(folder: Path) -> dict[str, Any] | None:
    """What the dataset in a folder belongs to; None if there is none."""
    try:
        return json.loads((folder / BASIS).read_bytes())
    except (OSError, ValueError):
        return None


def merge(files: Iterable[Path], path: Path, extended: Callable[[pa.Table], pa.Table]) -> None:
    """One Parquet file of all parts, a row group each: no more than one is ever in memory.

    Args:
        files: Of the parts, in order; at least one.
        path: To write.
        extended: Gives a part further columns.
    """
    writer = None
    for file in files:
        table = extended(pq.read_table(file))
        writer = writer or pq.ParquetWriter(path, table.schema, **_FORMAT)
        writer.write_table(table)
    if writer:
        writer.close()


_FORMAT: dict[str, Any] = {"compression": "zstd", "use_dictionary": False}
"""Few numbers repeat; those that do are left to the compression."""


def _whole(path: Path, write: Callable[[Path], None]) -> None:
    """Write beside the path and rename: whoever sees the file sees all of it."""
    staged = path.with_name(f".{path.name}")
    write(staged)
    staged.replace(path)
