"""Findings of studies that are not yet described as data."""

from dataclasses import dataclass
from typing import Any

from experiments.output.results import is_cut as is_cut
from experiments.output.tables import Table


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
