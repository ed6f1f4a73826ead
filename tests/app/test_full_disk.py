"""A disk that takes no more: one sentence, nothing published, and no former file lost."""

import resource
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
import rerun.blueprint as rrb

from experiments.app.cli import main
from fjh.recording.file import (
    RecordingInfo,
    log_series,
    recording_file,
    screen,
    time_column,
)
from fjh.study.errors import OutputError
from fjh.study.files import published, write_arrays, write_json
from fjh.study.plotting import new_figure, save_figure
from tests.made import keep_made

ROOM = 512
"""Bytes that go into a file of the full disk."""


@contextmanager
def full_disk():
    """No file may grow beyond `ROOM`. Not as a fixture: pytest's own output may go to a file."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (ROOM, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    """A folder with one run."""
    folder = tmp_path_factory.mktemp("kept")
    keep_made(folder)
    return folder


def write_recording(path: Path) -> None:
    time_s = np.arange(1000.0)
    with recording_file(
        path, RecordingInfo("a", "a", "notes", {}), screen(rrb.Horizontal())
    ) as recording:
        log_series(recording, time_column(time_s), "x", ["a [1]"], time_s[:, None])


def write_figure(path: Path) -> None:
    save_figure(new_figure(4, 4), path.parent, path.stem, (path.suffix[1:],))


WRITERS = {
    "a.npz": lambda path: write_arrays(path, {"x": np.arange(1000.0)}),
    "a.json": lambda path: write_json(path, {"x": list(range(1000))}),
    "a.png": write_figure,
    "a.pdf": write_figure,
    "a.rrd": write_recording,
}


@pytest.mark.parametrize("name", WRITERS)
def test_no_kind_of_file_is_published_cut_off(tmp_path, name):
    (tmp_path / "a.json").write_text("old")
    with (
        pytest.raises(OutputError, match=f"^{tmp_path} could not be written: [^\n]+$"),
        full_disk(),
        published(tmp_path, index="a.json") as staging,
    ):
        WRITERS[name](staging / name)
    assert [file.name for file in tmp_path.iterdir()] == ["a.json"]
    assert (tmp_path / "a.json").read_text() == "old"


def test_review_on_a_full_disk_is_one_sentence_and_no_file(kept, tmp_path, capfd):
    out = tmp_path / "new" / "review.rrd"
    with full_disk():
        assert main(["review", str(kept), "--out", str(out)]) == 2
    said = capfd.readouterr()
    assert said.err.startswith(f"fjh: {out.parent} could not be written: ")
    assert said.err.count("\n") == 1
    assert not out.parent.exists()


@pytest.mark.parametrize("held", [slice(-1), slice(-100), slice(-5000), slice(0)])
def test_a_recording_that_cannot_be_read_back_is_not_published(tmp_path, monkeypatch, held):
    """The disk loses the end, or all of the file, and reports no error."""
    write = Path.write_bytes
    monkeypatch.setattr(Path, "write_bytes", lambda path, data: write(path, data[held]))
    with (
        pytest.raises(OutputError, match=r"a\.rrd cannot be read back: [^\n]+$"),
        published(tmp_path, index="a.rrd") as staging,
    ):
        write_recording(staging / "a.rrd")
    assert list(tmp_path.iterdir()) == []
