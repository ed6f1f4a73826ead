"""The command `fjh jacobian`."""

from pathlib import Path
from typing import Annotated

import typer

from experiments.app.command import diverged_into
from experiments.app.legacy import Out, seed_option
from experiments.output.files import usable_folder
from experiments.output.findings import Findings
from experiments.output.study import Progress


def jacobian(
    out: Out = Path("results/jacobian"),
    seed: Annotated[int, seed_option("the searches and the detector noise")] = 0,
    quick: Annotated[
        bool, typer.Option("--quick", help="Few local searches; with --loop three sizes, 4 s each.")
    ] = False,
    loop: Annotated[
        bool,
        typer.Option(
            "--loop", help="Also track the spiral with each Jacobian, ever larger: 5 minutes."
        ),
    ] = False,
    *,
    progress: Progress,
) -> Findings:
    """Ask whether the Jacobian is constant, as eq. (40) says.

    Its largest change over the stroke, with a certificate; where the paper's smaller numbers may
    come from; and with --loop what a constant Jacobian costs as spiral and stroke grow. 20 s on two
    cores, 5 minutes with --loop.

    Writes jacobian.json and a figure; with --loop a second figure, and for some runs their data
    (.npz) and their recordings (.rrd).

    Example: fjh jacobian --loop --quick
    """
    from experiments.jacobian import report
    from experiments.jacobian.loop import run_loop
    from experiments.jacobian.loop_summary import summarize_loop
    from experiments.jacobian.study import run_jacobian
    from experiments.jacobian.summary import summarize
    from experiments.jacobian.text import findings

    folder = usable_folder(out)
    with progress("jacobian") as on_progress:
        study = run_jacobian(seed=seed, quick=quick, on_progress=on_progress)
    summary, outcomes = summarize(study, seed), {}
    if loop:
        with progress("in the loop") as on_progress, diverged_into(folder):
            outcomes = run_loop(seed=seed, quick=quick, on_progress=on_progress)
        summary |= {"loop": summarize_loop(outcomes, seed)}
    return findings(report.write(folder, summary, outcomes))
