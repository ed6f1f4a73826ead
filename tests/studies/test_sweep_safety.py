"""What a sweep leaves can be checked by its readers, and is written by one process at a time."""

import fcntl
import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from experiments.app.cli import main
from experiments.study.dataset import Columns, check_merged
from experiments.study.lock import LOCK, alone_in
from experiments.study.parquet import Broken
from experiments.study.resumable import UNFINISHED
from experiments.study.study import WrongInput
from experiments.sweep.row import SCHEMA


@pytest.mark.long
@pytest.mark.parametrize("study", ["sweep", "atlas"])
def test_the_finished_files_have_checksums_and_their_readers_compare_them(request, tmp_path, study):
    folder = request.getfixturevalue(f"{study}_folder")
    summary = json.loads((folder / f"{study}.json").read_text())
    path = folder / f"{study}.parquet"
    check_merged(path, summary["runs"], summary["basis"], SCHEMA)
    copy = Path(shutil.copy(path, tmp_path))
    chunks = pq.ParquetFile(path).metadata.row_group(0)
    columns = [chunks.column(k) for k in range(chunks.num_columns)]
    [chunk] = [each for each in columns if each.path_in_schema == "alpha_rms_urad"]
    spoilt = bytearray(copy.read_bytes())
    spoilt[chunk.data_page_offset + chunk.total_compressed_size - 1] ^= 0xFF
    copy.write_bytes(spoilt)
    with pytest.raises(Broken, match="CRC"):
        check_merged(copy, summary["runs"], summary["basis"], SCHEMA)
    with pytest.raises(Broken, match="CRC"):
        Columns([copy])["alpha_rms_urad"]
    assert len(Columns([copy])["beta_rms_urad"]) == summary["runs"]


# Two at a time.

HOLD = """
import sys
from pathlib import Path
from experiments.study.dataset import Columns, check_merged
from experiments.study.lock import alone_in
with alone_in(Path(sys.argv[1])):
    print(flush=True)
    sys.stdin.read()
"""


def test_a_second_sweep_in_the_folder_is_refused_until_the_first_has_ended_however_it_did(
    tmp_path, capsys
):
    unfinished = tmp_path / "out" / UNFINISHED
    first = subprocess.Popen(
        [sys.executable, "-c", HOLD, str(unfinished)],
        cwd=Path(__file__).parents[2],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert first.stdout
    assert first.stdout.readline() == "\n"
    for command, words in (("sweep", []), ("sweep", ["--resume"]), ("atlas", [])):
        assert main([command, "--quick", *words, "--out", str(tmp_path / "out")]) == 2
        said = capsys.readouterr().err
        host = os.uname().nodename
        assert said == (
            f"fjh: {unfinished} is in use by process {first.pid} on {host}: wait for its end\n"
        )
    os.kill(first.pid, signal.SIGKILL)
    first.communicate()
    assert (unfinished / LOCK).exists()
    with alone_in(unfinished):
        assert str(os.getpid()) in (unfinished / LOCK).read_text()
        with pytest.raises(WrongInput, match=f"process {os.getpid()}"), alone_in(unfinished):
            pass
    assert not unfinished.exists() or not list(unfinished.iterdir())


def test_a_lock_taken_away_with_its_folder_locks_nothing(tmp_path, monkeypatch):
    """The former owner ended between our opening the file and our locking it."""
    folder = tmp_path / UNFINISHED
    lock = fcntl.flock
    taken = []

    def take_away_once(file, how):
        if not taken:
            taken.append(shutil.rmtree(folder))
        lock(file, how)

    monkeypatch.setattr("fcntl.flock", take_away_once)
    with alone_in(folder), pytest.raises(WrongInput), alone_in(folder):
        pass
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_cannot_be_locked_is_one_sentence(tmp_path, capsys):
    (tmp_path / UNFINISHED).write_text("mine")
    assert main(["sweep", "--out", str(tmp_path)]) == 2
    said = capsys.readouterr().err
    assert said == f"fjh: {tmp_path / UNFINISHED} could not be locked: File exists\n"
    assert (tmp_path / UNFINISHED).read_text() == "mine"
