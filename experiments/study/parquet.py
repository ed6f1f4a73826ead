"""Parquet files with a checksum on every page; each page that is read is compared with it."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from itertools import chain
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from experiments.study.files import OutputError

_FORMAT: dict[str, Any] = {
    "compression": "zstd",
    "use_dictionary": False,  # few numbers repeat; those that do are left to the compression
    "write_page_checksum": True,
}


class Broken(OutputError):
    """A Parquet file is not what was written; the message names it and says why."""

    def __init__(self, path: Path, why: str) -> None:
        """Name the file, and say what is wrong with it."""
        super().__init__(f"{path} is broken: {why}")


def write(path: Path, tables: Iterable[pa.Table]) -> None:
    """Write at least one table, all of the same schema, each a row group: one at a time is in use.

    An `OSError` is raised where the disk or the folder refuses.
    """
    waiting = iter(tables)
    first = next(waiting)
    with pq.ParquetWriter(path, first.schema, **_FORMAT) as writer:
        for table in chain([first], waiting):
            writer.write_table(table)


def read(path: Path, columns: list[str] | None = None) -> pa.Table:
    """Some columns of a file as one table; None is all of them.

    Raises:
        Broken: It is not whole, or a page does not have its checksum.
        OutputError: The system does not let it be read.
    """
    with _opened(path) as file:
        return file.read(columns)


def row_groups(path: Path) -> Iterator[pa.Table]:
    """The tables of a file one after the other; raises as :func:`read` does."""
    with _opened(path) as file:
        for k in range(file.num_row_groups):
            yield file.read_row_group(k)


@contextmanager
def _opened(path: Path) -> Iterator[pq.ParquetFile]:
    try:
        with (
            path.open("rb") as bytes_,
            pq.ParquetFile(bytes_, page_checksum_verification=True) as file,
        ):
            yield file
    except FileNotFoundError:
        raise Broken(path, "there is no such file") from None
    except (OSError, ValueError, pa.ArrowException) as error:
        if isinstance(error, OSError) and error.errno:  # the system's, not the contents'
            raise OutputError(f"{path} cannot be read: {error.strerror}") from None
        raise Broken(path, " ".join(str(error).split()).rstrip(".")) from None
