"""The command `fjh atlas`."""

from pathlib import Path
from typing import Annotated

import typer

from experiments.app.legacy import Out, Seed
from experiments.output.files import usable_folder
from experiments.output.findings import Findings
from experiments.output.study import Progress
from experiments.sweep.command import Resume, Scheduler, Workers


def atlas(
    out: Out = Path("results/atlas"),
    seed: Seed = 0,
    quick: Annotated[
        bool,
        typer.Option(
            "--quick",
            help="The 138 conditions that turning and mirroring leave, W_a, 0.5 s.",
        ),
    ] = False,
    scheduler: Scheduler = None,
    workers: Workers = None,
    resume: Resume = False,
    *,
    progress: Progress,
) -> Findings:
    """Fly all 729 failure conditions, and hold theory against it.

    Each strut sound, locked or free, with W_a to W_e, with the Jacobian of the nominal and of the
    estimated pose, the mapping reconfigured: what the classification and the linear model say, and
    what comes out in 2 s of spiral. 40 minutes on two cores, one with --quick. On a cluster,
    interrupted and resumed as fjh sweep.

    Writes atlas.json, the rows as atlas.parquet (docs/sweep.md has its columns), the table as
    atlas.md, and a figure.

    Example: fjh atlas --quick
    """
    from experiments.atlas import report
    from experiments.atlas.conditions import conditions, representatives
    from experiments.atlas.text import findings
    from experiments.sweep.cluster import Where
    from experiments.sweep.design import Cases, grid
    from experiments.sweep.factors import Choice
    from experiments.sweep.study import complete

    folder, where = usable_folder(out), Where(scheduler, workers)
    factors = [
        Choice("struts", representatives() if quick else conditions()),
        Choice("weight", ("W_a",) if quick else ("W_a", "W_b", "W_c", "W_d", "W_e")),
        Choice("jacobian", ("constant", "analytic")),
    ]
    cases = Cases(grid(0.5 if quick else 2.0, factors), seed)
    with progress("atlas") as on_progress:
        summary = complete(
            folder,
            "atlas.json",
            cases,
            where=where,
            resume=resume,
            on_progress=on_progress,
            write=lambda ran: report.write(folder, ran, cases.design),
        )
    return findings(summary)
