"""Tests of signals at any moment: exit code, one sentence, and no files or processes left."""

import contextlib
import os
import signal
import subprocess
import time
from pathlib import Path

import psutil
import pytest

from tests.processes import CODES, assert_interrupted, start_python

EVERY_SIGNAL = pytest.mark.parametrize("number", CODES)
SIGINT_IN_SHORT_TESTS = pytest.mark.parametrize(
    "number", [signal.SIGINT, *(pytest.param(each, marks=pytest.mark.long) for each in [15, 1])]
)


def at(moment: str) -> subprocess.Popen[str]:
    """Start a command and wait until it has reached a line."""
    process = start_python("-c", moment)
    assert process.stdout
    assert process.stdout.readline() == "here\n"
    return process


IMPORTING = """
import sys, time, types
class Slow(types.ModuleType):
    def __getattr__(self, name):
        print("here", flush=True)
        time.sleep(60)
sys.modules["experiments.app.cli"] = Slow("experiments.app.cli")
import experiments.__main__
experiments.__main__.run()
"""
"""Code in which a stub replaces the slow imports of packages."""

RUNNING = """
import sys, time
import experiments.__main__
from experiments.app import cli
def measure(*, on_progress):
    {work}
cli.PAPER["measure"], cli.study = "", lambda _: measure
sys.argv[1:] = ["measure", "--out", {out!r}]
experiments.__main__.run()
"""


def running(out: Path, work: str) -> subprocess.Popen[str]:
    """Start a study with this work and wait until it runs."""
    return at(RUNNING.format(work=work, out=str(out)))


@SIGINT_IN_SHORT_TESTS
def test_a_signal_during_the_imports_ends_the_command(number):
    process = at(IMPORTING)
    process.send_signal(number)
    assert_interrupted(process, number)


def test_nohup_is_respected():
    """A signal ignored at the start of the process has no effect."""
    process = at(f"import signal; signal.signal(signal.SIGHUP, signal.SIG_IGN)\n{IMPORTING}")
    process.send_signal(signal.SIGHUP)
    time.sleep(0.2)
    assert process.poll() is None
    process.send_signal(signal.SIGTERM)
    assert_interrupted(process, signal.SIGTERM)


CLEARING = """
    try:
        print("here", flush=True)
        time.sleep(60)
    finally:
        print("clearing", flush=True)
        time.sleep(0.3)
        print("cleared", flush=True)
"""


@SIGINT_IN_SHORT_TESTS
def test_signals_during_a_study_and_its_cleanup_end_it(number, tmp_path):
    """Signals may be sent several times, as by `timeout` or repeated Ctrl-C."""
    process = running(tmp_path / "out", CLEARING)
    process.send_signal(number)
    assert process.stdout and process.stdout.readline() == "clearing\n"
    for signal_number in CODES:
        process.send_signal(signal_number)
    assert process.stdout.readline() == "cleared\n"
    assert_interrupted(process, number)
    assert not (tmp_path / "out").exists()


FAILING = """
    try:
        print("here", flush=True)
        time.sleep(60)
    except BaseException:
        raise RuntimeError("no compiled object yet") from None
"""


@pytest.mark.long
@EVERY_SIGNAL
def test_an_error_caused_by_a_signal_counts_as_the_signal(number, tmp_path):
    """An interrupted library may raise any error."""
    process = running(tmp_path / "out", FAILING)
    process.send_signal(number)
    assert_interrupted(process, number)


PARALLEL = """
    from fjh.study.workers import in_parallel
    print("here", flush=True)
    in_parallel(print, [{"sep": " ", "end": "", "flush": True}] * 100000, lambda *_: None)
"""


def works(process: subprocess.Popen[str]) -> bool:
    """Return whether a process has a worker."""
    with contextlib.suppress(psutil.Error):  # it may have ended
        children = psutil.Process(process.pid).children()
        return any("spawn_main" in word for child in children for word in child.cmdline())
    return False


@pytest.mark.long
@pytest.mark.night
@EVERY_SIGNAL
@pytest.mark.parametrize("later_s", [0.0, 0.3])
@pytest.mark.parametrize("whom", [os.kill, os.killpg])
def test_a_signal_while_workers_start_ends_the_study(number, later_s, whom, tmp_path):
    process = running(tmp_path / "out", PARALLEL)
    deadline = time.monotonic() + 60
    while not works(process) and time.monotonic() < deadline:
        time.sleep(0.01)
    time.sleep(later_s)
    whom(process.pid, number)
    assert_interrupted(process, number)
    assert not (tmp_path / "out").exists()


@pytest.mark.long
@pytest.mark.night
@EVERY_SIGNAL
@pytest.mark.parametrize("after_s", [1.0, 3.0])
def test_a_signal_ends_a_real_study(number, after_s, tmp_path):
    process = start_python("-m", "experiments", "table1", "--out", str(tmp_path / "out"))
    time.sleep(after_s)
    os.killpg(process.pid, number)
    assert_interrupted(process, number)
    assert not list((tmp_path / "out").glob("*"))
