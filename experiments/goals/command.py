"""The command `fjh goals`."""

from pathlib import Path
from typing import Annotated

import typer

from experiments.conduct import Seed, Unsound, diverged_into
from experiments.files import usable_folder
from experiments.terminal import print_rows, progress


def goals(
    out: Annotated[Path, typer.Option(help="Folder for results.")] = Path("results/goals"),
    seed: Seed = 0,
    quick: Annotated[bool, typer.Option("--quick", help="Shorter runs, one weight.")] = False,
) -> None:
    """Pursue secondary goals: cool coils, free strokes, an obstacle, a singularity.

    Each through the mapping, not at all, and through a weighted pseudo-inverse; pointing must not
    notice the first.
    """
    from experiments.goals import report
    from experiments.goals import summary as goals_summary
    from experiments.goals.study import run_goals

    folder = usable_folder(out)
    with progress("goals") as on_progress, diverged_into(folder):
        outcomes = run_goals(seed=seed, quick=quick, on_progress=on_progress)
    summary = goals_summary.summarize(outcomes, seed, quick)
    report.write(folder, outcomes, summary)
    title = "Secondary measure at its worst; desired minus true pointing, larger angle, urad"
    print_rows(title, goals_summary.HEADINGS, goals_summary.table_rows(summary))
    if sentence := goals_summary.complaint(summary):
        raise Unsound(f"the experiment is not sound: {sentence}")
