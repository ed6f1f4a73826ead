"""Output on the terminal: progress, and a result of at most 25 lines."""

import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fjh.study.interrupts import printable, raise_on_interrupt
from fjh.study.option import OnProgress

if TYPE_CHECKING:
    from fjh.study.result import TableView

LINES, NOTE_LINES = 25, 8
"""Largest number of printed lines of a command, and of its notes if it has tables."""
_CUT = 20
"""Least width to which a column of text is cut; narrower ones are left out."""


@contextmanager
def progress(description: str, *, show: bool = True) -> Iterator[OnProgress]:
    """Display a progress bar on standard error, if that is a terminal.

    Its label is "preparing" until the number of steps is known, and "evaluating" after the last
    step. From here on Ctrl-C raises an exception.
    """
    # Late, as the help text must not wait for it.
    from rich import progress as rich
    from rich.console import Console

    raise_on_interrupt()
    bar = rich.Progress(
        rich.TextColumn("{task.description}"),
        *(rich.BarColumn(), rich.TextColumn("{task.fields[steps]}")),
        *(rich.TimeElapsedColumn(), rich.TimeRemainingColumn()),
        console=Console(stderr=True),
        transient=True,
        disable=not (show and sys.stderr.isatty()),
    )
    with bar:
        task = bar.add_task(f"{description}: preparing", total=None, steps="")

        def update(done: int, total: int) -> None:
            text = description if done < total else f"{description}: evaluating"
            bar.update(task, description=text, completed=done, total=total, steps=f"{done}/{total}")

        yield update


def print_summary(checked: str, written: Path, following: str, **contents: Any) -> None:
    """Print the checks, the file to open first, the command to run next, and above the contents."""
    files = f"Files are in {written.parent}; open {written.name} first."
    print_result(ending=[checked, files, f"Next: {following}"], **contents)


def print_result(
    *,
    tables: Sequence["TableView"] = (),
    notes: Sequence[str] = (),
    more: str = "",
    ending: Sequence[str] = (),
) -> None:
    """Print tables, notes and the ending on standard output, at most 25 lines.

    Tables and notes are printed in their order if they fit, the first table at least in part; a
    line with the place `more` counts the others. `ending` is a sentence, and unbroken lines.
    """
    from rich.console import Console  # late, as above

    console = Console(markup=False, emoji=False, highlight=False)  # brackets hold units
    width, ends = console.width, list[str]()
    if ending:
        ends = ["", *_wrapped(ending[0], width, 5), *ending[1:]]
    room = LINES - sum(-(-max(1, len(line)) // width) for line in ends)
    lines, hidden = _fitted(tables, notes, room, width)
    if hidden:
        room -= -(-len(f"{more}: 99,999 rows, 99 tables, 99 notes.") // width)
        lines, hidden = _fitted(tables, notes, room, width)
        counts = (f"{count:,} {name}{'s' * (count > 1)}" for name, count in hidden.items())
        lines.append(f"{more}: {', '.join(counts)}.")
    if ends[:1] == lines[-1:] or not lines:
        del ends[:1]
    for line in [*lines, *ends]:
        console.print(printable(line), soft_wrap=True)


def _fitted(
    tables: Sequence["TableView"], notes: Sequence[str], room: int, width: int
) -> tuple[list[str], Counter[str]]:
    """Return the lines that fit, and the numbers of rows, tables and notes that do not."""
    lines, texts, hidden = list[str](), list[str](), Counter[str]()
    longest = min(room, NOTE_LINES) if tables else room
    for note in notes:
        text = _wrapped(note, width, longest)
        if len(texts) + len(text) <= longest:
            texts += text
        else:
            hidden["note"] += 1
    for number, table in enumerate(tables):
        left = room - len(texts) - len(lines)
        block, rows = _table_lines(table, width, None if number else left)
        hidden += Counter(row=rows, table=len(block) > left)
        lines += block if len(block) <= left else []
    return [*lines, *texts], hidden


def _table_lines(table: "TableView", width: int, room: int | None) -> tuple[list[str], int]:
    """Return the lines of a table and an empty one, and the number of rows beyond the room."""
    head, rows, left_out = _columns(table, width)
    head, legend = [*_wrapped(table.title, width, 2), *head], _wrapped(table.legend, width, 4)
    if left_out:
        left_out = _wrapped(f"Columns that do not fit: {', '.join(left_out)}.", width, 1)
    most = len(rows)
    if room is not None and len(head) + most + len(left_out) + len(legend) + 1 > room:
        legend = legend if len(head) + len(left_out) + len(legend) + 5 <= room else []
        most = max(0, room - len(head) - len(left_out) - len(legend) - 2)
    dots = [f"... {len(rows) - most:,} more rows"] * (most < len(rows))
    return [*head, *rows[:most], *dots, *left_out, *legend, ""], max(0, len(rows) - most)


def _columns(table: "TableView", width: int) -> tuple[list[str], list[str], list[str]]:
    """Return headings and rows of the columns that fit the width, and the other headings.

    Headings take two lines if one is not enough, and texts at the end of the line are cut.
    """
    from rich.cells import cell_len, set_cell_size  # late, as above

    rows = [[printable(cell) for cell in row] for row in table.cells()]
    columns = [*zip(table.headings, *rows, strict=True)]
    is_wide = sum(2 + max(map(cell_len, column)) for column in columns) > width + 2
    lines, used, left_out = [""] * (1 + is_wide + len(rows)), 0, list[str]()
    for heading, *cells in columns:
        column = [*(_halves(heading) if is_wide else [heading]), *cells]
        size, limit = max(map(cell_len, column)), width - used - 2 if used else width // 2
        is_number = all(cell[:1] in "+-0123456789" for cell in cells)
        if size > limit:
            if is_number or limit < _CUT:
                left_out.append(heading)
                continue
            short = {cell: f"{set_cell_size(cell, limit - 3).rstrip()}..." for cell in column}
            size, column = limit, [c if cell_len(c) <= limit else short[c] for c in column]
        for k, cell in enumerate(column):
            space, gap = " " * (size - cell_len(cell)), "  " * (used > 0)
            lines[k] += gap + (space + cell if is_number and used else cell + space)
        used += size + 2 * (used > 0)
    lines = [line.rstrip() for line in lines]
    return lines[: 1 + is_wide], lines[1 + is_wide :], left_out


def _halves(heading: str) -> tuple[str, str]:
    """Return a heading on two lines, the longer of which is as short as possible."""
    words = heading.split(" ")
    pairs = ((" ".join(words[:k]), " ".join(words[k:])) for k in range(len(words)))
    return min(pairs, key=lambda pair: max(map(len, pair)))


def _wrapped(text: str, width: int, most: int) -> list[str]:
    """Return a text in lines, at most some; the last line says if more are left out."""
    from rich.cells import set_cell_size  # late, as above
    from rich.console import Console
    from rich.text import Text

    wrapped = Text(printable(text)).wrap(Console(), width)
    lines = [line.plain.rstrip() for line in wrapped] * bool(text)
    if len(lines) > most:
        lines[most - 1] = f"{set_cell_size(lines[most - 1], width - 3).rstrip()}..."
    return lines[:most]
