"""Independent runs in parallel on the machine's cores."""

import multiprocessing
import signal
from collections.abc import Callable, Sequence
from typing import Any


def in_parallel(
    function: Callable[..., Any],
    calls: Sequence[dict[str, Any]],
    on_progress: Callable[[int, int], None],
) -> list[Any]:
    """Results of function(**call), in the order of `calls`, however they finish.

    An exception in a run ends all of them and is raised here; so does Ctrl-C. Only the main thread
    may call this: it is the one that Python lets handle signals.
    """
    # spawn: a fork would inherit the threads of numerical libraries in an unknown state.
    context = multiprocessing.get_context("spawn")
    workers = min(len(calls), multiprocessing.cpu_count())
    results: list[Any] = [None] * len(calls)
    jobs = [(function, index, call) for index, call in enumerate(calls)]
    # Ctrl-C goes to the whole process group: workers ignore it, and the parent ends them.
    handler = signal.signal(signal.SIGINT, signal.SIG_IGN)
    pool = context.Pool(workers)
    signal.signal(signal.SIGINT, handler)
    with pool:
        on_progress(0, len(calls))
        for done, (index, result) in enumerate(pool.imap_unordered(_run, jobs), 1):
            results[index] = result
            on_progress(done, len(calls))
    return results


def _run(job: tuple[Callable[..., Any], int, dict[str, Any]]) -> tuple[int, Any]:
    function, index, call = job
    return index, function(**call)
