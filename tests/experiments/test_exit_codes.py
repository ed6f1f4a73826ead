"""Tests of the messages for wrong input and for bugs of the program."""

from collections.abc import Callable
from typing import Any

import pytest

import argument_checks as check
from experiments.app import cli
from experiments.app.exit_codes import TRACEBACK
from tests.synthetic import synthetic_study


@pytest.fixture
def measure(tmp_path, monkeypatch):
    """Function from a computation to the arguments of a study's command, which writes nothing."""

    def arguments_of(perform: Callable[..., Any]) -> list[str]:
        study = synthetic_study("measure", lambda **_: perform())
        monkeypatch.setattr(cli, "PAPER", {"measure": ""})
        monkeypatch.setattr(cli, "study", lambda _: study)
        return ["measure", "--out", str(tmp_path / "out")]

    yield arguments_of
    assert list(tmp_path.iterdir()) == []


def test_an_argument_error_of_the_library_is_a_sentence(refused, measure):
    message = refused(*measure(lambda: check.array("joint_weight", [1e200])))
    assert message.startswith("fjh: joint_weight must be smaller than")


def test_a_bug_is_reported_as_one(refused, measure, monkeypatch):
    """The message is not that of wrong input; a variable shows the traceback."""
    arguments = measure(lambda: int("no number"))
    message = refused(*arguments, code=1)
    assert message.startswith("fjh: this is a bug of the program")
    assert "ValueError in test_exit_codes.py" in message and TRACEBACK in message
    monkeypatch.setenv(TRACEBACK, "1")
    with pytest.raises(ValueError, match="no number"):
        cli.main(arguments)
