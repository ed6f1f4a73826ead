"""The command `fjh report`."""

from pathlib import Path
from typing import Annotated

import typer

from experiments.app.legacy import Out, seed_option
from experiments.output.files import usable_folder
from experiments.output.findings import Findings
from experiments.output.study import Progress


def report(
    out: Out = Path("results/report"),
    seed: Annotated[int, seed_option("every study")] = 0,
    quick: Annotated[
        bool, typer.Option("--quick", help="Every study with its own --quick: 5 minutes.")
    ] = False,
    *,
    progress: Progress,
) -> Findings:
    """Run every experiment and tell all of it on one page.

    Tables, figures, verdicts, the command that reproduces each chapter, machine, versions and
    commit, on one HTML page that needs no other file. 45 minutes on two cores; bench is left out.

    After Ctrl-C the same command goes on where it stopped: a chapter is run again only if its
    files, its options, the code or the versions of its packages have changed. The page grows with
    every chapter. A chapter that is not sound does not keep the others from being run.

    Writes report.json, report.html, and in a folder for each chapter what its own command writes,
    with chapter.json, by which the report knows it again.

    Example: fjh report --quick --out /tmp/report
    """
    from experiments.app.report import chapters
    from experiments.app.report.study import run_report
    from experiments.app.report.text import findings

    folder = usable_folder(out)
    summary = run_report(folder, chapters.CHAPTERS, seed=seed, quick=quick, progress=progress)
    return findings(summary, folder)
