"""The command `fjh force`."""

from pathlib import Path
from typing import Annotated

import typer

from experiments.app.command import diverged_into
from experiments.app.legacy import Out, seed_option
from experiments.output.files import usable_folder
from experiments.output.findings import Findings
from experiments.output.study import Progress


def force(
    out: Out = Path("results/force"),
    seed: Annotated[int, seed_option("the directions of all forces")] = 0,
    quick: Annotated[bool, typer.Option("--quick", help="Only strut 1 fails.")] = False,
    *,
    progress: Progress,
) -> Findings:
    """Exert and hold forces through the force mapping.

    Theorems 7, 8 and 9 on the hexapod, sound, with a locked and with a free strut: against a fixed
    environment, and against a prescribed wrench. The platform on four legs with its internal force.
    35 s on two cores, 12 s with --quick.

    Writes force.json, a figure, all forces that were asked and read (.npz) and a recording (.rrd).

    Example: fjh force --quick --json --quiet
    """
    from experiments.force import report
    from experiments.force.study import run_force
    from experiments.force.summary import summarize
    from experiments.force.text import findings

    folder = usable_folder(out)
    with progress("force") as on_progress, diverged_into(folder):
        result = run_force(seed=seed, quick=quick, on_progress=on_progress)
    return findings(report.write(folder, result, summarize(result, seed)))
