"""The command `fjh systems`."""

from pathlib import Path
from typing import Annotated

import typer

from experiments.app.command import diverged_into
from experiments.app.legacy import Out, seed_option
from experiments.output.files import usable_folder
from experiments.output.findings import Findings
from experiments.output.study import Progress


def systems(
    out: Out = Path("results/systems"),
    seed: Annotated[int, seed_option("the directions that are tried")] = 0,
    quick: Annotated[
        bool, typer.Option("--quick", help="Only the first three conditions of each.")
    ] = False,
    *,
    progress: Progress,
) -> Findings:
    """Classify and drive four other mechanisms.

    An arm, a hand, two arms and a platform, sound and failed; the simulation is compared with what
    the classification says: 12 s on two cores, 8 s with --quick.

    Writes systems.json, the table as systems.md, a figure, and for each mechanism its data (.npz)
    and its recording (.rrd).

    Example: fjh systems --seed 1 --out /tmp/mechanisms
    """
    from experiments.systems import report
    from experiments.systems.study import run_systems
    from experiments.systems.summary import summarize
    from experiments.systems.text import findings

    folder = usable_folder(out)
    with progress("systems") as on_progress, diverged_into(folder):
        result = run_systems(seed=seed, quick=quick, on_progress=on_progress)
    return findings(report.write(folder, result, summarize(result, seed)))
