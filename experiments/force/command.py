"""The command `fjh force`."""

from pathlib import Path
from typing import Annotated

import typer

from experiments.conduct import MAX_SEED, Unsound, diverged_into
from experiments.files import usable_folder
from experiments.terminal import print_rows, progress


def force(
    out: Annotated[Path, typer.Option(help="Folder for results.")] = Path("results/force"),
    seed: Annotated[
        int, typer.Option(min=0, max=MAX_SEED, help="Seed of the directions of all forces.")
    ] = 0,
    quick: Annotated[bool, typer.Option("--quick", help="Only strut 1 fails.")] = False,
) -> None:
    """Exert and hold forces through the force mapping.

    Theorems 7, 8 and 9 on the hexapod, sound, with a locked and with a free strut: against a fixed
    environment, and against a prescribed wrench. The platform on four legs with its internal force.
    """
    from experiments.force import report
    from experiments.force.soundness import complaint
    from experiments.force.study import run_force
    from experiments.force.summary import summarize
    from experiments.force.text import tables

    folder = usable_folder(out)
    with progress("force") as on_progress, diverged_into(folder):
        result = run_force(seed=seed, quick=quick, on_progress=on_progress)
    summary = summarize(result, seed)
    report.write(folder, result, summary)
    for table in tables(summary):
        print_rows(table.title, table.headings, table.rows)
    if sentence := complaint(summary):
        raise Unsound(f"the experiment is not sound: {sentence}")
