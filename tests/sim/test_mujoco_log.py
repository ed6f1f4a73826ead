"""MuJoCo's warnings go to a logger: no command leaves MUJOCO_LOG.TXT in the current folder."""

import logging
import subprocess
import sys
from pathlib import Path

import pytest

from fjh.study.workers import in_parallel
from sim import load_model

ODD = {
    "odd.xml": "<mujoco><include file='part.xml'/></mujoco>",
    "part.xml": "<mujoco><worldbody><geom size='1' mass='nan'/></worldbody></mujoco>",
}


@pytest.fixture
def here(tmp_path, monkeypatch):
    """The current folder, with a machine file of which MuJoCo warns, and nothing else."""
    monkeypatch.chdir(tmp_path)
    for name, content in ODD.items():
        (tmp_path / name).write_text(content)
    yield tmp_path
    assert {file.name for file in tmp_path.iterdir()} == set(ODD)


def load_odd() -> None:
    load_model("odd.xml")


def test_a_warning_goes_to_the_logger_and_into_no_file(here, caplog):
    with caplog.at_level(logging.WARNING, "sim"):
        load_odd()
    assert "NaN" in caplog.text


def alone(program: str) -> subprocess.CompletedProcess[str]:
    """A program of its own, which finds the project and nothing else."""
    root = str(Path(__file__).parents[2])
    return subprocess.run(
        [sys.executable, "-c", program],
        env={"PYTHONPATH": root},
        capture_output=True,
        text=True,
        check=True,
    )


@pytest.mark.parametrize(("first", "shown"), [("sim", True), ("experiments.app.cli", False)])
def test_a_program_without_logging_sees_it_and_a_command_does_not(here, first, shown):
    done = alone(f"import {first}, sim; sim.load_model('odd.xml')")
    assert ("NaN" in done.stderr) == shown


def test_nor_does_a_worker_write_one(here):
    in_parallel(load_odd, [{}], lambda done, total: None)


def test_a_programs_own_handler_stays(here):
    done = alone("""
import mujoco
mujoco.set_mju_user_warning(print)
import sim
sim.load_model("odd.xml")
""")
    assert "NaN" in done.stdout
