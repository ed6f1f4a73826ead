"""The command `fjh goals`."""

from pathlib import Path
from typing import Annotated

import typer

from experiments.app.command import diverged_into
from experiments.app.legacy import Out, Seed
from experiments.output.files import usable_folder
from experiments.output.findings import Findings
from experiments.output.study import Progress


def goals(
    out: Out = Path("results/goals"),
    seed: Seed = 0,
    quick: Annotated[bool, typer.Option("--quick", help="Shorter runs, one weight.")] = False,
    *,
    progress: Progress,
) -> Findings:
    """Pursue secondary goals: cool coils, free strokes, an obstacle, a singularity.

    Each through the mapping, not at all, and through a weighted pseudo-inverse; pointing must not
    notice the first. 75 s on two cores, 30 s with --quick.

    Writes goals.json, the table as goals.md, a figure, and for each goal its data (.npz) and its
    recording (.rrd).

    Example: fjh goals --seed 2 --out /tmp/goals
    """
    from experiments.goals import report
    from experiments.goals.study import run_goals
    from experiments.goals.summary import summarize
    from experiments.goals.text import findings

    folder = usable_folder(out)
    with progress("goals") as on_progress, diverged_into(folder):
        result = run_goals(seed=seed, quick=quick, on_progress=on_progress)
    return findings(report.write(folder, result, summarize(result, seed, quick)))
