"""The command `fjh sweep`."""

from pathlib import Path
from typing import Annotated

import typer

from experiments.app.legacy import Out, seed_option
from experiments.output.files import usable_folder
from experiments.output.findings import Findings
from experiments.output.study import Progress
from experiments.sweep.waiting import PATIENCE_S

DesignFile = Annotated[
    Path | None,
    typer.Option(
        "--design",
        metavar="FILE",
        help="What is varied, and how: a TOML file.  [default: experiments/sweep/default.toml]",
    ),
]
Scheduler = Annotated[
    str | None,
    typer.Option(
        metavar="ADDRESS",
        help=f"A Dask scheduler, as tcp://host:8786; given up after {PATIENCE_S:g} s without a "
        "worker.  [default: a cluster on this machine]",
    ),
]
Workers = Annotated[
    int | None,
    typer.Option(
        min=1, metavar="N", help="Processes on this machine.  [default: one for each core]"
    ),
]
Resume = Annotated[
    bool,
    typer.Option(
        "--resume", help="Go on with what is in the folder; refused if it is another sweep."
    ),
]


def sweep(
    out: Out = Path("results/sweep"),
    seed: Annotated[int, seed_option("layout and detector noise")] = 0,
    quick: Annotated[
        bool, typer.Option("--quick", help="40 runs of 0.5 s, whatever the design says.")
    ] = False,
    design: DesignFile = None,
    scheduler: Scheduler = None,
    workers: Workers = None,
    resume: Resume = False,
    *,
    progress: Progress,
) -> Findings:
    """Run thousands of closed loops over weights, failures and bench.

    A Latin hypercube or a grid over any of the weights, failures, failure times and bench
    constants, each run beside the linear model. The default has 1000 runs of 4 s: about ten minutes
    on two cores, 20 s with --quick.

    Rows are written to a Parquet dataset, OUT/unfinished, as they finish; Ctrl-C keeps them, and
    --resume goes on. The bytes are the same whatever the number of workers and the interruptions.

    Writes sweep.json, the rows as sweep.parquet (docs/sweep.md has its columns), tables as
    sweep.md, and a figure.

    Example: fjh sweep --quick --workers 2 --out /tmp/mine
    """
    from dataclasses import replace

    from experiments.sweep import report
    from experiments.sweep.cluster import Where
    from experiments.sweep.design import Cases
    from experiments.sweep.read import read_design
    from experiments.sweep.study import complete
    from experiments.sweep.text import findings

    folder, where, chosen = usable_folder(out), Where(scheduler, workers), read_design(design)
    if quick:
        chosen = replace(chosen, runs=min(chosen.runs, 40), duration_s=0.5)
    cases = Cases(chosen, seed)
    with progress("sweep") as on_progress:
        summary = complete(
            folder,
            "sweep.json",
            cases,
            where=where,
            resume=resume,
            on_progress=on_progress,
            write=lambda ran: report.write(folder, ran, chosen),
        )
    return findings(summary)
