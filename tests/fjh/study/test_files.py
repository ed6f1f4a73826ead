"""A set of files is published completely or not at all, and states its origin."""

import json
import re
import resource
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
import rerun.blueprint as rrb

from experiments.app.cli import main
from fjh.recording.file import RecordingInfo, log_series, recording_file, screen, time_column
from fjh.study import provenance
from fjh.study.errors import OutputError
from fjh.study.files import published, write_arrays, write_index, write_json
from tests.synthetic import write_synthetic_run

BYTES = 512
"""Largest file size [bytes] on the simulated full disk."""


def write(folder: Path, index: str, *names: str) -> None:
    with published(folder, index=index) as staging:
        for name in names:
            (staging / name).write_text("x")
        write_index(staging / index, {"seed": 0})


def contents(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def test_a_run_replaces_what_the_same_command_wrote_and_nothing_else(tmp_path):
    write(tmp_path, "long.json", "a.npz", "b.npz")
    write(tmp_path, "other.json", "c.npz")
    (tmp_path / "mine.txt").write_text("mine")
    index = json.loads((tmp_path / "long.json").read_text())
    assert index == {"seed": 0, "files": ["a.npz", "b.npz", "long.json"]}
    write(tmp_path, "long.json", "a.npz")
    assert contents(tmp_path) == {"long.json", "a.npz", "other.json", "c.npz", "mine.txt"}


@pytest.mark.parametrize(
    "old", ["no JSON", "[]", '{"files": [3, null]}', '{"files": ["../mine.txt", "below", "", "."]}']
)
def test_an_index_of_another_program_removes_nothing(tmp_path, old):
    folder = tmp_path / "out"
    (folder / "below").mkdir(parents=True)
    (tmp_path / "mine.txt").write_text("mine")
    (folder / "index.json").write_text(old)
    write(folder, "index.json", "a.npz")
    assert contents(folder) == {"index.json", "a.npz", "below"}
    assert contents(tmp_path) == {"out", "mine.txt"}


@pytest.mark.parametrize("raised", [KeyboardInterrupt, OSError, ValueError])
def test_an_interrupted_run_leaves_no_folder_and_an_old_one_whole(tmp_path, raised):
    write(tmp_path / "old", "index.json", "a.npz")
    for folder in (tmp_path / "new" / "er", tmp_path / "old"):
        with (
            pytest.raises(OutputError if raised is OSError else raised),
            published(folder, index="index.json") as staging,
        ):
            (staging / "a.npz").write_text("half")
            raise raised
    assert contents(tmp_path) == {"old"}
    assert contents(tmp_path / "old") == {"index.json", "a.npz"}
    assert (tmp_path / "old" / "a.npz").read_text() == "x"


def test_files_that_cannot_all_be_written_leave_the_old_ones_whole(tmp_path):
    (tmp_path / "index.json").write_text("old")
    (tmp_path / "b.npz").mkdir()
    with (
        pytest.raises(OutputError, match=r"b\.npz is a folder"),
        published(tmp_path, index="index.json") as staging,
    ):
        for name in ("a.npz", "b.npz", "index.json"):
            (staging / name).write_text("new")
    assert contents(tmp_path) == {"index.json", "b.npz"}
    assert (tmp_path / "index.json").read_text() == "old"


@contextmanager
def full_disk():
    """Limit all files to `BYTES`; not a fixture, since pytest's output may go to a file."""
    former = resource.getrlimit(resource.RLIMIT_FSIZE)
    compiled, sys.dont_write_bytecode = sys.dont_write_bytecode, True  # or Python cuts it off
    resource.setrlimit(resource.RLIMIT_FSIZE, (BYTES, former[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, former)
        sys.dont_write_bytecode = compiled


def write_recording(path: Path) -> None:
    time_s = np.arange(1000.0)
    about = RecordingInfo("a", "a", "notes", {})
    with recording_file(path, about, screen(rrb.Horizontal())) as recording:
        log_series(recording, time_column(time_s), "x", ["a [1]"], time_s[:, None])


WRITERS = {
    "a.npz": lambda path: write_arrays(path, {"x": np.arange(1000.0)}),
    "a.json": lambda path: write_json(path, {"x": list(range(1000))}),
    "a.png": lambda path: path.write_bytes(bytes(10 * BYTES)),
    "a.rrd": write_recording,
}


@pytest.mark.parametrize("name", WRITERS)
def test_no_truncated_file_is_published(tmp_path, name):
    (tmp_path / "a.json").write_text("old")
    with (
        pytest.raises(OutputError, match=f"^{tmp_path} could not be written: [^\n]+$"),
        full_disk(),
        published(tmp_path, index="a.json") as staging,
    ):
        WRITERS[name](staging / name)
    assert contents(tmp_path) == {"a.json"}
    assert (tmp_path / "a.json").read_text() == "old"


def test_review_on_a_full_disk_is_one_sentence_and_no_file(tmp_path, capfd):
    write_synthetic_run(tmp_path)
    out = tmp_path / "new" / "review.rrd"
    with full_disk():
        assert main(["review", str(tmp_path), "--out", str(out)]) == 2
    message = capfd.readouterr().err
    assert (
        message.startswith(f"fjh: {out.parent} could not be written: ") and message.count("\n") == 1
    )
    assert not out.parent.exists()


@pytest.mark.parametrize("part", [slice(-1), slice(-100), slice(-5000), slice(0)])
def test_a_recording_that_cannot_be_read_back_is_not_published(tmp_path, monkeypatch, part):
    """The disk silently loses the end of the file, or all of it."""
    write_bytes = Path.write_bytes
    monkeypatch.setattr(Path, "write_bytes", lambda path, data: write_bytes(path, data[part]))
    with (
        pytest.raises(OutputError, match=r"a\.rrd cannot be read back: [^\n]+$"),
        published(tmp_path, index="a.rrd") as staging,
    ):
        write_recording(staging / "a.rrd")
    assert list(tmp_path.iterdir()) == []


def test_the_code_hash_changes_with_a_source_and_not_with_the_report(tmp_path, monkeypatch):
    monkeypatch.setattr(provenance, "ROOT", tmp_path)
    hashes = {provenance.code_sha256()}
    folders = ("argument_checks/a.py", "prioritized/a.py", "experiments/a.py")
    page = "experiments/app/page.py"
    for name in ("sim/a.py", "sim/b/a.py", "models/a.xml", *folders, "sim/a.py", page):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(str(len(hashes)))
        hashes.add(provenance.code_sha256())
    assert len(hashes) == 8


def test_a_commit_is_stated_only_in_the_projects_own_checkout(tmp_path, monkeypatch):
    assert re.match(r"[0-9a-f]{40}(, with uncommitted changes)?$|not a git", provenance.commit())
    monkeypatch.setattr(provenance, "HERE", tmp_path)
    assert provenance.commit() == "not a git checkout"
    subprocess.run(["git", "init", "-q", str(tmp_path)], check=True)
    assert provenance.commit() == "not a git checkout"
