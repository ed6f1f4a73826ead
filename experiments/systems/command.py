"""The command `fjh systems`."""

from pathlib import Path
from typing import Annotated

import typer

from experiments.conduct import MAX_SEED, Unsound, diverged_into
from experiments.files import usable_folder
from experiments.terminal import print_rows, progress


def systems(
    out: Annotated[Path, typer.Option(help="Folder for results.")] = Path("results/systems"),
    seed: Annotated[
        int, typer.Option(min=0, max=MAX_SEED, help="Seed of the directions that are tried.")
    ] = 0,
    quick: Annotated[
        bool, typer.Option("--quick", help="Only the first three conditions of each.")
    ] = False,
) -> None:
    """Classify and drive four other mechanisms.

    An arm, a hand, two arms and a platform, sound and failed; the simulation is compared with what
    the classification says.
    """
    from experiments.systems import report
    from experiments.systems import summary as systems_summary
    from experiments.systems.study import run_systems

    folder = usable_folder(out)
    with progress("systems") as on_progress, diverged_into(folder):
        examinations = run_systems(seed=seed, quick=quick, on_progress=on_progress)
    summary = systems_summary.summarize(examinations, seed)
    report.write(folder, examinations, summary)
    title = "What the classification says; `off by`: simulated motion and torques"
    print_rows(title, systems_summary.HEADINGS, systems_summary.table_rows(summary))
    if sentence := systems_summary.complaint(summary):
        raise Unsound(f"the experiment is not sound: {sentence}")
