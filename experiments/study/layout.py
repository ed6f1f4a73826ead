"""Tables that fit into a width without a cell being shortened: they are turned or split."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

from experiments.study.tables import Table

MARGIN, GAP = 1, 2
"""Characters before the first column, and after each."""

_SENTENCE = 24
"""Longer cells may be wrapped at their words."""


def fitted(table: Table, width: int) -> list[Table]:
    """The same table, turned, or split by columns: the first of these that is narrow enough.

    Each part of a split table begins with the columns that tell its rows apart, as far as there is
    room for them. The last legend says what was done. Only a table whose single words are too long
    is wider than `width`.
    """
    if _least(table) <= width:
        return [table]
    if table.rows and _least(turned := _turned(table)) <= width:
        return [_said(turned, f"Rows and columns are exchanged, to fit {width} characters.")]
    parts = _split(table, width)
    if len(parts) == 1:
        return [table]
    return [*parts[:-1], _said(parts[-1], f"Split into {len(parts)}, to fit {width} characters.")]


def widths(table: Table, width: int) -> list[int]:
    """Of the columns, together with margin and gaps at most `width` if that is possible at all."""
    columns = list(zip(table.headings, *table.rows, strict=True))
    found = [_narrowest(column) for column in columns]
    room = max(0, width - _total(found))
    for k, column in enumerate(columns):
        lines = (line for text in column for line in text.split("\n"))
        more = min(room, max(map(len, lines)) - found[k])
        found[k] += more
        room -= more
    return found


def _narrowest(column: Sequence[str]) -> int:
    """Width at which a heading breaks at words only, and a cell if it is long."""
    heading, *cells = column
    least = max(map(len, heading.split()), default=0)
    for cell in cells:
        word = max(map(len, cell.split()), default=0)
        least = max(least, word, min(len(cell), _SENTENCE))
    return max(least, 1)


def _least(table: Table) -> int:
    return _total([_narrowest(each) for each in zip(table.headings, *table.rows, strict=True)])


def _total(widths: Sequence[int]) -> int:
    return MARGIN + sum(widths) + GAP * len(widths)


def _turned(table: Table) -> Table:
    """A row for each column but the first."""
    corner, *headings = (heading.replace("\n", " ") for heading in table.headings)
    labels, *columns = zip(*table.rows, strict=True)
    rows = [(heading, *column) for heading, column in zip(headings, columns, strict=True)]
    return replace(table, headings=(corner, *labels), rows=rows)


def _split(table: Table, width: int) -> list[Table]:
    """Parts that have as many of the columns as fit, at least one beside the labels."""
    columns = list(zip(table.headings, *table.rows, strict=True))
    narrowest = [_narrowest(column) for column in columns]
    keys = _keys(table)
    while keys > 1 and _total([*narrowest[:keys], max(narrowest[keys:])]) > width:
        keys -= 1
    starts = [keys]
    for k in range(keys + 1, len(columns)):
        if _total(narrowest[:keys] + narrowest[starts[-1] : k + 1]) > width:
            starts.append(k)
    parts = []
    for begin, end in pairwise([*starts, len(columns)]):
        headings, *rows = zip(*columns[:keys], *columns[begin:end], strict=True)
        parts.append(Table(table.title if not parts else "", headings, rows))
    return [*parts[:-1], replace(parts[-1], legend=table.legend)]


def _keys(table: Table) -> int:
    """The fewest first columns by which rows differ; one where no fewer than all do."""
    for count in range(1, len(table.headings)):
        if len({row[:count] for row in table.rows}) == len(table.rows):
            return count
    return 1


def _said(table: Table, sentence: str) -> Table:
    return replace(table, legend=" ".join(each for each in (table.legend, sentence) if each))
