"""The command `fjh table1`."""

from pathlib import Path
from typing import Annotated

import typer

from experiments.conduct import Seed, Unsound, diverged_into
from experiments.files import usable_folder
from experiments.mapping import JacobianChoice
from experiments.terminal import print_notes, print_rows, progress


def table1(
    out: Annotated[Path, typer.Option(help="Folder for results.")] = Path("results/table1"),
    seed: Seed = 0,
    quick: Annotated[
        bool, typer.Option("--quick", help="Only the first 4 s of the 16 s spiral.")
    ] = False,
    jacobian: Annotated[
        JacobianChoice,
        typer.Option(
            help="Jacobian in the mapping: analytic, at the estimated pose every control tick, or "
            "constant, at the nominal pose as eq. (39). Both are run; this one makes the table."
        ),
    ] = "analytic",
    model: Annotated[
        Path | None, typer.Option(help="Another MJCF file; default models/fjh.xml.")
    ] = None,
) -> None:
    """Reproduce Table I and Figures 4 to 6.

    Six spirals, sound and with strut 1 locked, and the linear model of the bench beside them.
    """
    # Late: the help text need not wait for MuJoCo's and matplotlib's import.
    from experiments.soundness import complaint
    from experiments.table1 import report
    from experiments.table1.study import run_table1
    from experiments.table1.summary import summarize

    folder = usable_folder(out)
    with progress("Table I") as on_progress, diverged_into(folder):
        result = run_table1(
            mjcf=model, seed=seed, quick=quick, jacobian=jacobian, on_progress=on_progress
        )
    summary = summarize(result)
    report.write(folder, result, summary)
    _print_table(summary)
    if sentence := complaint(summary):
        raise Unsound(f"the table is not sound: {sentence}")


def _print_table(summary: dict) -> None:
    from experiments.table1.text import notes, table_rows, table_title

    columns = summary["columns"]
    headings = [column["name"].replace("_uncorrected", "\nuncorr.") for column in columns]
    rows = [(label, *cells) for label, cells in table_rows(columns)]
    print_rows(table_title(summary), ("", *headings), rows)
    print_notes(notes(summary))
