"""The command `fjh uncorrected`."""

from pathlib import Path
from typing import Annotated

import typer

from experiments.conduct import MAX_SEED, Unsound
from experiments.files import usable_folder
from experiments.terminal import print_notes, print_rows, progress


def uncorrected(
    out: Annotated[Path, typer.Option(help="Folder for results.")] = Path("results/uncorrected"),
    seed: Annotated[
        int, typer.Option(min=0, max=MAX_SEED, help="Seed of the detector noise and the floor.")
    ] = 0,
    quick: Annotated[
        bool, typer.Option("--quick", help="Spirals of 4 s, three candidates, a coarse map.")
    ] = False,
) -> None:
    """Ask why the paper's uncorrected lock costs so much.

    Candidate explanations one at a time and together, simulated and predicted; a map over damping
    and crossover.
    """
    from experiments.uncorrected import report
    from experiments.uncorrected.soundness import complaint
    from experiments.uncorrected.study import run_uncorrected
    from experiments.uncorrected.summary import summarize

    folder = usable_folder(out)
    with progress("uncorrected") as on_progress:
        result = run_uncorrected(seed=seed, quick=quick, on_progress=on_progress)
    summary = summarize(result)
    report.write(folder, result, summary)
    print_rows(
        "Strut 1 locked, uncorrected: RMS alpha, beta over those of W_a; W_a, W_d, W_e in urad "
        "(*: the linear model's)",
        report.HEADINGS,
        report.table_rows(summary),
    )
    print_notes([summary["paragraph"]])
    if sentence := complaint(summary):
        raise Unsound(f"the study is not sound: {sentence}")
