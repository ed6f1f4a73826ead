"""Output on the terminal: progress, tables, and a summary of the files written."""

import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from fjh.study.interrupts import raise_on_interrupt
from fjh.study.option import OnProgress

if TYPE_CHECKING:
    from fjh.study.result import TableView


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


def print_table(table: "TableView") -> None:
    """Print a table and its legend on standard output; wide tables are wrapped by columns."""
    import pandas as pd  # late, as above
    from rich.console import Console

    # Brackets hold units, not markup.
    console = Console(markup=False, emoji=False, highlight=False)
    first, *headings = table.headings
    cells = table.cells()
    frame = pd.DataFrame([row[1:] for row in cells], [row[0] for row in cells], headings)
    if table.title:
        console.print(table.title, style="italic")
    text = frame.rename_axis(columns=first).to_string(line_width=console.width)
    console.print(f"\n{text}\n", soft_wrap=True)
    if table.legend:
        console.print(f"{table.legend}\n")


def print_notes(notes: Sequence[str]) -> None:
    """Print sentences on standard output, one paragraph each."""
    from rich.console import Console

    for note in notes:
        Console().print(note, emoji=False, highlight=False, markup=False)


def print_summary(checked: str, written: Path, following: str) -> None:
    """Print a summary of three lines on standard output, without breaking paths and commands.

    Args:
        checked: Sentence with the result of the checks.
        written: File to open first.
        following: Command to run next.
    """
    from rich.console import Console

    console = Console(highlight=False, markup=False)
    console.print(f"\n{checked}")
    console.print(f"Files are in {written.parent}; open {written} first.", soft_wrap=True)
    console.print(f"Next: {following}", soft_wrap=True)
