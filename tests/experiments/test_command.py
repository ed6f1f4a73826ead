"""Tests of a study as a command: output on a terminal and for scripts."""

import io
import sys
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest
import typer

from experiments.app.command import command
from fjh.study.errors import Unsound
from fjh.study.result import Check, Result, TableView
from tests.synthetic import synthetic_study

HEIGHTS = pd.DataFrame({"hill": ["Hohe <Acht> [km]"], "m": [747.0]})
PASSING = Result(
    {"seed": 3},
    {"heights": HEIGHTS},
    [Check("height [m]", "hill", 7.25, 8.0)],
    [TableView("Heights [m]", HEIGHTS, "hill m:.2f", "Above [urad].")],
    ["So it is."],
)


@pytest.fixture(autouse=True)
def _in_empty_folder(tmp_path, monkeypatch):
    """Change to an empty folder."""
    monkeypatch.chdir(tmp_path)


def run(result: Result, *words: str) -> None:
    """Run a study with this result as `fjh measure`."""

    def make(*, times: int, on_progress, seed: int, quick: bool) -> Result:
        for k in range(times):
            on_progress(k + 1, times)
        return result

    study_app = typer.Typer()
    study_app.command()(command(synthetic_study("measure", make)))
    study_app(list(words), standalone_mode=False)


@pytest.mark.parametrize("quiet", [False, True])
def test_every_failed_check_is_printed_and_raised_in_every_mode(capsys, quiet):
    nan = float("nan")
    wrong = [Check(f"{what} [m]", "hill", nan, 8.0) for what in ("height", "depth")]
    with pytest.raises(Unsound, match=r"a check failed: hill: height .m. is nan, expected below 8"):
        run(replace(PASSING, checks=[*PASSING.checks, *wrong]), *["--quiet"] * quiet)
    out = " ".join(capsys.readouterr().out.split())
    printed = [f"hill: {what} [m] is nan" in out for what in ("height", "depth")]
    assert printed == [not quiet] * 2 and ("2 of 3 checks failed" in out) == (not quiet)
    assert Path("results/measure/measure.json").is_file()


@pytest.mark.parametrize("quiet", [False, True])
def test_a_terminal_shows_progress_unless_quiet(monkeypatch, capsys, quiet):
    screen = io.StringIO()
    screen.isatty = lambda: True
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(sys, "stderr", screen)
    run(PASSING, "--times", "3", *["--quiet"] * quiet)
    assert ("measure" in screen.getvalue()) == (not quiet)
    assert not quiet or (screen.getvalue(), capsys.readouterr().out) == ("", "")
