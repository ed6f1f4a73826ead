"""Tables for people: columns with a key and a format, rows from a study's summary."""

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

_MARKUP = re.compile(
    r"[|*`$]|(?<!\w)_|_(?!\w)|<(?=[a-zA-Z/!?])|\[(?=[^]]*\]\()|\\(?=[!-/:-@[-`{-~])"
    r"|&(?=#?\w+;)|~~|^[#>]"
)


def literal(text: str) -> str:
    """Markdown that shows a text as it is: names are anybody's."""
    return _MARKUP.sub(r"\\\g<0>", text)


@dataclass(frozen=True)
class Column:
    """One column: a key of the entries that rows are made of, or a function of the entry.

    A narrow page may break the heading at its line breaks. The format may be a function of the
    value that makes the cell. None in an entry leaves it empty.
    """

    heading: str
    key: str | Callable[[Any], Any]
    format: str | Callable[[Any], str] = ""

    def cell(self, entry: Mapping[str, Any]) -> str:
        """The cell of an entry's row."""
        value = self.key(entry) if callable(self.key) else entry[self.key]
        if value is None:
            return ""
        return self.format(value) if callable(self.format) else format(value, self.format)


@dataclass(frozen=True)
class Table:
    """Rows of cells as a reader shall see them; the first of each is its label.

    The legend says what the columns mean, with units, where title and headings do not.
    """

    title: str
    headings: tuple[str, ...]
    rows: list[tuple[str, ...]]
    legend: str = ""

    def markdown(self) -> str:
        """The table without title and legend."""
        headings = [heading.replace("\n", " ") for heading in self.headings]
        lines = [headings, ("---",) * len(headings), *self.rows]
        return "\n".join("| " + " | ".join(map(literal, line)) + " |" for line in lines)


def tabulate(
    title: str, columns: Sequence[Column], entries: Iterable[Mapping[str, Any]], legend: str = ""
) -> Table:
    """One row for each entry."""
    rows = [tuple(column.cell(entry) for column in columns) for entry in entries]
    return Table(title, tuple(column.heading for column in columns), rows, legend)
