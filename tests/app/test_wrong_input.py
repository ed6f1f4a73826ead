"""Absurd words of a command: one sentence that names the option, exit code 2, nothing written."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from experiments.app.cli import main
from experiments.app.refusals import TRACEBACK
from fjh.study.spelling import LARGEST_FILE
from sim import MODELS
from tests.made import made_study

ARM, DIGITS = str(MODELS / "arm.xml"), "9" * 5000
ABSURD = {
    "--noise": ("1e300", "1e-300", "-1", "nan"),
    "--size": ("1e300", "1e-300", "0", "inf"),
    "--joint-weight": ("1e200", "nan", "-1", "1,x"),
    "--secondary-weight": ("1e200", "1,inf"),
    "--servo": ("1e9", "1e-9"),
    "--crossover": ("1e300", "1e-300"),
    "--period": ("1e9", "1e-9"),
    "--turn": ("1e300", "1e-300", "nan"),
    "--duration": ("1e300", "1e-300"),
    "--major": (DIGITS, f"0,{DIGITS}", "0,0", "-1"),
    "--seed": (DIGITS,),
}


def refused(capfd, *words: str) -> str:
    """The sentence."""
    code = main([*words])
    said = capfd.readouterr().err
    assert code == 2, said
    assert said.startswith("fjh: ") and said.count("\n") == 1 and len(said) < 2100
    return said


@pytest.fixture
def out(tmp_path):
    """Where nothing is written."""
    yield tmp_path / "out"
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("option", "value"), [(name, value) for name, values in ABSURD.items() for value in values]
)
def test_a_number_that_no_robot_has_any_use_for_is_refused_by_its_option(capfd, out, option, value):
    said = refused(capfd, "track", ARM, f"{option}={value}", "--out", str(out))
    assert option.removeprefix("--").replace("-", "_") in said


@pytest.mark.parametrize("option", ["--keyframe", "--site", "--pinned"])
def test_a_number_of_thousands_of_digits_names_no_element(capfd, out, option):
    refused(capfd, "track", ARM, option, DIGITS, "--out", str(out))


SPECIAL = {
    "endless": lambda path: path.symlink_to("/dev/zero"),
    "pipe": os.mkfifo,
    "folder": Path.mkdir,
    "loop": lambda path: path.symlink_to(path),
    "huge": lambda path: (path.touch(), os.truncate(path, LARGEST_FILE + 1)),
}
READERS = ("sweep --design", "track", "table1 --model", "render", "animate")


@pytest.mark.parametrize("kind", SPECIAL)
@pytest.mark.parametrize("reader", READERS)
def test_what_is_no_file_to_read_is_neither_read_nor_waited_for(capfd, out, tmp_path, kind, reader):
    file = tmp_path / "it"
    SPECIAL[kind](file)
    written = {"render": "it.png", "animate": "it.gif"}.get(reader.split()[0], "")
    said = refused(capfd, *reader.split(), str(file), "--out", str(out / written))
    assert str(file) in said and "did you mean" not in said


def test_the_sentence_commands_no_terminal(capfd, out, tmp_path):
    said = refused(capfd, "track", str(tmp_path / "a\x1b[2J\nb.xml"), "--out", str(out))
    assert said[:-1].isprintable()


def measuring(monkeypatch, out: Path, perform: Callable[..., Any]) -> list[str]:
    """A command of a study that does this."""
    from experiments.app import cli

    study = made_study("measure", perform)
    monkeypatch.setattr(cli, "PAPER", {"measure": ""})
    monkeypatch.setattr(cli, "study", lambda _: study)
    return ["measure", "--out", str(out)]


def test_a_refusal_of_the_library_is_a_sentence(capfd, out, monkeypatch):
    """One place makes it of whatever check raises, wherever in the project."""
    import argument_checks as check

    def perform(*_: object, **__: object) -> None:
        check.array("joint_weight", [1e200])

    words = measuring(monkeypatch, out, perform)
    assert "joint_weight must be smaller than 1e+120, got 1e+200" in refused(capfd, *words)


def test_a_mistake_of_the_program_is_reported_as_one(capfd, out, monkeypatch):
    """Nobody's input is blamed; a variable shows the traceback."""

    def perform(*_: object, **__: object) -> None:
        int("no number")

    words = measuring(monkeypatch, out, perform)
    assert main(words) == 1
    said = capfd.readouterr().err
    assert said.startswith("fjh: this is a mistake of the program") and said.count("\n") == 1
    assert "ValueError in test_wrong_input.py" in said and TRACEBACK in said
    monkeypatch.setenv(TRACEBACK, "1")
    with pytest.raises(ValueError, match="no number"):
        main(words)
