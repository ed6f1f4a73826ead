"""Sweeps go on only from what is whole and theirs."""

import json
import resource
import shutil
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from experiments.app.cli import main
from experiments.study.dataset import REST, Dataset
from experiments.study.files import OutputError
from experiments.study.resumable import (
    UNFINISHED,
    Complete,
    complete,
    published_before,
    run_missing,
)
from experiments.study.study import WrongInput
from experiments.study.where import Where
from experiments.sweep.campaign import sweep_of
from experiments.sweep.design import Design, SweepRuns
from experiments.sweep.row import SCHEMA
from experiments.sweep.sweep_run import Range

TEN = SweepRuns(
    Design("latin-hypercube", 10, 0.05, (Range("roll_off_hz", 20.0, 30.0, False, None),)), 0
)
"""In three parts, of four, four and two."""
BASIS = sweep_of(TEN).basis
FIRST = "part-000000.parquet"


def row(run):
    """As a run would give, at no cost."""
    return run.parameters() | {"status": "exact", "alpha_rms_urad": np.sin(run.number)}


def rows(campaign, numbers, _where):
    return nullcontext(row(campaign.runs[number]) for number in numbers)


@pytest.fixture(autouse=True)
def _no_processes(monkeypatch):
    monkeypatch.setattr("experiments.study.dataset.PART", 4)
    monkeypatch.setattr("experiments.study.resumable.rows_of", rows)


def run_into(folder: Path, runs: SweepRuns = TEN, *, resume: bool = True):
    quiet = {"where": Where(), "on_progress": lambda done, total: None}
    return run_missing(folder, sweep_of(runs), resume=resume, **quiet)


def seven_of_ten(folder: Path, runs: SweepRuns = TEN) -> Path:
    """An unfinished dataset: a part, and three runs of the next."""
    dataset = Dataset(folder / UNFINISHED, len(runs), sweep_of(runs).basis, SCHEMA)
    for k in range(7):
        dataset.add(row(runs[k]))
    dataset.keep()
    return dataset.folder


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> list[bytes]:
    """The three parts, undisturbed."""
    with pytest.MonkeyPatch.context() as four:
        four.setattr("experiments.study.dataset.PART", 4)
        dataset = Dataset(tmp_path_factory.mktemp("whole") / UNFINISHED, 10, BASIS, SCHEMA)
        for k in range(10):
            dataset.add(row(TEN[k]))
        return [path.read_bytes() for path in dataset.files()]


# The basis.


def rewrite(text: str):
    return lambda path: path.write_text(text)


def make_a_folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


@pytest.mark.parametrize("words", [[], ["--resume"], ["--resume", "--seed", "5"]])
@pytest.mark.parametrize(
    "spoil",
    [
        Path.unlink,
        make_a_folder,
        *map(rewrite, ("", '{"seed": 0', "[]", "5", "null", '"seed"', "[" * 100_000, "\0" * 300)),
    ],
)
def test_runs_that_nothing_says_what_they_are_of_are_left_alone(tmp_path, capsys, spoil, words):
    """Resumed they would be mixed with others; begun anew, they would be taken for new ones."""
    unfinished = seven_of_ten(tmp_path)
    spoil(unfinished / "_basis.json")
    before = contents(unfinished)
    for command in ("sweep", "atlas"):
        assert main([command, "--quick", *words, "--out", str(tmp_path)]) == 2
        said = capsys.readouterr().err
        assert said.startswith(f"fjh: {unfinished / '_basis.json'} ")
        assert f"to start again, remove {unfinished}\n" in said
        assert said.count("\n") == 1
    assert contents(unfinished) == before


@pytest.mark.parametrize("text", ["{}", '{"seed": 5}'])
def test_a_basis_that_lacks_what_ours_has_is_another(tmp_path, text):
    (seven_of_ten(tmp_path) / "_basis.json").write_text(text)
    with pytest.raises(WrongInput, match="it has another design, seed, code_sha256"):
        run_into(tmp_path)


# What is not whole.


def places_of(path: Path) -> list[int]:
    """Places in a Parquet file: the last bytes of some numbers and words, and some all over it."""
    chunks = pq.ParquetFile(path).metadata.row_group(0)
    columns = {each.path_in_schema: each for each in map(chunks.column, range(chunks.num_columns))}
    ends = [
        columns[name].data_page_offset + columns[name].total_compressed_size - 2
        for name in ("alpha_rms_urad", "roll_off_hz", "seed", "status", "case")
    ]
    return [*ends, *range(4, path.stat().st_size - 1, 1000)]


@pytest.mark.long
def test_no_two_bytes_flipped_on_disk_change_a_row(tmp_path, whole):
    """They are noticed, and the runs of that file done again; or they held no number."""
    unfinished = seven_of_ten(tmp_path)
    kept, rows = contents(unfinished), [pq.read_table(pa.BufferReader(part)) for part in whole]
    noticed = 0
    for name in (FIRST, REST):
        for at in places_of(unfinished / name):
            for each, content in kept.items():
                (unfinished / each).write_bytes(content)
            flip(unfinished / name, at)
            dataset = Dataset(unfinished, 10, BASIS, SCHEMA)
            missing = list(dataset.missing())
            noticed += len(missing) > 3
            for k in missing:
                dataset.add(row(TEN[k]))
            found = [pq.read_table(path) for path in dataset.files()]
            assert all(map(pa.Table.equals, found, rows)), (name, at)
            for path in dataset.files():
                path.unlink()
    assert noticed > 20


def flip(path: Path, at: int) -> None:
    flipped = bytearray(path.read_bytes())
    flipped[at] ^= 0xFF
    flipped[at + 1] ^= 0x01
    path.write_bytes(flipped)


def truncate(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-100])


def empty(path: Path) -> None:
    path.write_bytes(b"")


def rows_of_another_sweep(path: Path) -> None:
    other = Dataset(path.parent / "other", 10, BASIS | {"seed": 5}, SCHEMA)
    for k in range(4):
        other.add(row(TEN[k]))
    (path.parent / "other" / FIRST).replace(path)
    shutil.rmtree(path.parent / "other")


def altered(change):
    def alter(path: Path) -> None:
        pq.write_table(change(pq.read_table(path)), path)

    return alter


SPOILT = {
    "truncated": truncate,
    "empty": empty,
    "text": rewrite("nothing that we wrote"),
    "other columns": altered(lambda rows: rows.drop_columns("alpha_rms_urad")),
    "another sweep": rows_of_another_sweep,
    "unsigned": altered(lambda rows: rows.replace_schema_metadata(None)),
    "too few": altered(lambda rows: rows.slice(1)),
    "twice": altered(lambda rows: pa.concat_tables([rows, rows.slice(0, 1)])),
    "one for another": altered(lambda rows: pa.concat_tables([rows.slice(0, 3), rows.slice(0, 1)])),
    "without a number": altered(
        lambda rows: rows.set_column(0, "case", [pa.array([None] * len(rows), pa.int64())])
    ),
}


@pytest.mark.parametrize("how", SPOILT)
@pytest.mark.parametrize("name", [FIRST, REST])
def test_a_file_that_is_not_what_was_written_is_one_sentence_and_its_runs_are_done_again(
    tmp_path, capsys, whole, name, how
):
    unfinished = seven_of_ten(tmp_path)
    if (name, how) == (REST, "too few"):
        return  # a rest is as long as it happens to be
    SPOILT[how](unfinished / name)
    ran = run_into(tmp_path)
    assert ran.took["runs"] == 3 + (4 if name == FIRST else 3)
    assert [path.read_bytes() for path in ran.dataset.files()] == whole
    said = capsys.readouterr().err
    assert said.startswith(f"fjh: {unfinished / name} is broken: ")
    assert said.endswith("; its runs are done again\n")
    assert said.count("\n") == 1


def test_many_broken_files_are_one_sentence(tmp_path, capsys, whole):
    unfinished = seven_of_ten(tmp_path)
    empty(unfinished / FIRST)
    empty(unfinished / REST)
    assert [path.read_bytes() for path in run_into(tmp_path).dataset.files()] == whole
    said = capsys.readouterr().err
    assert "its runs and those of 1 more broken files are done again" in said
    assert said.count("\n") == 1


def test_a_file_that_the_system_withholds_is_wrong_input_not_a_broken_one(tmp_path):
    unfinished = seven_of_ten(tmp_path)
    make_a_folder(unfinished / FIRST)
    with pytest.raises(OutputError, match=f"{FIRST} cannot be read: Is a directory"):
        run_into(tmp_path)


def test_a_part_that_breaks_while_the_sweep_runs_ends_it_with_one_sentence(tmp_path):
    dataset = run_into(tmp_path).dataset
    truncate(tmp_path / UNFINISHED / FIRST)
    with pytest.raises(OutputError, match=f"{FIRST} is broken"):
        dataset.merge(tmp_path / "merged.parquet")


# What was being written.


@contextmanager
def full_disk():
    """No file can grow beyond 3 kB: the system's own refusal, in the middle of a file."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (3000, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_a_full_disk_is_one_sentence_and_leaves_what_was_there(tmp_path):
    unfinished = seven_of_ten(tmp_path)
    before = contents(unfinished)
    with full_disk():
        dataset = Dataset(unfinished, 10, BASIS, SCHEMA)
        for write in (lambda: dataset.add(row(TEN[7])), dataset.keep):
            with pytest.raises(OutputError, match=r"could not be written: .*File too large"):
                write()
    assert contents(unfinished) == before


def test_a_part_whose_last_run_came_when_it_could_not_be_written_is_written_later(tmp_path, whole):
    """On a full disk, or by Ctrl-C in the middle: its runs are all with the rest."""
    dataset = Dataset(seven_of_ten(tmp_path), 10, BASIS, SCHEMA)
    with full_disk(), pytest.raises(OutputError):
        dataset.add(row(TEN[7]))
    dataset.keep()
    assert not list(dataset.files())[1].exists()
    assert list(Dataset(dataset.folder, 10, BASIS, SCHEMA).missing()) == [8, 9]
    ran = run_into(tmp_path)
    assert [path.read_bytes() for path in ran.dataset.files()] == whole


def test_a_published_sweep_is_taken_away_all_at_once(tmp_path, monkeypatch):
    """Ended in the middle, it would else leave runs that nothing says what they are of."""
    dataset = Dataset(seven_of_ten(tmp_path), 10, BASIS, SCHEMA)

    def end_in_the_middle(folder, *_arguments, **_options):
        next(Path(folder).rglob("_basis.json")).unlink()
        raise KeyboardInterrupt

    monkeypatch.setattr(shutil, "rmtree", end_in_the_middle)
    with pytest.raises(KeyboardInterrupt):
        dataset.remove()
    assert not dataset.folder.exists()


# What is finished.


@pytest.fixture
def finished(tmp_path) -> Path:
    """A folder with the ten runs, and an index that says no more than it must."""
    dataset = run_into(tmp_path).dataset
    dataset.merge(tmp_path / "sweep.parquet")
    dataset.remove()
    index = {"basis": BASIS, "dataset": "sweep.parquet"}
    (tmp_path / "sweep.json").write_text(json.dumps(index))
    assert published_before(tmp_path, "sweep", sweep_of(TEN)) == index
    return tmp_path


@pytest.mark.parametrize(
    ("name", "spoil"),
    [
        ("sweep.parquet", Path.unlink),
        *(("sweep.parquet", SPOILT[how]) for how in SPOILT if how != "another sweep"),
        ("sweep.parquet", lambda path: flip(path, places_of(path)[0])),
        ("sweep.json", truncate),
        ("sweep.json", rewrite("[]")),
        ("sweep.json", rewrite('{"basis": 5, "dataset": "sweep.parquet"}')),
        ("sweep.json", rewrite('{"basis": {}, "dataset": 5}')),
    ],
)
def test_a_finished_sweep_that_is_not_whole_is_one_sentence_and_done_again(
    finished, capsys, name, spoil
):
    spoil(finished / name)
    assert published_before(finished, "sweep", sweep_of(TEN)) is None
    said = capsys.readouterr().err
    assert said.startswith(f"fjh: {finished / name} is broken")
    assert said.endswith("; all runs are done again\n")
    assert said.count("\n") == 1


def test_a_finished_sweep_beside_runs_of_unknown_origin_is_not_taken_for_them(finished):
    (seven_of_ten(finished) / "_basis.json").unlink()
    with pytest.raises(WrongInput, match="is missing"):
        published_before(finished, "sweep", sweep_of(TEN))


# As a chapter of the report: it goes on if it can, and begins anew if not.


def as_a_chapter(folder: Path, runs: SweepRuns = TEN) -> dict:
    """What a sweep did that was neither told to resume nor to begin anew."""
    quiet = {"scheduler": None, "workers": None, "on_progress": lambda done, total: None}
    with complete("sweep", sweep_of(runs), folder=folder, resume=None, **quiet) as sweep:
        assert isinstance(sweep, Complete)
        assert (folder / UNFINISHED / "_lock").exists()
        assert [path.exists() for path in sweep.dataset.files()] == [True] * 3
        assert sweep.dataset.basis == sweep_of(runs).basis
        return sweep.took


def test_a_chapter_goes_on_with_its_own_runs(tmp_path):
    seven_of_ten(tmp_path)
    assert as_a_chapter(tmp_path)["runs"] == 3
    assert not (tmp_path / UNFINISHED).exists()


@pytest.mark.parametrize(
    "spoil", [lambda path: None, Path.unlink, rewrite("[]"), rewrite('{"seed": 5}')]
)
def test_a_chapter_begins_anew_where_the_runs_are_others(tmp_path, spoil):
    others = SweepRuns(replace(TEN.design, duration_s=0.06), 0)
    spoil(seven_of_ten(tmp_path, others) / "_basis.json")
    assert as_a_chapter(tmp_path)["runs"] == 10


def test_a_chapter_does_again_what_is_published(finished):
    """Its figures and captions may have changed, and only a sweep with its rows draws them."""
    assert as_a_chapter(finished)["runs"] == 10
