"""What a person at a terminal sees: progress, tables, and what was written."""

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
def progress(description: str, *, shown: bool = True) -> Iterator[OnProgress]:
    """A progress bar on standard error, if that is a terminal.

    It says that the work is being prepared until a first number of steps is known, and that its
    results are being made after the last step. The work begins here: from here on Ctrl-C is an
    exception.
    """
    # Late: the help text does not wait for it.
    from rich import progress as rich
    from rich.console import Console

    raise_on_interrupt()
    bar = rich.Progress(
        rich.TextColumn("{task.description}"),
        *(rich.BarColumn(), rich.TextColumn("{task.fields[steps]}")),
        *(rich.TimeElapsedColumn(), rich.TimeRemainingColumn()),
        console=Console(stderr=True),
        transient=True,
        disable=not (shown and sys.stderr.isatty()),
    )
    with bar:
        task = bar.add_task(f"{description}: preparing", total=None, steps="")

        def update(done: int, total: int) -> None:
            said = description if done < total else f"{description}: evaluating"
            bar.update(task, description=said, completed=done, total=total, steps=f"{done}/{total}")

        yield update


def print_table(table: "TableView") -> None:
    """A table on standard output, its legend below; a wide one goes on below itself."""
    import pandas as pd  # late, as above
    from rich.console import Console

    # Units stand in brackets, where markup would.
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
    """Sentences on standard output, one paragraph each."""
    from rich.console import Console

    for note in notes:
        Console().print(note, emoji=False, highlight=False, markup=False)


def print_ending(checked: str, written: Path, following: str) -> None:
    """Three lines on standard output; paths and commands are not broken, so as to be copied.

    Args:
        checked: What was checked, and with which result; a sentence.
        written: The file to open first.
        following: The command that a user would type next.
    """
    from rich.console import Console

    console = Console(highlight=False, markup=False)
    console.print(f"\n{checked}")
    console.print(f"Files are in {written.parent}; open {written} first.", soft_wrap=True)
    console.print(f"Next: {following}", soft_wrap=True)
