"""kill -9 of a worker, of the scheduler, of the command itself: rows are kept, nothing stays."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import psutil
import pytest

from experiments.study.resumable import UNFINISHED

ROOT = Path(__file__).parents[2]
PYTHON = (sys.executable, "-m")
LONGEST_S = 120.0
pytestmark = [pytest.mark.long, pytest.mark.night]


@contextmanager
def running(*words: str, log: Path) -> Iterator[subprocess.Popen]:
    """A process that is killed in the end, with what it started."""
    with log.open("w") as out:
        process = subprocess.Popen([*PYTHON, *words], cwd=ROOT, stdout=out, stderr=out)
    try:
        yield process
    finally:
        if process.poll() is None:
            for each in [*psutil.Process(process.pid).children(recursive=True), process]:
                each.kill()
        process.wait()


@contextmanager
def dask(folder: Path) -> Iterator[tuple[str, subprocess.Popen, subprocess.Popen]]:
    """Address of a scheduler of this computer alone; it and its worker."""
    file = folder / "scheduler.json"
    file.unlink(missing_ok=True)
    here = ("--host", "127.0.0.1", "--no-dashboard")
    where = ("--scheduler-file", str(file))
    scheduler = running(
        *("distributed.cli.dask_scheduler", "--port", "0", *here, *where), log=folder / "scheduler"
    )
    with scheduler as process:
        wait_until(file.exists)
        worker = ("distributed.cli.dask_worker", *here, *where, "--nworkers", "2")
        with running(*worker, "--nthreads", "1", log=folder / "workers") as workers:
            wait_until(lambda: len(python_children(workers)) == 2)
            yield json.loads(file.read_text())["address"], process, workers


def wait_until(so: object) -> None:
    deadline_s = time.monotonic() + LONGEST_S
    while not so():  # type: ignore[operator]
        assert time.monotonic() < deadline_s
        time.sleep(0.02)


def python_children(process: subprocess.Popen) -> list[psutil.Process]:
    """Those that compute: not the one that tracks resources."""
    children = psutil.Process(process.pid).children(recursive=True)
    return [child for child in children if "spawn_main" in " ".join(child.cmdline())]


def computed_s(process: subprocess.Popen) -> float:
    """Of all that compute; imports take some seconds of it."""
    return sum(child.cpu_times().user for child in python_children(process))


def sweep(design: Path, out: Path, *more: str) -> tuple[str, ...]:
    return "experiments", "sweep", "--design", str(design), "--out", str(out), *more


def rows_kept(out: Path) -> bool:
    return any((out / UNFINISHED).glob("*.parquet"))


@pytest.fixture
def design(sweep_design, tmp_path):
    """Runs that take a minute of computing."""
    file = tmp_path / "design.toml"
    file.write_text(sweep_design.read_text().replace("runs = 30", "runs = 150"))
    return file


def test_a_worker_of_this_computer_is_replaced(design, tmp_path, sweep_bytes):
    with running(*sweep(design, tmp_path / "out"), log=tmp_path / "log") as process:
        wait_until(lambda: computed_s(process) > 8.0)
        python_children(process)[0].kill()
        assert process.wait(LONGEST_S) == 0
    assert "Traceback" not in (tmp_path / "log").read_text()
    assert (tmp_path / "out" / "sweep.parquet").read_bytes() == sweep_bytes(design)


@pytest.fixture
def sweep_bytes(tmp_path):
    """The file of an undisturbed sweep."""

    def make(design: Path) -> bytes:
        with running(*sweep(design, tmp_path / "whole"), log=tmp_path / "log") as process:
            assert process.wait(LONGEST_S) == 0
        return (tmp_path / "whole" / "sweep.parquet").read_bytes()

    return make


def test_without_its_scheduler_a_sweep_ends_with_a_sentence_and_goes_on_with_another(
    design, tmp_path, sweep_bytes
):
    out, log = tmp_path / "out", tmp_path / "log"
    with dask(tmp_path) as (address, scheduler, workers):
        with running(*sweep(design, out, "--scheduler", address), log=log) as process:
            wait_until(lambda: computed_s(workers) > 14.0)
            python_children(workers)[0].kill()  # its runs go to another
            time.sleep(1.0)
            scheduler.kill()
            assert process.wait(LONGEST_S) == 1
        said = log.read_text()
        assert said == (
            "fjh: the connection to the scheduler is lost; finished runs are kept, and --resume "
            "continues\n"
        )
        assert rows_kept(out)
    with (
        dask(tmp_path) as (address, _, _),
        running(*sweep(design, out, "--resume", "--scheduler", address), log=log) as process,
    ):
        assert process.wait(LONGEST_S) == 0
    assert (out / "sweep.parquet").read_bytes() == sweep_bytes(design)


def test_workers_end_with_their_command(design, tmp_path):
    """Even in the middle of a run."""
    with running(*sweep(design, tmp_path / "out"), log=tmp_path / "log") as process:
        wait_until(lambda: computed_s(process) > 8.0)
        workers = python_children(process)
        os.kill(process.pid, signal.SIGKILL)
        _, left = psutil.wait_procs(workers, timeout=3.0)
        assert not left
