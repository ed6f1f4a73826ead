"""Where runs are done: workers of this machine, or of a scheduler that somebody else started."""

import asyncio
import logging
import signal
import tempfile
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from multiprocessing.resource_tracker import ensure_running
from pathlib import Path
from traceback import extract_tb
from types import TracebackType
from typing import Any

from dask import config
from dask.system import CPU_COUNT
from distributed import Client, Future, LocalCluster, as_completed, rpc

from experiments.study.basis import Sources, check_workers, digest, identity
from experiments.study.campaign import Campaign, Row, simulate
from experiments.study.study import Unsound, WrongInput
from experiments.study.terminal import notice
from experiments.study.where import PATIENCE_S

ANSWERS_IN_S = 5.0
"""How long a scheduler may take to answer."""

IN_FLIGHT = 4000
"""Runs that the scheduler knows of at once: several for each core of a large cluster, and few
megabytes. Those of a worker that is lost go to another."""

POLL_S, LOOK_EVERY_S = 0.02, 5.0
"""Period of looking for results; and, while there are none, for workers."""

_MALLOC = {"MALLOC_TRIM_THRESHOLD_": 1 << 30, "MALLOC_MMAP_THRESHOLD_": 1 << 25}
"""Freed memory stays with the worker. Dask's default returns what exceeds 64 kB to the system, and
a simulated flight then spends a quarter of its time on 560,000 page faults."""

_KEPT = "finished runs are kept, and --resume continues"
_SILENT = logging.CRITICAL + 1


@dataclass(frozen=True)
class Where:
    """A Dask scheduler; if there is no address, workers of this machine, by default one a core.

    A `WrongInput` is raised if both are given, the address is none, or there are no workers.
    """

    scheduler: str | None = None
    workers: int | None = None

    def __post_init__(self) -> None:
        if self.scheduler is not None and self.scheduler.split() != [self.scheduler]:
            raise WrongInput(
                f"--scheduler must be an address, as tcp://host:8786, got {self.scheduler!r}"
            )
        if self.workers is not None and self.workers < 1:
            raise WrongInput(f"--workers must be a number from 1 on, got {self.workers}")
        if self.scheduler and self.workers:
            raise WrongInput("--workers are processes on this computer: omit it with --scheduler")


@contextmanager
def cluster(where: Where, most: int, sources: Sources) -> Iterator[Client]:
    """A client of somebody's scheduler, or of a local cluster that ends with the context.

    Raises:
        WrongInput: No scheduler answers there; or it has no workers, and gets none; or they have
            another version of this package.
    """
    workers = min(where.workers or CPU_COUNT, most)  # of a local cluster
    with (
        _silenced("distributed"),
        _silenced("distributed.client"),
        _remote(where.scheduler, sources) if where.scheduler else _local(workers) as client,
    ):
        yield client


@contextmanager
def _silenced(name: str) -> Iterator[None]:
    """No log: the study itself reports in one sentence what goes wrong."""
    logger = logging.getLogger(name)
    level = logger.level
    logger.setLevel(_SILENT)
    try:
        yield
    finally:
        logger.setLevel(level)


@contextmanager
def _local(workers: int) -> Iterator[Client]:
    with tempfile.TemporaryDirectory(prefix="fjh-") as scratch:
        settings = {
            "temporary-directory": scratch,
            "distributed.worker.multiprocessing-method": "spawn",
            **{f"distributed.nanny.pre-spawn-environ.{name}": n for name, n in _MALLOC.items()},
        }
        with config.set(settings), _ignoring_ctrl_c():
            here = LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                host="127.0.0.1",
                dashboard_address="127.0.0.1:0",
                silence_logs=_SILENT,
            )
        with here, Client(here) as client:
            yield client


@contextmanager
def _ignoring_ctrl_c() -> Iterator[None]:
    """Threads started here, and all processes that they ever start, never see SIGINT.

    It goes to the whole process group; only the client answers, and ends its workers.
    """
    ensure_running()  # of itself it would unblock the signal in the thread that starts a worker
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def _remote(scheduler: str, sources: Sources) -> Iterator[Client]:
    try:
        asyncio.run(_check_scheduler(scheduler))
        client = Client(scheduler, timeout=ANSWERS_IN_S)
    except Exception as error:  # whatever there is at that port, and in Dask for that scheme
        why = " ".join(str(error).split()) or f"nothing within {ANSWERS_IN_S:g} s"
        raise WrongInput(f"--scheduler {scheduler} does not answer: {why}") from None
    with client:
        wait_for_worker(client)
        answers: Any = client.run(identity, sources, on_error="return")
        check_workers(identity(sources), answers)
        yield client


async def _check_scheduler(address: str) -> None:
    """Ask what is there: Dask's client would wait for ever for what does not answer."""
    async with asyncio.timeout(ANSWERS_IN_S), rpc(address, timeout=ANSWERS_IN_S) as there:
        found: Any = await there.identity()
    if found["type"] != "Scheduler":
        raise ValueError(f"it is a {found['type']}")


def wait_for_worker(client: Client) -> None:
    """Return when the scheduler has a worker.

    A `WrongInput` is raised if it has none for `PATIENCE_S`, an `Unsound` if it has gone.
    """
    try:
        if client.scheduler_info(n_workers=0)["n_workers"]:
            return
        notice(f"the scheduler has no workers; waiting up to {PATIENCE_S:g} s for one")
        client.wait_for_workers(1, timeout=PATIENCE_S)
    except TimeoutError:
        why = f"the scheduler has had no workers for {PATIENCE_S:g} s: start some with dask worker"
        raise WrongInput(f"{why}; {_KEPT}") from None
    except (OSError, KeyError):
        raise Unsound(f"the connection to the scheduler is lost; {_KEPT}") from None


def finished_rows(client: Client, campaign: Campaign[Any], numbers: Iterable[int]) -> Iterator[Row]:
    """The rows of the runs of these numbers, in the order in which they finish.

    Raises:
        Unsound: A run failed in a way that no row foresees, or ended several workers; or the
            scheduler has gone.
        WrongInput: Somebody's scheduler has lost all its workers, and got no other.
    """
    waiting, code = iter(numbers), digest(identity(campaign.sources))
    finished = as_completed(with_results=True, raise_errors=False, loop=client.loop)

    def submit(count: int) -> None:
        for number in islice(waiting, count):
            # A name of its own for every client: a scheduler may have several.
            key, run = f"{client.id}-{number}", campaign.runs[number]
            work = campaign.row_of, run, campaign.sources, code
            finished.add(client.submit(simulate, *work, key=key))

    submit(IN_FLIGHT)
    for future, result in _arriving(finished, client):
        if future.status == "error":
            raise Unsound(_failure(str(future.key), *result[1:]))
        if future.status != "finished":
            raise Unsound(f"the connection to the scheduler is lost; {_KEPT}")
        submit(1)
        yield result


def _arriving(finished: as_completed, client: Client) -> Iterator[tuple[Future, Any]]:
    """What arrives, until nothing more can; as_completed itself would wait for ever."""
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


def _failure(key: str, error: Exception, traceback: TracebackType | None) -> str:
    """Which run failed, why, and where."""
    frames = extract_tb(traceback)
    where = f" in {Path(frames[-1].filename).name}, line {frames[-1].lineno}" if frames else ""
    why = " ".join(str(error).split())
    number = key.rpartition("-")[2]
    return f"run {number} failed: {type(error).__name__}{where}: {why}"
