"""The command `fjh release`."""

from pathlib import Path
from typing import Annotated

import typer

from experiments.output.files import usable_folder
from experiments.output.results import Findings
from experiments.output.study import Out, Progress, Seed, diverged_into


def release(
    out: Out = Path("results/release"),
    seed: Seed = 0,
    quick: Annotated[
        bool, typer.Option("--quick", help="Spirals of 4 s, and three points of the sweep.")
    ] = False,
    *,
    progress: Progress,
) -> Findings:
    """Take coil and spring of strut 1 away.

    From the start and in flight, told to the mapping or not; predicted and simulated. At rest, over
    six decades of stiffness. 35 s on two cores, 15 s with --quick.

    Writes release.json, a figure, all 3^6 conditions (atlas.npz), and for each spiral its data
    (.npz) and its recording (.rrd).

    Example: fjh release --quick
    """
    from experiments.release import report
    from experiments.release.study import run_release
    from experiments.release.summary import summarize
    from experiments.release.text import findings

    folder = usable_folder(out)
    with progress("release") as on_progress, diverged_into(folder):
        result = run_release(seed=seed, quick=quick, on_progress=on_progress)
    return findings(report.write(folder, result, summarize(result, seed)))
