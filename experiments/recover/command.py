"""The command `fjh recover`."""

from pathlib import Path
from typing import Annotated

import typer

from experiments.conduct import Seed, Unsound, diverged_into
from experiments.files import usable_folder
from experiments.terminal import print_notes, print_rows, progress


def recover(
    out: Annotated[Path, typer.Option(help="Folder for results.")] = Path("results/recover"),
    seed: Seed = 0,
    quick: Annotated[
        bool, typer.Option("--quick", help="Four failures instead of some hundreds.")
    ] = False,
) -> None:
    """Let a strut fail in flight and tell nobody.

    Locked, free or weak, at random times and postures: detected, isolated and flown around, from
    what a controller sends and senses; beside an oracle, and beside doing nothing.
    """
    from experiments.recover import report
    from experiments.recover.soundness import complaint
    from experiments.recover.study import run_recover
    from experiments.recover.summary import summarize
    from experiments.recover.text import HEADINGS, notes, table_rows

    folder = usable_folder(out)
    with progress("recover") as on_progress, diverged_into(folder):
        result = run_recover(seed=seed, quick=quick, on_progress=on_progress)
    summary = summarize(result, seed)
    report.write(folder, result, summary)
    print_rows("A strut fails in flight", HEADINGS, table_rows(summary))
    print_notes(notes(summary))
    if sentence := complaint(summary):
        raise Unsound(f"the experiment is not sound: {sentence}")
