"""Parallel function calls, in processes of this computer or on a Dask cluster."""

import logging
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from itertools import islice
from multiprocessing import active_children, get_context, parent_process
from multiprocessing.connection import wait as wait_for
from multiprocessing.resource_tracker import ensure_running
from threading import Thread
from typing import Any

from threadpoolctl import threadpool_limits

from fjh.study.errors import Unsound, WrongInput
from fjh.study.interrupts import notice, uninterrupted
from fjh.study.option import OnProgress
from fjh.study.provenance import code_sha256

CORES = len(os.sched_getaffinity(0))

ANSWERS_IN_S, PATIENCE_S = 5.0, 300.0
"""Longest time [s] that a scheduler may take to answer, and may have no workers."""

MOST_PENDING = 4000
"""Largest number of pending calls on a cluster, several for each core of a large one."""


def in_parallel(
    function: Callable[..., Any], calls: Sequence[dict[str, Any]], on_progress: OnProgress
) -> list[Any]:
    """Return the results of function(**call) in the order of `calls`; see :func:`finished`."""
    results: list[Any] = [None] * len(calls)
    on_progress(0, len(calls))
    with processes(min(len(calls), CORES)) as pool:
        for done, (number, result) in enumerate(finished(pool, function, calls), 1):
            results[number] = result
            on_progress(done, len(calls))
    return results


def call(work: Callable[..., Any], **arguments: Any) -> Any:
    """Call `work`; with this function, :func:`in_parallel` calls different functions."""
    return work(**arguments)


def finished(
    pool: Executor, function: Callable[..., Any], calls: Iterable[dict[str, Any]]
) -> Iterator[tuple[int, Any]]:
    """Yield number and result of each function(**call), in the order in which they finish.

    Calls are taken from the iterable when they can be submitted. Each uses one thread for linear
    algebra, because sums on several threads are rounded differently.

    Raises:
        Unsound: A worker was killed, or the connection to the scheduler was lost.
        Exception: The exception of a call.
    """
    waiting, running = enumerate(calls), dict[Any, int]()

    def submit(count: int) -> None:
        for number, arguments in islice(waiting, count):
            with uninterrupted():  # workers inherit the mask, and so do not get Ctrl-C either
                running[pool.submit(_on_one_thread, function, arguments)] = number

    try:
        submit(MOST_PENDING if not isinstance(pool, ProcessPoolExecutor) else 2 * CORES)
        while running:
            done, _ = wait(running, return_when=FIRST_COMPLETED)
            for future in done:
                number = running.pop(future)
                yield number, future.result()
                submit(1)
    except BrokenProcessPool:
        raise Unsound("a worker was killed, perhaps for lack of memory") from None
    except CancelledError:
        raise Unsound("the connection to the scheduler is lost") from None


def _on_one_thread(function: Callable[..., Any], arguments: dict[str, Any]) -> Any:
    with threadpool_limits(1):  # sums on several threads round differently
        return function(**arguments)


@contextmanager
def processes(count: int) -> Iterator[Executor]:
    """Make a pool of processes that end with the block, or with this process."""
    others = active_children()
    with uninterrupted():  # Python's resource tracker must survive a hang-up of the group
        ensure_running()
    # Not fork: threads of numerical libraries would be inherited in an unknown state.
    pool = ProcessPoolExecutor(max(count, 1), get_context("spawn"), _start_worker)
    try:
        yield pool
    finally:
        for process in set(active_children()) - set(others):
            process.kill()
        pool.shutdown(cancel_futures=True)


def _start_worker() -> None:
    Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    if (parent := parent_process()) is not None:
        wait_for([parent.sentinel])
        os._exit(1)


@contextmanager
def cluster(scheduler: str) -> Iterator[Executor]:
    """Connect to the workers of a Dask scheduler; a `tls://` address uses Dask's certificates.

    Raises:
        WrongInput: No scheduler answers, it has no workers in time, or a worker has another version
            of this package.
    """
    from distributed import Client  # late: it takes a second

    logging.getLogger("distributed").setLevel(logging.CRITICAL + 1)
    if not scheduler.startswith(("tls://", "wss://", "inproc://", "tcp://127.", "tcp://localhost")):
        notice(
            f"--scheduler {scheduler} is not encrypted: anyone who can reach that port can run "
            "programs as you, on its workers and here; use tls:// (docs/install.md)"
        )
    try:
        client = Client(scheduler, timeout=ANSWERS_IN_S)
    except Exception as error:  # depends on the program at that port, and on the scheme in Dask
        why = " ".join(str(error).split()) or f"nothing within {ANSWERS_IN_S:g} s"
        raise WrongInput(f"--scheduler {scheduler} does not answer: {why}") from None
    with client:
        if not client.scheduler_info()["workers"]:
            notice(f"the scheduler has no workers; waiting up to {PATIENCE_S:g} s for one")
        try:
            client.wait_for_workers(1, timeout=PATIENCE_S)
        except TimeoutError:
            why = f"the scheduler has had no workers for {PATIENCE_S:g} s"
            raise WrongInput(f"{why}: start some with dask worker") from None
        local, answers = code_sha256(), client.run(code_sha256, on_error="return")
        for worker, answer in answers.items():  # type: ignore[union-attr]
            if answer != local:
                why = answer if isinstance(answer, Exception) else "it has another release"
                raise WrongInput(f"worker {worker} cannot run this package: {why}")
        yield client.get_executor()
