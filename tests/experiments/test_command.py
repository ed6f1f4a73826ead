"""Tests of a study as a command: output on a terminal and for scripts."""

import io
import sys
from contextlib import redirect_stdout
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest
import typer
from hypothesis import given
from hypothesis import strategies as st
from rich.cells import cell_len

from experiments.app.command import command
from experiments.app.terminal import LINES, print_summary
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


# Output on a terminal.

TEXTS = st.builds(
    lambda words, count: " ".join([words] * count),
    st.text(st.sampled_from("ab.[\u65e5\x1b\n"), min_size=1, max_size=12),
    st.sampled_from([0, 1, 9, 90]),
)
CELLS = st.one_of(st.floats(), st.booleans(), st.none(), TEXTS, st.integers(0, 40).map("1".__mul__))


@st.composite
def views(draw) -> TableView:
    """Sample a table of up to 60 rows and 12 columns, with a title and a legend of any length."""
    names = draw(st.lists(st.text("abc_d", min_size=1, max_size=30), min_size=1, max_size=12))
    names = [f"{name}_{k}_urad" for k, name in enumerate(names)]
    row = {name: draw(CELLS) for name in names}
    rows = [row] * draw(st.sampled_from([0, 1, 5, 60]))
    frame = pd.DataFrame(rows, columns=names, dtype=object)
    return TableView(draw(TEXTS), frame, " ".join(names), draw(TEXTS))


@given(st.lists(views(), max_size=5), st.lists(TEXTS, max_size=9), TEXTS, st.integers(60, 120))
def test_any_result_is_at_most_25_lines_of_the_width_of_the_terminal(tables, notes, checked, width):
    """From 60 columns on: the line with the path of the page is never broken."""
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(io.StringIO()) as screen:
        patch.setenv("COLUMNS", str(width))
        contents = {"tables": tables, "notes": notes, "more": "More in out/x.md"}
        print_summary(checked, Path("out/x.png"), "fjh x", **contents)
    lines = screen.getvalue().splitlines()
    assert lines[-2:] == ["Files are in out; open x.png first.", "Next: fjh x"]
    assert len(lines) <= LINES == 25
    assert all(cell_len(line) <= width and line.isprintable() for line in lines)


def test_what_fits_is_printed_whole_and_the_rest_is_counted(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "40")
    run(PASSING, "--out", "out")
    lines = capsys.readouterr().out.splitlines()
    assert lines == [
        *("Heights [m]", "hill                   m", "Hohe <Acht> [km]  747.00", "Above [urad]."),
        *("", "So it is.", "", "All checks passed (1)."),
        *("Files are in out; open measure.md first.", "Next: fjh paper report --quick"),
    ]
    many = pd.DataFrame({"hill": [f"Hill {k}" for k in range(30)]} | dict.fromkeys("abcd", 1e12))
    table = TableView("Heights", many, "hill a=a_um:.0f b=is_high:.0f c:.0f d:.0f")
    run(replace(PASSING, views=[table, table]), "--out", "out")
    lines = capsys.readouterr().out.splitlines()
    assert lines[1:4] == [
        f"{'':21}a{'is':>15}",
        f"hill{'[um]':>18}{'high':>15}",
        "Hill 0   1000000000000  1000000000000",
    ]
    assert lines[15:17] == ["... 18 more rows", "Columns that do not fit: c, d."]
    assert lines[18:20] == ["So it is.", "More in out/measure.md: 18 rows, 1 table."]
