"""What a killed run leaves is removed by the next; files of a living run or of a person stay."""

import fcntl
import subprocess
import sys
from pathlib import Path

import pytest

from experiments.study import files
from experiments.study.files import published

WRITES = """
import sys
from pathlib import Path
from experiments.study.files import published

with published(Path(sys.argv[1]), index="theirs.json") as folder:
    (folder / "theirs.json").write_text("whole")
    print("writing", flush=True)
    sys.stdin.read()
"""


@pytest.fixture
def another_run(tmp_path):
    """A process in the middle of writing its files; it ends with its standard input."""
    command = [sys.executable, "-c", WRITES, str(tmp_path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdout
        assert process.stdout.readline() == b"writing\n"
        yield process
        process.kill()


def write(folder: Path) -> None:
    with published(folder, index="index.json") as place:
        (place / "index.json").write_text("new")


def contents(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def test_what_a_killed_run_leaves_is_removed_by_the_next(tmp_path, another_run):
    another_run.kill()
    another_run.wait()
    (left,) = contents(tmp_path)
    assert left.startswith(".fjh-")
    write(tmp_path)
    assert contents(tmp_path) == {"index.json"}


def test_a_living_run_loses_nothing(tmp_path, another_run):
    (theirs,) = contents(tmp_path)
    write(tmp_path)
    assert contents(tmp_path) == {theirs, "index.json"}
    another_run.communicate()
    assert contents(tmp_path) == {"theirs.json", "index.json"}
    assert (tmp_path / "theirs.json").read_text() == "whole"


def test_a_persons_own_files_stay(tmp_path):
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / ".fjh-12345678").symlink_to(tmp_path / "elsewhere")
    (tmp_path / ".fjh-abcdefgh").write_text("mine")
    (tmp_path / ".fjh-my-notes").mkdir()
    before = contents(tmp_path)
    write(tmp_path)
    assert contents(tmp_path) == before | {"index.json"}


def test_a_folder_that_was_removed_before_it_was_locked_is_made_again(tmp_path, monkeypatch):
    """Another run may look at just that moment."""
    removed = []

    def lock(handle: int, how: int) -> None:
        if not removed:
            removed.extend(tmp_path.iterdir())
            removed[0].rmdir()
        fcntl_flock(handle, how)

    fcntl_flock = fcntl.flock
    monkeypatch.setattr(files.fcntl, "flock", lock)
    write(tmp_path)
    assert len(removed) == 1
    assert contents(tmp_path) == {"index.json"}
