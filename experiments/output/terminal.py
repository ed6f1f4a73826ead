"""What a person at a terminal sees: progress and tables."""

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

from rich import box
from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Table as RichTable

from experiments.output.interrupt import raise_from_now_on
from experiments.output.tables import Table


@contextmanager
def progress(description: str, *, shown: bool = True) -> Iterator[Callable[[int, int], None]]:
    """A progress bar on a terminal's standard error; nothing where that is a file or a pipe.

    The work begins here: from here on Ctrl-C is an exception.
    """
    raise_from_now_on()
    bar = Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        console=Console(stderr=True),
        transient=True,
        disable=not (shown and sys.stderr.isatty()),
    )
    with bar:
        task = bar.add_task(description, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


def print_table(table: Table) -> None:
    """A table on standard output, its legend below."""
    drawn = RichTable(title=table.title, title_justify="left", box=box.SIMPLE)
    for k, heading in enumerate(table.headings):
        drawn.add_column(heading, justify="right" if k else "left", no_wrap=True)
    for row in table.rows:
        drawn.add_row(*row)
    Console().print(drawn)
    if table.legend:
        Console().print(f"{table.legend}\n", highlight=False, markup=False)


def print_notes(notes: Sequence[str]) -> None:
    """Sentences on standard output, one paragraph each."""
    for note in notes:
        Console().print(note, highlight=False, markup=False)


def notice(sentence: str) -> None:
    """A sentence on standard error, whatever is left out or shown beside it."""
    print(f"fjh: {sentence}", file=sys.stderr, flush=True)
