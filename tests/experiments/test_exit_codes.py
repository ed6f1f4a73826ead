"""What stops a command: somebody's input, or a mistake of the program."""

from collections.abc import Callable
from typing import Any

import pytest

import argument_checks as check
from experiments.app import cli
from experiments.app.exit_codes import TRACEBACK
from tests.made import made_study


@pytest.fixture
def measure(tmp_path, monkeypatch):
    """The words of a command of a study that does this."""

    def words_of(perform: Callable[..., Any]) -> list[str]:
        study = made_study("measure", lambda **_: perform())
        monkeypatch.setattr(cli, "PAPER", {"measure": ""})
        monkeypatch.setattr(cli, "study", lambda _: study)
        return ["measure", "--out", str(tmp_path / "out")]

    yield words_of
    assert list(tmp_path.iterdir()) == []


def test_a_refusal_of_the_library_is_a_sentence(refused, measure):
    """One place makes it of whatever check raises, wherever in the project."""
    said = refused(*measure(lambda: check.array("joint_weight", [1e200])))
    assert said.startswith("fjh: joint_weight must be smaller than")


def test_a_mistake_of_the_program_is_reported_as_one(refused, measure, monkeypatch):
    """Nobody's input is blamed; a variable shows the traceback."""
    words = measure(lambda: int("no number"))
    said = refused(*words, code=1)
    assert said.startswith("fjh: this is a bug of the program")
    assert "ValueError in test_exit_codes.py" in said and TRACEBACK in said
    monkeypatch.setenv(TRACEBACK, "1")
    with pytest.raises(ValueError, match="no number"):
        cli.main(words)
