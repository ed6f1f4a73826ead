"""A finished sweep: all parts in one Parquet file."""

from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
import pyarrow as pa

from experiments.sweep import parquet
from experiments.sweep.basis import Basis, is_of
from experiments.sweep.parquet import Broken
from experiments.sweep.table import SCHEMA


def merge(files: Iterable[Path], path: Path, extended: Callable[[pa.Table], pa.Table]) -> None:
    """One Parquet file of all parts, a row group each.

    Args:
        files: Of the parts, in order; at least one.
        path: To write.
        extended: Gives a part further columns.

    Raises:
        Broken: A part is not what was written.
    """
    parquet.write(path, (extended(parquet.read(file)) for file in files))


def check_merged(path: Path, runs: int, basis: Basis) -> None:
    """Whether a file holds a finished sweep.

    Raises:
        Broken: It does not, or is not what was written.
    """
    found = 0
    for table in parquet.row_groups(path):
        if table.schema.names[: len(SCHEMA)] != SCHEMA.names or not is_of(table.schema, basis):
            raise Broken(path, "it is of another sweep")
        cases = np.arange(found, found + len(table))
        if not np.array_equal(table["case"].to_numpy(), cases):
            raise Broken(path, "it has other cases")
        found += len(table)
    if found != runs:
        raise Broken(path, f"it has {found} runs instead of {runs}")
