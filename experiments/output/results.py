"""What a study says of itself: its numbers, and the tables, sentences and pictures made of them.

The terminal, the Markdown files, the recordings' notes and `fjh report` all show this one
description.
"""

from dataclasses import dataclass
from typing import Any


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


@dataclass(frozen=True)
class Picture:
    """A figure that the study writes.

    Attributes:
        file: Name in the study's folder.
        caption: What it shows.
        alt: What there is to see, for a reader who cannot.
    """

    file: str
    caption: str
    alt: str


@dataclass(frozen=True)
class Findings:
    """What came out of a study.

    Attributes:
        summary: All numbers, as in its JSON file.
        tables: In print's order.
        notes: Sentences below them.
        pictures: Figures among its files.
        complaint: One sentence on what makes it unsound; None when nothing does.
    """

    summary: dict[str, Any]
    tables: list[Table]
    notes: list[str]
    pictures: list[Picture]
    complaint: str | None

    def markdown(self) -> str:
        """Tables and notes as a page."""
        parts = []
        for table in self.tables:
            parts += [f"## {table.title}", table.legend, table.markdown()]
        parts.append("\n".join(f"- {note}" for note in self.notes))
        return "\n\n".join(part for part in parts if part) + "\n"


def is_cut(summary: dict[str, Any]) -> bool:
    """Whether only a part of the spiral was run, which the paper's numbers do not compare with."""
    return summary["duration_s"] < summary["bench"]["duration_s"]
