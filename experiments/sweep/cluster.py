"""Where a sweep runs: workers of this machine, or a scheduler that somebody else started."""

import asyncio
import logging
import signal
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing.resource_tracker import ensure_running
from typing import Any

from dask import config
from dask.system import CPU_COUNT
from distributed import Client, LocalCluster, rpc

from experiments.output.study import WrongInput
from experiments.sweep.identity import Identity, identity
from experiments.sweep.waiting import wait_for_worker

ANSWERS_IN_S = 5.0
"""So long a scheduler may take to answer."""
_SILENT = logging.CRITICAL + 1


@dataclass(frozen=True)
class Where:
    """What runs a sweep.

    Attributes:
        scheduler: Address of a Dask scheduler, as "tcp://host:8786"; None is a cluster on this
            machine.
        workers: Of that, with one thread each; None is one for each core.

    Raises:
        WrongInput: Both are given, or the address is none.
    """

    scheduler: str | None = None
    workers: int | None = None

    def __post_init__(self) -> None:
        if self.scheduler is not None and self.scheduler.split() != [self.scheduler]:
            raise WrongInput(
                f"--scheduler must be an address, as tcp://host:8786, got {self.scheduler!r}"
            )
        if self.scheduler and self.workers:
            raise WrongInput("--workers are of this machine, leave them out with --scheduler")


@contextmanager
def cluster(where: Where, most: int) -> Iterator[Client]:
    """A client of somebody's scheduler, or of a local cluster that ends with the context.

    Args:
        where: Which.
        most: Local workers that there is work for.

    Raises:
        WrongInput: No scheduler answers there; or it has no workers, and gets none; or they have
            another version of this package.
    """
    workers = min(where.workers or CPU_COUNT, most)
    with (
        _silenced("distributed", "distributed.client"),
        _remote(where.scheduler) if where.scheduler else _local(workers) as client,
    ):
        yield client


@contextmanager
def _silenced(*names: str) -> Iterator[None]:
    """What goes wrong is said in one sentence, by the sweep."""
    loggers = [logging.getLogger(name) for name in names]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(_SILENT)
    try:
        yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)


@contextmanager
def _local(workers: int) -> Iterator[Client]:
    with tempfile.TemporaryDirectory(prefix="fjh-") as scratch:
        settings = {
            "temporary-directory": scratch,
            "distributed.worker.multiprocessing-method": "spawn",
        }
        with config.set(settings), _deaf_to_ctrl_c():
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
def _deaf_to_ctrl_c() -> Iterator[None]:
    """Threads born here, and all processes that they ever start, never see SIGINT.

    It goes to the whole process group; the client alone answers, and ends its workers.
    """
    ensure_running()  # of itself it would unblock the signal in the thread that starts a worker
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def _remote(scheduler: str) -> Iterator[Client]:
    try:
        asyncio.run(_check_scheduler(scheduler))
        client = Client(scheduler, timeout=ANSWERS_IN_S)
    except Exception as error:  # whatever there is at that port, and in Dask for that scheme
        why = " ".join(str(error).split()) or f"nothing within {ANSWERS_IN_S:g} s"
        raise WrongInput(f"--scheduler {scheduler} does not answer: {why}") from None
    with client:
        wait_for_worker(client)
        said: Any = client.run(identity, on_error="return")
        refuse_strangers(said)
        yield client


async def _check_scheduler(address: str) -> None:
    """Ask who is there. Dask's client would wait for ever for one that says nothing."""
    async with asyncio.timeout(ANSWERS_IN_S), rpc(address, timeout=ANSWERS_IN_S) as there:
        found: Any = await there.identity()
    if found["type"] != "Scheduler":
        raise ValueError(f"it is a {found['type']}")


def refuse_strangers(said: Mapping[str, Identity | Exception]) -> None:
    """Refuse workers, by their addresses, that said of themselves what we would not.

    Raises:
        WrongInput: One of them has other code or packages, or none at all.
    """
    for worker, theirs in said.items():
        if isinstance(theirs, Exception):
            raise WrongInput(f"worker {worker} cannot run this package: {theirs}")
        names = [name for name, ours in identity().items() if theirs.get(name) != ours]
        if names:
            raise WrongInput(
                f"worker {worker} has another {', '.join(names)}: install the same release there"
            )
