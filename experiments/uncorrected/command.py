"""The command `fjh uncorrected`."""

from pathlib import Path
from typing import Annotated

import typer

from experiments.conduct import Out, Progress, seed_option
from experiments.files import usable_folder
from experiments.findings import Findings


def uncorrected(
    out: Out = Path("results/uncorrected"),
    seed: Annotated[int, seed_option("the detector noise and the floor")] = 0,
    quick: Annotated[
        bool, typer.Option("--quick", help="Spirals of 4 s, three candidates, a coarse map.")
    ] = False,
    *,
    progress: Progress,
) -> Findings:
    """Ask why the paper's uncorrected lock costs so much.

    Candidate explanations of Table I's last column, one at a time and together, simulated and
    predicted; a map over damping and crossover. 3 minutes on two cores, 20 s with --quick.

    Writes uncorrected.json, a figure, the map (map.npz), the data of each candidate (.npz) and some
    recordings (.rrd).

    Example: fjh uncorrected --quick --out /tmp/why
    """
    from experiments.uncorrected import report
    from experiments.uncorrected.study import run_uncorrected
    from experiments.uncorrected.summary import summarize
    from experiments.uncorrected.text import findings

    folder = usable_folder(out)
    with progress("uncorrected") as on_progress:
        result = run_uncorrected(seed=seed, quick=quick, on_progress=on_progress)
    return findings(report.write(folder, result, summarize(result)))
