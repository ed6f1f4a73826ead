"""The command `fjh recover`."""

from pathlib import Path
from typing import Annotated

import typer

from experiments.app.command import diverged_into
from experiments.app.legacy import Out, Seed
from experiments.output.files import usable_folder
from experiments.output.findings import Findings
from experiments.output.study import Progress


def recover(
    out: Out = Path("results/recover"),
    seed: Seed = 0,
    quick: Annotated[
        bool, typer.Option("--quick", help="Four failures instead of some hundreds.")
    ] = False,
    *,
    progress: Progress,
) -> Findings:
    """Simulate unannounced actuator failures; measure detection, isolation and recovery.

    Locked, free or weak struts, at random times and postures, found from what a controller sends
    and senses with an exact model of the plant; beside an oracle, and beside doing nothing. 20
    minutes on two cores, 45 s with --quick.

    Writes recover.json, the tables as recover.md, a figure, and for some flights their data (.npz)
    and their recordings (.rrd).

    Example: fjh recover --quick --seed 3
    """
    from experiments.recover import report
    from experiments.recover.study import run_recover
    from experiments.recover.summary import summarize
    from experiments.recover.text import findings

    folder = usable_folder(out)
    with progress("recover") as on_progress, diverged_into(folder):
        result = run_recover(seed=seed, quick=quick, on_progress=on_progress)
    return findings(report.write(folder, result, summarize(result, seed)))
