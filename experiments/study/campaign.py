"""Many independent runs, each of which becomes a row: what they are, and how one is done."""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from traceback import extract_tb
from typing import Any, Generic, Protocol, TypeVar

import pyarrow as pa
from threadpoolctl import threadpool_limits

from experiments.study.basis import Basis, Sources, identity
from experiments.study.provenance import processor
from experiments.study.study import Unsound

Row = dict[str, Any]


class Runs(Protocol):
    """Runs 0, 1, ..., each so small that it can be sent to any machine.

    Each has its `number`, on which and on what all are drawn from it depends alone.
    """

    def __len__(self) -> int:
        """How many there are."""
        ...

    def __getitem__(self, number: int, /) -> Any:
        """The run of this number."""
        ...


AnyRuns = TypeVar("AnyRuns", bound=Runs)


@dataclass(frozen=True, eq=False)
class Campaign(Generic[AnyRuns]):
    """Runs, and all that their rows depend on.

    Attributes:
        runs: What is to be run.
        row_of: The row of a run, a function that workers can import; its column `case` is the
            run's number. What a row lacks is null.
        schema: Columns of the rows.
        sources: What the rows are made with.
        drawn_from: What the runs are drawn from, as their seed; ready for JSON.
    """

    runs: AnyRuns
    row_of: Callable[[Any], Row]
    schema: pa.Schema
    sources: Sources
    drawn_from: dict[str, Any]

    @property
    def basis(self) -> Basis:
        """All that the bytes of the dataset depend on; the same again when read from JSON."""
        basis = {
            **self.drawn_from,
            **identity(self.sources),
            "version of pyarrow": version("pyarrow"),
            "processor": processor(),
        }
        return json.loads(json.dumps(basis))


@dataclass(frozen=True)
class Again:
    """A dataset's runs, to be flown once more.

    Attributes:
        campaign: Of these runs, as this version draws them.
        fly: Of a run of the hexapod: the columns of its row that are made anew, what happened, and
            what else is to be said of its failures; a function that workers can import.
    """

    campaign: Campaign[Any]
    fly: Callable[[Any], tuple[Row, Any, str]]


def simulate(row_of: Callable[[Any], Row], run: Any) -> Row:
    """The row of a run, on a worker; an `Unsound` says which one failed, why, and where.

    On one thread, whatever the environment says: sums on several round otherwise.
    """
    try:
        with threadpool_limits(1):
            return row_of(run)
    except Exception as error:
        [*_, last] = extract_tb(error.__traceback__)
        why = f"{type(error).__name__} in {Path(last.filename).name}, line {last.lineno}"
        message = " ".join(str(error).split())
        raise Unsound(f"run {run.number} failed: {why}: {message}") from None


def table_of(rows: Sequence[Row], schema: pa.Schema) -> pa.Table:
    """Rows in the order of their runs; what a row lacks is null."""
    return pa.Table.from_pylist(sorted(rows, key=lambda row: row["case"]), schema=schema)
