"""Tests of parallel runs with saved rows: reproducible and never lost."""

import json
import os
import resource
import shutil
import subprocess
import sys
from contextlib import contextmanager
from dataclasses import replace
from multiprocessing import active_children
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from experiments.app.command import conduct
from experiments.study import Where, basis_of, rows_of
from fjh.study import provenance, workers
from fjh.study.errors import Interrupted, OutputError, Unsound, WrongInput
from fjh.study.files import LOCK, STAGING, UNFINISHED, alone_in
from fjh.study.option import OnProgress
from fjh.study.result import Result
from fjh.study.workers import finished, in_parallel, processes
from tests.experiments import work
from tests.experiments.work import TEN, failing, row

ROOT = Path(__file__).parents[2]


@pytest.fixture(autouse=True)
def _all_end():
    """Check that no process is left."""
    before = active_children()  # the cluster is shared by other tests
    yield
    assert set(active_children()) <= set(before)


def no_progress(_done: int, _total: int) -> None:
    """Ignore progress."""


@pytest.mark.long
def test_results_are_in_the_order_of_the_calls_and_of_one_thread(monkeypatch):
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "2")
    progress_calls = []
    calls = [{"number": k} for k in range(5)]
    results = in_parallel(work.square, calls, lambda *of: progress_calls.append(of))
    assert results == [(k**2, {1}) for k in range(5)]
    assert progress_calls == [(done, 5) for done in range(6)]


@pytest.mark.long
@pytest.mark.parametrize(
    ("function", "arguments", "error", "message"),
    [
        (work.refuse, {"what": "too much"}, ValueError, "too much"),
        (work.unprintable, {}, Exception, "pickle"),
        (work.kill_itself, {}, Unsound, "a worker was killed"),
    ],
)
def test_errors_in_a_process_are_raised(function, arguments, error, message):
    with pytest.raises(error, match=message):
        in_parallel(function, [arguments] * 3, no_progress)


@pytest.mark.long
def test_processes_end_with_their_block_and_take_calls_when_idle():
    taken = []
    calls = (taken.append(k) or {"number": k} for k in range(100))
    with processes(1) as pool:
        number, (square, *_) = next(finished(pool, work.square, calls))
        assert square == number**2  # finished calls come in any order
        pool.submit(work.wait_for_a_signal)
    assert len(taken) < 20


BASIS = basis_of(seed=0)


def table(folder: Path, runs=TEN, basis=BASIS, resume: bool | None = True, make=row, **options):
    arguments = {"where": Where(resume=resume), "on_progress": no_progress} | options
    return rows_of(runs, make, basis, name="many", folder=folder, **arguments)


@pytest.fixture
def here(monkeypatch):
    """Patch that simulates runs in this process."""

    def done(pool, function, calls):
        for number, call in enumerate(calls):
            yield number, function(**call)

    @contextmanager
    def none(_count):
        yield None

    monkeypatch.setattr("experiments.study.finished", done)
    monkeypatch.setattr("experiments.study.processes", none)


@pytest.fixture
def whole(here, tmp_path_factory) -> pd.DataFrame:
    """Rows of an uninterrupted study."""
    return table(tmp_path_factory.mktemp("whole"), resume=False)


def assert_same(rows: pd.DataFrame, whole: pd.DataFrame) -> None:
    pd.testing.assert_frame_equal(rows, whole, check_exact=True)


def test_rows_are_those_returned_with_nan_for_missing_values(whole):
    pd.testing.assert_frame_equal(
        whole.astype(object).where(whole.notna(), None),
        pd.DataFrame([row(run) for run in TEN], dtype=object),
        check_exact=True,
    )
    assert whole["nothing"].dtype == float and whole["case"].dtype == int


def stop_after(count: int):
    def progress(done: int, _total: int) -> None:
        if done == count:
            raise KeyboardInterrupt

    return progress


@pytest.mark.parametrize("count", [1, 7])
def test_interruptions_and_order_do_not_change_a_bit(tmp_path, whole, count):
    message = f"interrupted: {count} of 10 runs are saved; --resume continues"
    with pytest.raises(Interrupted, match=message):
        table(tmp_path, resume=False, on_progress=stop_after(count))
    with pytest.raises(WrongInput, match="has unfinished runs: add --resume"):
        table(tmp_path, resume=False)
    simulated = []
    result = table(tmp_path, make=lambda run: simulated.append(run.number) or row(run))
    assert simulated == list(range(count, 10))
    assert_same(result, whole)
    lines = (tmp_path / UNFINISHED).read_text().splitlines()
    shuffled = [lines[0], *np.random.default_rng(0).permutation(lines[1:])]
    (tmp_path / UNFINISHED).write_text("\n".join(shuffled) + "\n")
    assert_same(table(tmp_path), whole)


@pytest.mark.parametrize("incomplete", ["{", '{"case": 9', '{"case": 9, "value": 1e'])
def test_a_run_with_an_incomplete_line_is_repeated(tmp_path, whole, incomplete):
    with pytest.raises(Interrupted):
        table(tmp_path, on_progress=stop_after(9))
    with (tmp_path / UNFINISHED).open("a") as lines:
        lines.write(incomplete)
    for _ in range(2):
        assert_same(table(tmp_path), whole)


def test_published_rows_are_continued_with_more_runs_only(tmp_path, whole):
    five = table(tmp_path, TEN[:5], resume=False)
    Result({"basis": BASIS}, rows=five).publish("many", tmp_path)
    (tmp_path / UNFINISHED).unlink()
    simulated = []
    result = table(tmp_path, make=lambda run: simulated.append(run.number) or row(run))
    assert simulated == [5, 6, 7, 8, 9]
    assert_same(result, whole)
    (tmp_path / UNFINISHED).unlink()
    with pytest.raises(WrongInput, match="they have another seed"):
        table(tmp_path, basis=BASIS | {"seed": 1})


def test_other_runs_are_rejected_or_replaced(here, tmp_path):
    table(tmp_path)
    other = BASIS | {"seed": 1, "code_sha256": "0"}
    with pytest.raises(WrongInput, match="they have another seed, code_sha256"):
        table(tmp_path, basis=other)
    again = [replace(run, seed=1) for run in TEN]
    rows = table(tmp_path, again, basis=other, resume=None)
    assert rows["value"].tolist() == [row(run)["value"] for run in again]
    assert json.loads((tmp_path / UNFINISHED).read_text().splitlines()[0]) == other


@pytest.mark.long
def test_a_run_that_fails_in_a_process_is_reported_and_the_others_are_saved(tmp_path):
    message = "run 6 failed: ValueError in work.py, line [0-9]+: no such number; finished "
    message += "runs are saved, and --resume continues"
    with pytest.raises(Unsound, match=message):
        table(tmp_path, make=failing)
    assert len((tmp_path / UNFINISHED).read_text().splitlines()) > 4
    assert table(tmp_path)["value"].tolist() == [row(run)["value"] for run in TEN]


def test_ctrl_c_after_the_last_run_reports_saved_runs(here, tmp_path):
    """A study may compute for minutes after its rows."""

    def slow(*, folder: Path, on_progress: OnProgress) -> Result:
        table(folder)
        raise KeyboardInterrupt

    with pytest.raises(Interrupted, match="finished runs are saved, and --resume continues"):
        conduct(slow, tmp_path, show=False)
    assert len((tmp_path / UNFINISHED).read_text().splitlines()) == 11


def test_a_full_disk_is_one_sentence_and_complete_rows_are_saved(tmp_path, whole, monkeypatch):
    monkeypatch.setattr(sys, "dont_write_bytecode", True)  # else a truncated file could be imported
    limit = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1500, limit[1]))
    try:
        with pytest.raises(OutputError, match=r"could not be written: File too large"):
            table(tmp_path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limit)
    assert_same(table(tmp_path), whole)


WAITING = """
import sys
from pathlib import Path
from fjh.study.files import alone_in
with alone_in(Path(sys.argv[1])):
    print(flush=True)
    sys.stdin.read()
"""


def test_a_folder_is_locked_until_its_study_is_killed(tmp_path):
    folder, command = tmp_path / "out", [sys.executable, "-c", WAITING, str(tmp_path / "out")]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, cwd=ROOT, **pipes) as first:
        assert first.stdout and first.stdout.readline() == "\n"
        with pytest.raises(WrongInput, match="is in use by another study"), alone_in(folder):
            pass
        first.kill()
    (folder / f"{STAGING}x").mkdir()  # the incomplete file
    assert (folder / LOCK).exists()
    with alone_in(folder):
        pass
    assert list(folder.iterdir()) == []


@pytest.mark.long
def test_a_scheduler_gives_the_same_rows_and_rejects_another_release(
    scheduler, whole, monkeypatch, tmp_path
):
    assert_same(table(tmp_path, where=Where(scheduler=scheduler)), whole)
    monkeypatch.setattr(provenance, "ROOT", tmp_path)
    with pytest.raises(WrongInput, match="it has another release"), workers.cluster(scheduler):
        pass
    monkeypatch.setattr(workers, "ANSWERS_IN_S", 0.5)
    address = "tcp://127.0.0.1:9"
    with pytest.raises(WrongInput, match=f"{address} does not answer"), workers.cluster(address):
        pass


@pytest.mark.parametrize(
    "address", ["tcp://head:8786", "head:8786", "tls://head:8786", "tcp://127.0.0.1:1"]
)
def test_an_unencrypted_remote_scheduler_causes_a_warning(address, capsys, monkeypatch):
    def refuses(*_: object, **__: object) -> None:
        raise OSError("no client here")

    monkeypatch.setitem(sys.modules, "distributed", SimpleNamespace(Client=refuses))
    with pytest.raises(WrongInput, match="no client here"), workers.cluster(address):
        pass
    message, warned = capsys.readouterr().err, not address.startswith(("tls://", "tcp://127."))
    assert ("is not encrypted" in message) == warned and message.count("\n") == warned


TLS = """
from distributed import LocalCluster, Security
from experiments.app.command import conduct
from experiments.study import Where, basis_of, rows_of
from fjh.study.errors import WrongInput
from pathlib import Path
from tests.experiments.work import TEN, row
if __name__ == "__main__":
    with LocalCluster(
        n_workers=1, threads_per_worker=1, host="tls://127.0.0.1", dashboard_address=None,
        protocol="tls://", security=Security(), silence_logs=50,
    ) as crew:
        for address in (crew.scheduler_address, crew.scheduler_address.replace("tls", "tcp")):
            how = {"name": "many", "folder": Path("out"), "on_progress": lambda *_: None}
            where = Where(scheduler=address, resume=None)
            try:
                print(len(rows_of(TEN, row, basis_of(seed=0), where, **how)))
                Path("out/unfinished.jsonl").unlink()
            except WrongInput:
                print("refused")
"""


@pytest.mark.long
@pytest.mark.skipif(not shutil.which("openssl"), reason="certificates are made by openssl")
def test_a_cluster_runs_over_tls_with_the_documented_certificate(tmp_path):
    page = (ROOT / "docs" / "install.md").read_text()
    [made] = [block.split("```")[0] for block in page.split("```sh\n") if "openssl" in block[:9]]
    (tmp_path / "tls.py").write_text(TLS)
    done = subprocess.run(
        ["bash", "-ec", f"{made}\nexec {sys.executable} tls.py"],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stdout.splitlines()[-2:] == ["10", "refused"], done.stderr
