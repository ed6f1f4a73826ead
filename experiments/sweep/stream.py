"""Cases to workers and rows back, some at a time, in whatever order they finish."""

import time
from collections.abc import Iterable, Iterator
from itertools import islice
from pathlib import Path
from traceback import extract_tb
from types import TracebackType
from typing import Any

from distributed import Client, Future, as_completed

from experiments.output.study import Unsound
from experiments.sweep.case import Case
from experiments.sweep.identity import digest
from experiments.sweep.run import Row
from experiments.sweep.task import fly
from experiments.sweep.waiting import GONE, wait_for_worker

IN_FLIGHT = 4000
"""Cases that the scheduler knows of at once: several for each core of a large cluster, and few
megabytes. Those of a worker that is lost go to another."""

POLL_S, LOOK_EVERY_S = 0.02, 5.0
"""So often is asked for results; and, while there are none, whether there are workers."""


def finished_rows(client: Client, cases: Iterable[Case]) -> Iterator[Row]:
    """The rows of cases, as they finish.

    Raises:
        Unsound: A case failed in a way that no row foresees, or ended several workers; or the
            scheduler has gone.
        WrongInput: Somebody's scheduler has lost all its workers, and got no other.
    """
    waiting = iter(cases)
    finished = as_completed(with_results=True, raise_errors=False, loop=client.loop)

    def submit(count: int) -> None:
        for case in islice(waiting, count):
            # A name of its own for every client: a scheduler may have several.
            key = f"{client.id}-{case.number}"
            finished.add(client.submit(fly, case, digest(), key=key))

    submit(IN_FLIGHT)
    for future, result in _arriving(finished, client):
        if future.status == "error":
            raise Unsound(_said(str(future.key), *result[1:]))
        if future.status != "finished":
            raise Unsound(GONE)
        submit(1)
        yield result


def _arriving(finished: as_completed, client: Client) -> Iterator[tuple[Future, Any]]:
    """What comes, until nothing more can; as_completed itself would wait for ever."""
    looked_s = time.monotonic()
    while not finished.is_empty():
        if finished.has_ready():
            yield from finished.next_batch(block=False)
            looked_s = time.monotonic()
        elif client.cluster is None and time.monotonic() - looked_s > LOOK_EVERY_S:
            wait_for_worker(client)
            looked_s = time.monotonic()
        else:
            time.sleep(POLL_S)


def _said(key: str, error: Exception, traceback: TracebackType | None) -> str:
    """What went wrong with a case, and where."""
    frames = extract_tb(traceback)
    where = f" in {Path(frames[-1].filename).name}, line {frames[-1].lineno}" if frames else ""
    said = " ".join(str(error).split())
    number = key.rpartition("-")[2]
    return f"case {number} failed: {type(error).__name__}{where}: {said}"
