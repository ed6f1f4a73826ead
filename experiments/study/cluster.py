"""Runs on the workers of a Dask scheduler that somebody else started."""

import asyncio
import logging
import platform
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from ipaddress import ip_address
from itertools import islice
from typing import Any

from distributed import Client, Future, Security, as_completed, rpc
from distributed.comm.addressing import parse_address, parse_host_port

from experiments.study.basis import Sources, check_workers, digest, identity
from experiments.study.campaign import Campaign, Row, simulate
from experiments.study.interrupts import notice
from experiments.study.study import Unsound, WrongInput
from experiments.study.where import PATIENCE_S

ANSWERS_IN_S = 5.0
"""How long a scheduler may take to answer."""

IN_FLIGHT = 4000
"""Runs that the scheduler knows of at once: several for each core of a large cluster, and few
megabytes. Those of a worker that is lost go to another."""

POLL_S, LOOK_EVERY_S = 0.02, 5.0
"""Period of looking for results; and, while there are none, for workers."""

_KEPT = "finished runs are kept, and --resume continues"
_SILENT = logging.CRITICAL + 1


@contextmanager
def cluster(scheduler: str, sources: Sources) -> Iterator[Client]:
    """A client of the scheduler at an address; for `tls://`, with the certificates Dask is given.

    Raises:
        WrongInput: No scheduler answers there; or it has no workers, and gets none; or they have
            another version of this package.
    """
    with _silenced("distributed"), _silenced("distributed.client"):
        try:
            asyncio.run(_check_scheduler(scheduler))
            if not is_private(scheduler):
                notice(
                    f"--scheduler {scheduler} is not encrypted: whoever reaches that port runs "
                    "programs as you, on its workers and here; docs/security.md shows tls://"
                )
            client = Client(scheduler, timeout=ANSWERS_IN_S)
        except Exception as error:  # whatever there is at that port, and in Dask for that scheme
            why = " ".join(str(error).split()) or f"nothing within {ANSWERS_IN_S:g} s"
            raise WrongInput(f"--scheduler {scheduler} does not answer: {why}") from None
        with client:
            wait_for_worker(client)
            answers: Any = client.run(identity, sources, on_error="return")
            check_workers(identity(sources), answers)
            yield client


def is_private(address: str) -> bool:
    """Whether nobody else can listen or call: encrypted, or within this computer."""
    scheme, host = parse_address(address)
    if scheme in ("tls", "wss", "inproc"):
        return True
    name = parse_host_port(host, 0)[0]
    with suppress(ValueError):
        return ip_address(name).is_loopback
    return name == "localhost"


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


async def _check_scheduler(address: str) -> None:
    """Ask what is there: Dask's client would wait for ever for what does not answer."""
    how = {"connection_args": Security().get_connection_args("client"), "timeout": ANSWERS_IN_S}
    async with asyncio.timeout(ANSWERS_IN_S), rpc(address, **how) as there:
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
            finished.add(client.submit(_simulate, *work, key=key))

    submit(IN_FLIGHT)
    for future, result in _arriving(finished, client):
        if future.status == "error":
            raise _failure(future, result[1])
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
        elif time.monotonic() - looked_s > LOOK_EVERY_S:
            wait_for_worker(client)
            looked_s = time.monotonic()
        else:
            time.sleep(POLL_S)


def _failure(future: Future, error: Exception) -> Unsound:
    """The run's own, or which run ended its workers or was refused by one, and why."""
    if isinstance(error, Unsound):
        return error
    number = str(future.key).rpartition("-")[2]
    return Unsound(f"run {number} failed: {type(error).__name__}: {' '.join(str(error).split())}")


class ForeignWorker(RuntimeError):
    """A worker that would run other code: it joined later."""


def _simulate(row_of: Callable[[Any], Row], run: Any, sources: Sources, code: str) -> Row:
    """The row of a run, on a worker; `ForeignWorker` if its identity has not this digest."""
    if code != digest(identity(sources)):
        host = platform.node()
        raise ForeignWorker(f"{host} has another version of this package, or of what it needs")
    return simulate(row_of, run)
