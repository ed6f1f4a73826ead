"""Runs in processes of this machine: none is lost, whatever becomes of a process."""

import os
import signal
from multiprocessing import active_children
from pathlib import Path

import pytest

from experiments.study import parallel
from experiments.study.parallel import finished, in_parallel
from experiments.study.study import Unsound


@pytest.fixture(autouse=True)
def _all_end():
    """Whatever happens, no process is left."""
    before = active_children()  # of a cluster that other tests share
    yield
    assert set(active_children()) <= set(before)


def nothing(_done: int, _total: int) -> None:
    """No progress is shown."""


def square(number: int) -> int:
    return number**2


def test_results_are_in_the_order_of_the_calls_and_progress_is_told():
    told = []
    found = in_parallel(square, [{"number": k} for k in range(5)], lambda *of: told.append(of))
    assert found == [0, 1, 4, 9, 16]
    assert told == [(done, 5) for done in range(6)]


@pytest.mark.parametrize("runs", [1, 5])
def test_what_need_not_wait_is_done_a_step_after_each_run_and_all_of_it_in_the_end(runs):
    known = []

    def meanwhile(results):
        for _ in range(3):
            known.append(sum(result is not None for result in results))
            yield

    in_parallel(square, [{"number": k} for k in range(runs)], nothing, meanwhile)
    assert known == [min(k, runs) for k in (1, 2, 3)]


def threads() -> set[int]:
    import numpy  # noqa: F401  (which brings the library)
    from threadpoolctl import threadpool_info

    return {library["num_threads"] for library in threadpool_info()}


def test_a_process_computes_on_one_thread_whatever_the_parent_does(monkeypatch):
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "2")
    assert in_parallel(threads, [{}], nothing) == [{1}]


def refuse(what: str) -> None:
    raise ValueError(what)


def test_an_exception_of_a_run_is_raised_with_its_traceback():
    with pytest.raises(ValueError, match="too much") as raised:
        in_parallel(refuse, [{"what": "too much"}] * 3, nothing)
    assert "in refuse" in raised.value.__notes__[0]


def unprintable() -> object:
    return lambda: None


def test_a_result_that_cannot_be_sent_is_an_exception_of_the_run():
    with pytest.raises(AttributeError, match="pickle"):
        in_parallel(unprintable, [{}], nothing)


def fall(file: Path, times: int) -> int:
    """Kill the own process as many times."""
    before = file.stat().st_size
    if before < times:
        file.write_bytes(bytes(before + 1))
        os.kill(os.getpid(), signal.SIGKILL)
    return before


def test_what_a_killed_process_was_at_is_done_again_by_another(tmp_path):
    calls = [{"file": tmp_path / str(k), "times": k} for k in range(3)]
    for call in calls:
        call["file"].touch()
    assert in_parallel(fall, calls, nothing) == [0, 1, 2]


def test_a_run_that_ends_one_process_after_another_is_given_up(tmp_path):
    (tmp_path / "fallen").touch()
    with pytest.raises(Unsound, match="run 7 failed: it ended 4 workers"):
        list(finished([(7, fall, {"file": tmp_path / "fallen", "times": 99})], 1))
    assert (tmp_path / "fallen").stat().st_size == parallel.ALLOWED_DEATHS + 1


def wait_for_a_signal() -> None:
    signal.pause()


def test_all_processes_end_with_the_iterator_whatever_they_are_at():
    jobs = [(0, square, {"number": 3}), (1, wait_for_a_signal, {})]
    found = finished(jobs, 2)
    assert next(found) == (0, 9)
    found.close()


def test_jobs_are_taken_when_they_begin():
    taken = []
    jobs = ((taken.append(k) or k, square, {"number": k}) for k in range(100))
    found = finished(jobs, 2)
    next(found)
    assert taken == [0, 1, 2]
    found.close()
