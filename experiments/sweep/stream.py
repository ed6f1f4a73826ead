"""Cases to workers and rows back, some at a time, in whatever order they finish."""

from collections.abc import Iterable, Iterator
from itertools import islice
from pathlib import Path
from traceback import extract_tb
from types import TracebackType

from distributed import Client, as_completed

from experiments.conduct import Unsound
from experiments.sweep.case import Case
from experiments.sweep.identity import digest
from experiments.sweep.run import Row
from experiments.sweep.task import fly

IN_FLIGHT = 4000
"""Cases that the scheduler knows of at once: several for each core of a large cluster, and few
megabytes. Those of a worker that is lost go to another."""


def finished_rows(client: Client, cases: Iterable[Case]) -> Iterator[Row]:
    """The rows of cases, as they finish.

    Raises:
        Unsound: A case failed in a way that no row foresees, or ended several workers; or the
            scheduler has gone.
    """
    waiting = iter(cases)
    finished = as_completed(with_results=True, raise_errors=False, loop=client.loop)

    def submit(count: int) -> None:
        for case in islice(waiting, count):
            # A name of its own for every client: a scheduler may have several.
            key = f"{client.id}-{case.number}"
            finished.add(client.submit(fly, case, digest(), key=key))

    submit(IN_FLIGHT)
    for future, result in finished:
        if future.status == "error":
            raise Unsound(_said(future.key, *result[1:]))
        if future.status != "finished":
            raise Unsound("the scheduler has gone; finished runs are kept, and --resume goes on")
        submit(1)
        yield result


def _said(key: str, error: Exception, traceback: TracebackType | None) -> str:
    """What went wrong with a case, and where."""
    frames = extract_tb(traceback)
    where = f" in {Path(frames[-1].filename).name}, line {frames[-1].lineno}" if frames else ""
    said = " ".join(str(error).split())
    number = key.rpartition("-")[2]
    return f"case {number} failed: {type(error).__name__}{where}: {said}"
