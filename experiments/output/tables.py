"""Tables for people: columns with a key and a format, rows from a study's summary."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Column:
    """One column of a table.

    Attributes:
        heading: For people; a line break is where a narrow page may break it.
        key: Of the entry that a row is made of, or a function of the entry.
        format: As of :func:`format`; None in an entry leaves the cell empty.
    """

    heading: str
    key: str | Callable[[Any], Any]
    format: str = ""

    def cell(self, entry: Mapping[str, Any]) -> str:
        """The cell of an entry's row."""
        value = self.key(entry) if callable(self.key) else entry[self.key]
        return "" if value is None else format(value, self.format)


@dataclass(frozen=True)
class Table:
    """Rows of cells; the first of each is its label.

    Attributes:
        title: For people, on one line.
        headings: One a column; a line break is where a narrow page may break it.
        rows: One a line; cells are print, as a reader shall see them.
        legend: What the columns mean, with their units, where title and headings do not say.
    """

    title: str
    headings: tuple[str, ...]
    rows: list[tuple[str, ...]]
    legend: str = ""

    def markdown(self) -> str:
        """The table without title and legend."""
        headings = [heading.replace("\n", " ") for heading in self.headings]
        lines = [headings, ("---",) * len(headings), *self.rows]
        return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def tabulate(
    title: str,
    columns: Iterable[Column],
    entries: Iterable[Mapping[str, Any]],
    legend: str = "",
) -> Table:
    """One row for each entry."""
    columns = tuple(columns)
    rows = [tuple(column.cell(entry) for column in columns) for entry in entries]
    return Table(title, tuple(column.heading for column in columns), rows, legend)
