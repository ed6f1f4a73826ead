"""Recordings of runs for several test modules."""

import os
from pathlib import Path
from typing import NamedTuple

import pytest

import fjh
from fjh.recording.render import DRIVER
from fjh.rig import Rig, Run
from sim import MODELS
from tests.synthetic import write_synthetic_run

# Without Mesa's driver pictures are empty; in CI that is an error.
NEEDS_DRIVER = pytest.mark.skipif(
    DRIVER is None and "CI" not in os.environ, reason="Mesa's Vulkan driver is not installed"
)


class Recorded(NamedTuple):
    """A recording, its rig and its run."""

    file: Path
    rig: Rig
    run: Run


@pytest.fixture(scope="session")
def recorded(tmp_path_factory) -> Recorded:
    """Recording of an arm, not of `models/`, whose second motor locks during the run."""
    folder = tmp_path_factory.mktemp("run")
    (folder / "own.xml").write_text((MODELS / "arm.xml").read_text() + "\n")
    rig = fjh.Rig.of_mjcf(folder / "own.xml", major=[3, 4], size=0.02, crossover=0.7)
    path = rig.path("circle", duration_s=0.3, turn_s=0.3)
    run = rig.fly(rig.controller(), path, failures=[fjh.Failure("motor2", "locked", 0.1)])
    fjh.record(folder / "new" / "run.rrd", rig, run)
    return Recorded(folder / "new" / "run.rrd", rig, run)


@pytest.fixture(scope="session")
def made(tmp_path_factory) -> Path:
    """Folder of a synthetic run of the hexapod."""
    folder = tmp_path_factory.mktemp("made")
    write_synthetic_run(folder)
    return folder
