"""A person's habits: help, completion, quiet and JSON modes, no file where none is asked for."""

import io
import json
import os
import re
import shlex
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest
import typer

from experiments.app.cli import app_of, main
from experiments.app.command import command
from experiments.app.terminal import print_table
from experiments.studies import LINES, PAPER, ROBOT, command_of, study
from fjh.study.errors import OutputError, Unsound
from fjh.study.files import published, write_index
from fjh.study.option import words_of
from fjh.study.result import Check, Result, Shown
from tests.made import made_study

ROOT = Path(__file__).parents[2]
GROUP = typer.main.get_group(app_of(*LINES))
COMMANDS = GROUP.commands | vars(GROUP.commands["paper"])["commands"]
NAMES = [*LINES, "report"]
SHOWN = [*ROBOT, "live", "review", "render", "animate", "results", "paper"]
HEIGHTS = pd.DataFrame({"hill": ["Hohe <Acht>"], "m": [747.0]})
SOUND = Result(
    {"seed": 3},
    {"heights": HEIGHTS},
    [Check("height [m]", "hill", 7.25, 8.0)],
    [Shown("Heights", HEIGHTS, "hill m:.2f", "Above the sea.")],
    ["So it is."],
)
WRITTEN = SOUND.summary("measure") | {
    "files": ["measure.json", "measure.md", "measure_heights.parquet"]
}
"""The contents of its JSON file."""


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    """An empty working directory."""
    monkeypatch.chdir(tmp_path)


def test_units_in_brackets_are_printed_wherever_they_stand(capsys):
    frame = pd.DataFrame({"of": ["hill [km]"], "above": [7]})
    print_table(Shown("Heights [m]", frame, "of above", "Above [urad]"))
    printed = capsys.readouterr().out
    assert all(unit in printed for unit in ("Heights [m]", "above", "[urad]", "hill [km]"))


def run(result: Result, *arguments: str) -> None:
    """A study of this result as `fjh measure` runs it."""

    def make(*, times: int, on_progress, seed: int, quick: bool) -> Result:
        for k in range(times):
            on_progress(k + 1, times)
        return result

    study_app = typer.Typer()
    study_app.command()(command(made_study("measure", make)))
    study_app(list(arguments), standalone_mode=False)


def terminal() -> io.StringIO:
    screen = io.StringIO()
    screen.isatty = lambda: True
    return screen


def test_a_person_sees_tables_legends_and_notes(capsys):
    run(SOUND)
    out, err = capsys.readouterr()
    for word in ("Heights", "Hohe <Acht>", "747.00", "Above the sea.", "So it is."):
        assert word in out
    assert err == ""


def ended(out: str) -> list[str]:
    """The last three lines."""
    return out.splitlines()[-3:]


def test_the_last_lines_are_the_checks_the_files_and_what_to_type_next(capsys, tmp_path):
    place = tmp_path / "a folder of so long a name that eighty columns are not wide enough for it"
    run(SOUND, "--out", str(place))
    checked, written, following = ended(capsys.readouterr().out)
    assert checked == "All checks passed (1)."
    assert written == f"Files are in {place}; open {place / 'measure.md'} first."
    assert following == "Next: fjh paper report --quick"
    run(SOUND, "--quick")
    assert ended(capsys.readouterr().out)[-1] == "Next: fjh paper measure"


def test_a_recording_is_looked_at_next(capsys, tmp_path):
    recorded = replace(SOUND, records=[lambda folder: (folder / "it.rrd").write_text("")])
    run(recorded, "--out", str(tmp_path / "two words"))
    words = shlex.split(ended(capsys.readouterr().out)[-1].removeprefix("Next: "))
    assert words == ["rerun", str(tmp_path / "two words" / "it.rrd")]
    assert Path(words[1]).is_file()


def test_every_failed_check_is_named_at_the_end(capsys):
    wrong = [Check(f"{what} [m]", "hill", 9.0, 8.0) for what in ("height", "depth")]
    with pytest.raises(Unsound):
        run(replace(SOUND, checks=[*SOUND.checks, *wrong]))
    out = " ".join(capsys.readouterr().out.split())
    for what in ("height", "depth"):
        assert f"hill: {what} [m] is 9, expected below 8" in out
    assert "2 of 3 checks failed" in out
    assert "Files are in" in out


def test_scripts_get_nothing(capsys):
    run(SOUND, "--quiet")
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize(("arguments", "shows"), [([], True), (["--quiet"], False)])
def test_a_terminal_shows_progress_unless_it_is_to_be_quiet(monkeypatch, capsys, arguments, shows):
    screen = terminal()
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(sys, "stderr", screen)
    run(SOUND, "--times", "3", *arguments)
    assert ("measure" in screen.getvalue()) == shows
    assert shows or screen.getvalue() == ""


@pytest.mark.parametrize("arguments", [[], ["--quiet"]])
def test_a_failed_check_is_raised_in_every_mode_after_the_output(capsys, arguments):
    unsound = replace(SOUND, checks=[Check("height [m]", "hill", float("nan"), 8.0)])
    with pytest.raises(Unsound, match=r"a check failed: hill: height .m. is nan, expected below 8"):
        run(unsound, *arguments)
    out = capsys.readouterr().out
    assert (out == "") == (arguments == ["--quiet"])


@pytest.fixture
def nowhere(tmp_path, elsewhere):
    """The working directory, which is empty at the end, too."""
    yield
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", NAMES)
def test_help_says_what_how_long_which_files_units_and_an_example(capsys, nowhere, name):
    assert main([*command_of(name)[1:], "--help"]) == 0
    text = re.sub(r"\s+", " ", capsys.readouterr().out)
    idle = ("--seed N", "--quick") if name == "figures" else ()
    assert not [option for option in idle if option in text]
    for option in {"--out FOLDER", "--seed N", "--quick", "--quiet", "--help"} - {*idle}:
        assert option in text
    assert f"[default: results/{name}]" in text
    assert re.search(r"\d s|minute", text)
    assert f"Writes {name}.json" in text
    example = re.search(rf"Example: (fjh (?:paper )?{name}.*?) (Arguments|Options):", text)
    assert example
    words = shlex.split(example.group(1))
    assert words[: words.index(name) + 1] in (command_of(name), ["fjh", "table1"])
    words = words[words.index(name) + 1 :]
    read = [Path(word) for word in words if word.endswith(".xml")]
    for file in read:
        file.touch()
    COMMANDS[name].make_context(name, words)  # raises what the command would complain of
    for file in read:
        file.unlink()


def test_the_list_of_commands_has_whole_sentences_and_the_exit_codes(capsys, nowhere):
    assert main(["--help"]) == 0
    whole = capsys.readouterr().out
    text = re.sub(r"\s+", " ", whole)
    assert [name for name in GROUP.commands if not GROUP.commands[name].hidden] == SHOWN
    for line in ROBOT.values():
        assert line in text
    assert main(["paper"]) == 0
    text = re.sub(r"\s+", " ", capsys.readouterr().out)
    for line in PAPER.values():
        assert line in text
    for code in (0, 1, 2, 130):
        assert re.search(rf"^ +{code} +\w", whole, re.MULTILINE)
    assert main([]) == 0
    assert capsys.readouterr().out == whole


def completed(words: str, cwd: Path) -> tuple[list[str], str]:
    """What bash offers after these words, the last being unfinished; and all modules imported."""
    typed = {"COMP_WORDS": words, "COMP_CWORD": str(words.count(" "))}
    done = subprocess.run(
        [sys.executable, "-X", "importtime", "-m", "experiments"],
        env=os.environ | typed | {"_FJH_COMPLETE": "complete_bash", "PYTHONPATH": str(ROOT)},
        cwd=cwd,
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.split(), done.stderr


@pytest.mark.parametrize(
    ("words", "offered"),
    [
        ("fjh ", SHOWN),
        ("fjh paper sys", ["systems"]),
        ("fjh table1 --jac", ["--jacobian"]),
        ("fjh table1 --jacobian ", ["analytic", "constant"]),
        ("fjh paper jacobian --lo", ["--loop"]),
    ],
)
def test_tab_completes_commands_options_and_choices_at_once(tmp_path, words, offered):
    found, imported = completed(words, tmp_path)
    assert found == offered
    # What makes it fast: none of the packages that take their time is imported; options are those
    # of a study, whose module imports what it runs with.
    assert "typer" in imported
    for slow in ("mujoco", "matplotlib", "numpy", "scipy", "rerun", "distributed", "pyarrow"):
        assert "--" in words or not re.search(rf"\| +{slow}$", imported, re.MULTILINE), slow
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("name", "given"),
    [
        ("table1", {"jacobian": "constant", "quick": True, "seed": 3}),
        ("survey", {"major": "x,y", "sensors": "off", "postures": 0}),
        (
            "track",
            {
                "crossover": 0.5,
                "joint_weight": "1.0,2.0",
                "diagnosis": "off",
                "fail": ["a:locked@1", "b:free@2"],
            },
        ),
        ("sweep", {"workers": 2, "resume": True}),
    ],
)
def test_the_words_of_options_are_read_as_these_options(name, given):
    """Those of a dataclass among the parameters, too; what is as by default is left out."""
    words = words_of(study(name), given)
    assert len(words) <= 2 + 2 * len(given)
    read = GROUP.commands[name].make_context(name, words).params
    assert {key: read[key] for key in given} == given


@pytest.mark.parametrize(
    "arguments",
    [["table7"], ["systems", "--seed", "x"], ["table1", "--model", "none.xml"], ["goals", "much"]],
)
def test_wrong_input_leaves_no_folder_behind(capsys, nowhere, arguments):
    assert main(arguments) == 2
    assert capsys.readouterr().out == ""


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
    assert json.loads((tmp_path / "long.json").read_text()) == {
        "seed": 0,
        "files": ["a.npz", "b.npz", "long.json"],
    }
    write(tmp_path, "long.json", "a.npz")
    assert contents(tmp_path) == {"long.json", "a.npz", "other.json", "c.npz", "mine.txt"}


@pytest.mark.parametrize(
    "old",
    [
        "no JSON",
        "[]",
        "{}",
        '{"files": 3}',
        '{"files": [3, null]}',
        '{"files": ["../mine.txt", "below/mine.txt", "below", "", "."]}',
    ],
)
def test_an_index_that_we_did_not_write_removes_nothing(tmp_path, old):
    folder = tmp_path / "out"
    (folder / "below").mkdir(parents=True)
    for place in (tmp_path, folder / "below"):
        (place / "mine.txt").write_text("mine")
    (folder / "index.json").write_text(old)
    write(folder, "index.json", "a.npz")
    assert contents(folder) == {"index.json", "a.npz", "below"}
    assert (folder / "below" / "mine.txt").exists()
    assert (tmp_path / "mine.txt").exists()


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


@pytest.mark.long
@pytest.mark.parametrize(
    "name", [name for name in LINES if name not in {"figures", "force", "uncorrected"}]
)
def test_a_study_lists_its_files_and_is_checked_by_its_json(request, name):
    """What the checks say needs nothing but the file; no row of a table is short."""
    folder = request.getfixturevalue(f"{name}_folder")
    summary = json.loads((folder / f"{name}.json").read_text())
    assert set(summary["files"]) == contents(folder)
    assert summary["checks"] and all(check["passed"] for check in summary["checks"])
    tables = re.findall(r"(?:^\|.*\n)+", (folder / f"{name}.md").read_text(), re.MULTILINE)
    assert tables
    for table in tables:
        assert len({line.count("|") for line in table.splitlines()}) == 1
