"""The command `fjh uncorrected`."""

from pathlib import Path
from typing import Annotated

import typer

from experiments.app.legacy import Out, seed_option
from experiments.output.files import usable_folder
from experiments.output.findings import Findings
from experiments.output.study import Progress


def uncorrected(
    out: Out = Path("results/uncorrected"),
    seed: Annotated[int, seed_option("the detector noise and the floor")] = 0,
    quick: Annotated[
        bool, typer.Option("--quick", help="Spirals of 4 s, three candidates, coarse maps.")
    ] = False,
    *,
    progress: Progress,
) -> Findings:
    """Test explanations for the large error in the last column of Table I.

    Candidates one at a time and together, simulated and predicted; maps over damping and
    crossover, and over a limit on the demanded pointing, its spiral and anti-windup; a detector
    off the focus. 4 minutes on two cores, 25 s with --quick.

    Writes uncorrected.json, two figures, the maps (map.npz, limit_map.npz), the data of each
    candidate (.npz) and some recordings (.rrd).

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
