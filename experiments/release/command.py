"""The command `fjh release`."""

from pathlib import Path
from typing import Annotated

import typer

from experiments.conduct import Seed, Unsound, diverged_into
from experiments.files import usable_folder
from experiments.terminal import print_rows, progress


def release(
    out: Annotated[Path, typer.Option(help="Folder for results.")] = Path("results/release"),
    seed: Seed = 0,
    quick: Annotated[
        bool, typer.Option("--quick", help="Spirals of 4 s, and three points of the sweep.")
    ] = False,
) -> None:
    """Take coil and spring of strut 1 away.

    From the start and in flight, told to the mapping or not; predicted and simulated. At rest, over
    six decades of stiffness.
    """
    from experiments.release import report
    from experiments.release.study import run_release
    from experiments.release.summary import complaint, summarize

    folder = usable_folder(out)
    with progress("release") as on_progress, diverged_into(folder):
        result = run_release(seed=seed, quick=quick, on_progress=on_progress)
    summary = summarize(result, seed)
    report.write(folder, result, summary)
    print_rows(
        "Strut 1 released: RMS of desired minus true angle, peak of alpha, urad; peak sensitivity",
        report.HEADINGS,
        report.table_rows(summary),
    )
    if sentence := complaint(summary):
        raise Unsound(f"the experiment is not sound: {sentence}")
