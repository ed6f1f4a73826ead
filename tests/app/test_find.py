"""`fjh find`: runs by what came out of them; those that were never recorded are flown again."""

import json
import re
import shlex
import shutil
import sys
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from experiments.app import again, find
from experiments.app.cli import main
from experiments.recording.properties import properties_of
from experiments.recover import row as recover_row
from experiments.studies import STUDIES
from experiments.study.listing import Source, sources_of
from experiments.study.study import Unsound, WrongInput
from experiments.sweep import row as sweep_row
from tests import rrd
from tests.made import keep_made, made_run
from tests.pages import assert_prints

DATA = Path(__file__).parents[2] / "docs" / "data"
ISSUE = "named_s > 0.1 and kind == 'locked'"
"""The question that the command was made for."""


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    """An empty working directory, in which no file is made but by a test of that."""
    monkeypatch.chdir(tmp_path)


@pytest.fixture(scope="module")
def flights(tmp_path_factory):
    """A result of `fjh recover` with thousands of flights."""
    return shutil.copytree(DATA, tmp_path_factory.mktemp("flights") / "recover")


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    """A folder with two recordings, and no dataset."""
    folder = tmp_path_factory.mktemp("recordings")
    for name in ("second", "first"):
        keep_made(folder, name)
    return folder


def found(capsys, *words: object) -> dict:
    assert main(["find", *map(str, words), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_the_issues_question_finds_what_numpy_finds(capsys, flights):
    rows = pq.read_table(flights / "recover.parquet").to_pylist()
    late = [r for r in rows if (r["named_s"] or 0) > 0.1 and r["kind"] == "locked"]
    content = found(capsys, ISSUE, flights)
    assert content["runs"] == len(rows) == 6174 and content["found"] == len(late) == 13
    assert {row["case"] for row in content["rows"]} == {row["case"] for row in late}
    worst = [row["rms_supervised_after"] for row in content["rows"]]
    assert worst == sorted(worst, reverse=True)
    in_ms = found(capsys, ISSUE.replace("named_s > 0.1", "named_ms > 100"), flights)
    assert [row["case"] for row in in_ms["rows"]] == [row["case"] for row in content["rows"]]
    for row in in_ms["rows"]:
        assert row["named_ms"] == pytest.approx(1000 * row["named_s"]) and "__row" not in row
    assert not list(Path().iterdir())


def test_a_person_sees_how_many_and_the_worst_first(capsys, flights):
    assert main(["find", ISSUE, str(flights), "--list"]) == 0
    said = capsys.readouterr().out
    assert "13 of 6174 runs." in said and "largest rms_supervised_after;" in said
    for word in ("case", "actuator", "mismatch", "named_s", "11.052", "3726"):
        assert word in said
    assert main(["find", "kind == 'free'", str(flights), "--by", "-named_s", "--list"]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "1312 of 6174 runs, the 20 worst above." in said and "largest -named_s" in said
    assert not list(Path().iterdir())


def test_the_page_shows_what_is_printed(capsys, monkeypatch):
    page = (DATA.parent / "find.md").read_text()
    [(words, shown)] = re.findall(r"```console\n\$ fjh (find [^\n]*)\n(.*?)```", page, re.DOTALL)
    monkeypatch.setenv("COLUMNS", "120")
    monkeypatch.chdir(DATA.parents[1])
    assert main(shlex.split(words)) == 0
    assert_prints(capsys.readouterr().out, shown)


def test_folders_below_are_looked_into_once(capsys, recordings, tmp_path):
    """As results lie on disk: a folder for each study. The second way to name one adds nothing."""
    for place in ("results/deep/below", "results/beside", "results/.hidden"):
        shutil.copytree(recordings, tmp_path / place)
    (tmp_path / "results/beside/deeper").mkdir()
    content = found(capsys, "True", "results", "results/beside")
    listed = sorted((row["folder"], row["recording"]) for row in content["rows"])
    names = ("first", "second")
    assert listed == [(f"results/{at}", n) for at in ("beside", "deep/below") for n in names]


def test_no_match_is_an_answer(capsys, flights):
    assert main(["find", "named_s > 1000", str(flights)]) == 0
    assert "0 of 6174 runs." in capsys.readouterr().out
    assert not list(Path().iterdir())


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["nmed_s > 1", "."], 'did you mean "named_s"'),
        (["kind > 0.1", "."], "kind is text and 0.1 a number"),
        (["kind ==", "."], "invalid syntax"),
        (["True", ".", "--by", "kind"], "kind is text, expected a number"),
        (["True", ".", "--by", "nmed_s"], "named_s"),
        (["True", "nowhere"], "nowhere is no folder"),
        (["True", "empty"], "neither a dataset nor a recording"),
        (["True", ".", "--out", "found.png"], "must end in .rrd"),
    ],
)
def test_a_wrong_question_is_one_sentence(capsys, flights, words, said):
    Path("empty").mkdir()
    places = [str(flights) if word == "." else word for word in words]
    assert main(["find", *places]) == 2
    error = capsys.readouterr().err
    assert error.startswith("fjh: ") and said in error and error.count("\n") == 1
    assert not Path("found.rrd").exists()


BROKEN = {
    "no parquet": lambda folder: (folder / "recover.parquet").write_bytes(b"PAR1"),
    "missing": lambda folder: (folder / "recover.parquet").unlink(),
    "elsewhere": lambda folder: (folder / "recover.json").write_text(
        json.dumps({"experiment": "recover", "dataset": "../outside.parquet"})
    ),
    "no JSON": lambda folder: (folder / "recover.json").write_text("{"),
    "a link": lambda folder: (
        (folder / "recover.parquet").unlink(),
        (folder / "recover.parquet").symlink_to("/dev/zero"),
    ),
}


@pytest.mark.parametrize("kind", BROKEN)
def test_a_broken_result_is_one_sentence(capsys, flights, kind):
    folder = Path(shutil.copytree(flights, "broken"))
    shutil.copy(flights / "recover.parquet", "outside.parquet")
    BROKEN[kind](folder)
    assert main(["find", "True", str(folder), "--list"]) == 2
    said = capsys.readouterr().err
    assert said.startswith("fjh: ") and "broken" in said and said.count("\n") == 1


def test_recordings_are_found_by_their_properties_and_shown_side_by_side(capsys, recordings):
    """Where a folder has no dataset."""
    content = found(capsys, "seed == 0", recordings)
    assert [row["recording"] for row in content["rows"]] == ["first", "second"]
    assert found(capsys, "seed == 0 and recording == 'second'", recordings)["found"] == 1
    assert main(["find", "seed == 0", str(recordings)]) == 0
    said = capsys.readouterr().out
    assert "2 of 2 runs." in said and said.endswith("Next: rerun found.rrd\n")
    assert "| first |" in rrd.notes(Path("found.rrd"))
    assert sum(e.endswith("task/error") for e in rrd.entities(Path("found.rrd"))) == 2


def test_several_folders_are_one_list_with_their_names(capsys, flights, recordings):
    content = found(capsys, f"({ISSUE}) or recording == 'first'", flights, recordings)
    assert content["runs"] == 6176 and content["found"] == 14
    assert {row["folder"] for row in content["rows"]} == {str(flights), str(recordings)}
    assert content["rows"][-1]["recording"] == "first"  # without the number, hence last
    columns = {"kind": pa.array([1.5]), "case": pa.array([0])}
    other = Path("other")
    other.mkdir()
    pq.write_table(pa.table(columns), other / "it.parquet")
    (other / "it.json").write_text(json.dumps({"experiment": "recover", "dataset": "it.parquet"}))
    assert main(["find", "True", str(other), str(flights)]) == 2
    assert "cannot be listed together" in capsys.readouterr().err


def test_nothing_that_is_printed_commands_a_terminal(capsys):
    evil = "\x1b[2J\n"
    pq.write_table(pa.table({"case": [0], "kind": [evil]}), "it.parquet")
    Path("it.json").write_text(json.dumps({"experiment": "recover", "dataset": "it.parquet"}))
    assert main(["find", "True", ".", "--list"]) == 0
    assert all(line.isprintable() for line in capsys.readouterr().out.splitlines())


def test_a_viewer_is_opened_for_a_person_with_a_screen_alone(monkeypatch):
    started = []
    monkeypatch.setattr(find.subprocess, "Popen", lambda words, **_: started.append(words))
    monkeypatch.setattr(find.sys.stdout, "isatty", lambda: True, raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.setattr(find.sys, "platform", "linux")
    assert find.opened(Path("f.rrd"), 3) == "The worst 3 are side by side."
    assert not started
    monkeypatch.setenv("DISPLAY", ":0")
    assert find.opened(Path("f.rrd"), 1) == "The worst is in it, and open in the viewer."
    [(program, *options)] = started
    assert Path(program).is_file() and options[-1] == Path("f.rrd") and "127.0.0.1" in options


def test_each_study_with_rows_names_what_it_has():
    """Its worst column and those shown are in a schema; its entry point exists."""
    verdict = "verdict"  # of the atlas alone
    schemas = {
        "recover": {*recover_row.SCHEMA.names},
        **{each: {*sweep_row.SCHEMA.names, verdict} for each in ("sweep", "atlas")},
    }
    listings = {study.name: study.listing for study in STUDIES if study.listing}
    assert listings.keys() == schemas.keys()
    for name, listing in listings.items():
        assert {*listing.worst, *listing.shown} <= schemas[name]


# Flown again.


@pytest.mark.long
@pytest.mark.parametrize("name", ["recover", "sweep", "atlas"])
def test_a_flown_row_is_repeated_to_the_bit(name, request):
    """On the processor that flew it: every number that the flight gives anew."""
    folder = request.getfixturevalue(f"{name}_folder")
    [source] = sources_of(folder, properties_of)
    once = again.again_of(source)
    rows = [row for row in source.rows.to_pylist() if row["status"] not in ("diverged", "refused")]
    chosen = rows if name == "recover" else rows[:: len(rows) // 4]
    for row in chosen:
        columns, run, _ = again.flown(once, row)
        assert columns and {key: row[key] for key in columns} == columns
        assert len(run.time_s) == round(1e3 * row["duration_s"])
    sorts = {row.get("sort") for row in chosen}
    assert name != "recover" or sorts == {"failure", "size", "pair", "healthy"}


def test_the_worst_are_recorded_from_their_numbers(capsys, recover_folder):
    assert main(["find", "kind == 'locked'", str(recover_folder)]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert said.count("flown again, agrees with its row to 1e-09.") == 3
    assert said.endswith("Next: rerun found.rrd")
    assert sum(e.endswith("task/error") for e in rrd.entities(Path("found.rrd"))) == 3


def spoilt(folder: Path, **basis: str) -> Path:
    """A copy whose first row has another error, and whose basis says so or not."""
    own = Path(shutil.copytree(folder, "spoilt"))
    table = pq.read_table(own / "recover.parquet")
    at = table.column_names.index("rms_supervised_after")
    wrong = [value and 1.001 * value for value in table.column(at).to_pylist()]
    column = pa.array(wrong, pa.float64())
    pq.write_table(table.set_column(at, "rms_supervised_after", column), own / "recover.parquet")
    summary = json.loads((own / "recover.json").read_text())
    summary["basis"] |= basis
    (own / "recover.json").write_text(json.dumps(summary))
    return own


def test_a_row_of_another_version_is_said_to_differ(capsys, recover_folder):
    own = spoilt(recover_folder, code_sha256="0" * 64)
    assert main(["find", "case == 0", str(own)]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "differs from its row (rms_supervised_after is" in said
    assert "the dataset was written with another code_sha256." in said


def test_a_row_that_nothing_explains_is_unsound(capsys, recover_folder):
    own = spoilt(recover_folder)
    assert main(["find", "case == 0", str(own)]) == 1
    assert "case 0 flown again differs from its row" in capsys.readouterr().err
    assert not Path("found.rrd").exists()


def source(**changed) -> Source:
    summary = json.loads((DATA / "recover.json").read_text())
    return Source(Path("there"), pa.table({"case": [0]}), summary | changed)


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        ({"experiment": "table1"}, "runs of 'table1' in there cannot be flown again"),
        ({"experiment": None}, "cannot be flown again"),
        ({"basis": {}}, "this version draws them otherwise"),
        ({"basis": {"flights": [], "seed": 0}}, "this version draws them otherwise"),
        ({"basis": {"events": {"names": 3}, "seed": 0}}, "this version draws them otherwise"),
        ({"basis": {"robot": {}}}, "another robot cannot be repeated"),
    ],
)
def test_what_cannot_be_flown_again_is_one_sentence(changed, why):
    with pytest.raises(WrongInput, match=why):
        again.again_of(source(**changed))


def test_no_controller_that_a_file_names_is_imported():
    basis = source().summary["basis"]
    drawn = basis["flights"] | {"controller": "antigravity:fly"}
    again.again_of(source(basis=basis | {"flights": drawn}))
    assert "antigravity" not in sys.modules


def test_a_row_that_is_drawn_otherwise_is_not_flown():
    own = source()
    row = own.summary and pq.read_table(DATA / "recover.parquet").slice(5, 1).to_pylist()[0]
    once = again.again_of(own)
    with pytest.raises(WrongInput, match=r"case 5 cannot be flown again: .* another plant_seed"):
        again.flown(once, row | {"plant_seed": row["plant_seed"] + 1})


def test_what_differs_without_a_reason_is_unsound():
    own = source()
    once = again.again_of(own)
    own.summary["basis"] |= once.campaign.basis
    columns = {"rms_supervised_after": 1.0}
    one = again.Repeated(5, once, own, columns, made_run(), "")
    assert "agrees" in one.said({"rms_supervised_after": 1.0 + 1e-10})
    with pytest.raises(Unsound, match="is 1 instead of 2"):
        one.said({"rms_supervised_after": 2.0})
