"""Whatever the width of the terminal, a table shows every number whole."""

import contextlib
import io

import pytest
from hypothesis import given
from hypothesis import strategies as st

from experiments.study.layout import fitted
from experiments.study.tables import Table
from experiments.study.terminal import print_table

_NUMBERS = st.floats(allow_nan=False, allow_infinity=False).map("{:.6g}".format)
_WORDS = st.text("abcdefgh", min_size=1, max_size=12)
_TEXTS = st.lists(_WORDS, min_size=1, max_size=4).map(" ".join)


@st.composite
def tables(draw: st.DrawFn) -> Table:
    """Any number of rows and columns, some cells of several words, labels that may repeat."""
    columns, rows = draw(st.integers(1, 14)), draw(st.integers(0, 14))
    row = st.tuples(_TEXTS, *[st.one_of(_NUMBERS, _TEXTS)] * (columns - 1))
    headings = draw(st.tuples(*[_TEXTS] * columns))
    return Table("Of all", headings, draw(st.lists(row, min_size=rows, max_size=rows)), "As it is.")


def printed(table: Table, width: int) -> str:
    screen = io.StringIO()
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(screen):
        patch.setenv("COLUMNS", str(width))
        print_table(table)
    return screen.getvalue()


@given(table=tables(), width=st.integers(60, 140))
def test_no_cell_is_shortened_and_no_line_is_too_long(table, width):
    shown = printed(table, width)
    assert "\N{HORIZONTAL ELLIPSIS}" not in shown
    assert max(map(len, shown.splitlines())) <= width
    words = shown.split()
    for cell in (cell for row in (table.headings, *table.rows) for cell in row):
        assert set(cell.split()) <= set(words)


@given(table=tables(), width=st.integers(60, 140))
def test_turned_or_split_it_is_the_same_table_and_says_so(table, width):
    first, *others = parts = fitted(table, width)
    if parts == [table]:
        return
    columns = [*zip(table.headings, *table.rows, strict=True)]
    if not others:
        assert "exchanged" in first.legend
        turned = [(first.headings[0], *first.headings[1:]), *first.rows]
        assert [row[1:] for row in turned] == [column[1:] for column in columns]
        return
    assert f"Split into {len(parts)}" in others[-1].legend
    pieces = [[*zip(part.headings, *part.rows, strict=True)] for part in parts]
    left = len(columns) - len(pieces[0])
    labels = (sum(map(len, pieces[1:])) - left) // len(others)
    assert [*pieces[0], *(column for piece in pieces[1:] for column in piece[labels:])] == columns
    assert all(piece[:labels] == columns[:labels] for piece in pieces)


def test_rows_that_many_wide_columns_tell_apart_are_split_all_the_same():
    """Once the labels alone took more room than there was, and a number was cut."""
    large, row = "1.00001e+06", ["0"] * 7
    rows = [("a", *row[:k], large, *row[k + 1 :]) for k in (5, 4, 3)]
    last = [("a", *row[:5], "100", "0"), ("aaaaaaaa", *row)]
    shown = printed(Table("Of all", ("a",) * 8, [("a", *row), *last, *rows]), 60)
    assert all(large in line for line in shown.splitlines() if "1.0" in line)
    assert max(map(len, shown.splitlines())) <= 60


def test_a_number_longer_than_the_terminal_is_wide_is_folded_not_cut():
    number = "0.123456789" * 12
    shown = printed(Table("", ("", "value"), [("pi", number)]), 60)
    assert number in "".join(shown.split()).replace("─", "")
