"""Independent runs in parallel, in processes of this machine."""

import os
import pickle
import signal
from collections import Counter
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import closing, suppress
from itertools import islice
from multiprocessing import get_context, parent_process
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from multiprocessing.resource_tracker import ensure_running
from threading import Thread
from traceback import format_exc
from typing import Any

from experiments.study.interrupts import SIGNALS, uninterrupted
from experiments.study.study import OnProgress, Unsound

CORES = len(os.sched_getaffinity(0))

ALLOWED_DEATHS = 3
"""Of workers, by one run; Dask allows as many."""

ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
"""Of each worker, as of Dask's: other numbers round differently, and the cores are taken."""

Job = tuple[int, Callable[..., Any], dict[str, Any]]
"""A number, a function, and what it is called with by keyword."""


def in_parallel(
    function: Callable[..., Any],
    calls: Sequence[dict[str, Any]],
    on_progress: OnProgress,
    meanwhile: Callable[[list[Any]], Iterator[object]] = lambda results: iter(()),
) -> list[Any]:
    """Results of function(**call), in the order of `calls`; raises as :func:`finished`.

    An exception in a run ends all of them; so does Ctrl-C. `meanwhile` does what need not wait for
    all runs, one step after each of them: its list has their results so far, None of the others.
    """
    results: list[Any] = [None] * len(calls)
    jobs = ((number, function, each) for number, each in enumerate(calls))
    steps = meanwhile(results)
    on_progress(0, len(calls))
    with closing(finished(jobs, min(len(calls), CORES))) as found:
        for done, (number, result) in enumerate(found, 1):
            results[number] = result
            on_progress(done, len(calls))
            next(steps, None)
    for _ in steps:  # there were fewer runs
        pass
    return results


def call(work: Callable[..., Any], **arguments: Any) -> Any:
    """Call `work`: the function for :func:`in_parallel` where each call names its own."""
    return work(**arguments)


def finished(jobs: Iterable[Job], workers: int) -> Generator[tuple[int, Any], None, None]:
    """Number and result of each job, in the order in which they finish.

    Jobs are taken when they begin. If a worker is killed, another does its job. All workers end
    with the iterator, which whoever leaves it early has to close.

    Raises:
        Unsound: A run ended several workers.
        Exception: That of a run; a note has the worker's traceback.
    """
    waiting, deaths = iter(jobs), Counter[int]()
    processes: list[BaseProcess] = []
    busy: dict[Any, Job] = {}  # by the pipe to its worker

    def begin(job: Job) -> None:
        with uninterrupted():  # until it is known, and can be ended
            process, pipe = _worker()
            processes.append(process)
        give(pipe, job)

    def give(pipe: Any, job: Job) -> None:
        busy[pipe] = job
        with suppress(BrokenPipeError):  # it was killed: there will be no answer
            pipe.send(job)

    try:
        for job in islice(waiting, workers):
            begin(job)
        while busy:
            ready: list[Any] = wait(list(busy))
            for pipe in ready:
                job = busy.pop(pipe)
                try:
                    result, error = pipe.recv()
                except (EOFError, ConnectionResetError):  # it was killed
                    deaths[job[0]] += 1
                    if deaths[job[0]] > ALLOWED_DEATHS:
                        why = f"ended {deaths[job[0]]} workers, perhaps for want of memory"
                        raise Unsound(f"run {job[0]} failed: it {why}") from None
                    begin(job)
                    continue
                if error is not None:
                    raise error
                for following in islice(waiting, 1):
                    give(pipe, following)
                yield job[0], result
    finally:
        for process in processes:
            process.kill()  # at once, even while it starts
        for process in processes:
            process.join()


def _worker() -> tuple[BaseProcess, Connection]:
    """A process that does what comes through the pipe, and never sees Ctrl-C.

    That goes to the whole process group; only the parent answers, and ends its workers.
    """
    # spawn: a fork would inherit the threads of numerical libraries in an unknown state.
    context = get_context("spawn")
    pipe, its = context.Pipe()
    process = context.Process(target=_work, args=(its,), daemon=True)
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
    own = {name: os.environ[name] for name in ONE_THREAD if name in os.environ}
    os.environ.update(ONE_THREAD)  # before the caller's own script, which spawn runs, brings numpy
    try:
        ensure_running()  # of itself it would unblock them while the process starts
        signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
        process.start()
    finally:
        for name in ONE_THREAD:
            del os.environ[name]
        os.environ.update(own)
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
    its.close()  # so that the pipe ends with the process
    return process, pipe


def _end_with_parent() -> None:
    """End this process when its parent has ended, however it did, whatever is under way."""
    if (parent := parent_process()) is not None:
        wait([parent.sentinel])
        os._exit(1)


def _work(pipe: Connection) -> None:
    for each in SIGNALS:
        signal.signal(each, signal.SIG_IGN if each == signal.SIGINT else signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS)
    Thread(target=_end_with_parent, daemon=True).start()
    with suppress(EOFError, OSError):  # the parent was killed
        while True:
            _, function, arguments = pipe.recv()
            pipe.send_bytes(_answer(function, arguments))


def _answer(function: Callable[..., Any], arguments: dict[str, Any]) -> bytes:
    """Result and exception, one of them None."""
    try:
        return pickle.dumps((function(**arguments), None))
    except Exception as error:
        error.add_note(format_exc())
        return pickle.dumps((None, error))
