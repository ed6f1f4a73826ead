"""Thousands of runs on as many machines as there are: `fjh sweep`, and `fjh atlas` of failures."""

from pathlib import Path

from experiments.output.study import Option, Study

PATIENCE_S = 300.0
"""How long a scheduler may be without workers; here, as the help text states it."""

_WHERE = (
    Option(
        "scheduler",
        str | None,
        None,
        f"A Dask scheduler, as tcp://host:8786; given up after {PATIENCE_S:g} s without a worker.  "
        "[default: a cluster on this machine]",
        "ADDRESS",
    ),
    Option("workers", int | None, None, "Processes here.  [default: one for each core]", "N"),
    Option("resume", bool, False, "Continue the runs in the folder; refused if they are others."),
)

STUDY = Study(
    name="sweep",
    help="""Run thousands of closed loops over weights, failures and bench.

    A Latin hypercube or a grid over any of the weights, failures, failure times and bench
    constants; each run is compared with the linear model. The default has 1000 runs of 4 s: about
    ten minutes on two cores, 20 s with --quick.

    Rows are written to a Parquet dataset, OUT/unfinished, as they finish; Ctrl-C keeps them, and
    --resume continues. The bytes are the same whatever the number of workers and interruptions.

    Writes sweep.json, the rows as sweep.parquet (docs/sweep.md has its columns), tables as
    sweep.md, and a figure.

    Example: fjh sweep --quick --workers 2 --out /tmp/mine
    """,
    runs="experiments.sweep.runs:run_sweep",
    results="experiments.sweep.results:results",
    quick="40 runs of 0.5 s, whatever the design says.",
    seed="layout and detector noise",
    options=(
        Option(
            "design",
            Path | None,
            None,
            "What is varied, and how: a TOML file.  [default: experiments/sweep/default.toml]",
            "FILE",
        ),
        *_WHERE,
    ),
    streams=True,
)

ATLAS = Study(
    name="atlas",
    help="""Simulate all 729 failure conditions, and compare them with theory.

    Each strut is sound, locked or free, with the weights W_a to W_e, with the Jacobian of the
    nominal and of the estimated pose, and the mapping knows of the failures. Each run is compared
    with the classification and the linear model, over 2 s of the spiral. 40 minutes on two cores,
    one with --quick. Clusters, interruption and --resume are as in fjh sweep.

    Writes atlas.json, the rows as atlas.parquet (docs/sweep.md has its columns), the table as
    atlas.md, and a figure.

    Example: fjh atlas --quick
    """,
    runs="experiments.sweep.runs:run_atlas",
    results="experiments.sweep.atlas:results",
    quick="The 138 conditions that turning and mirroring leave, W_a, 0.5 s.",
    options=_WHERE,
    streams=True,
)
