"""Many closed loops on one computer or a cluster: `fjh sweep`, and `fjh atlas` of failures."""

from pathlib import Path

from experiments.study.spelling import check_file
from experiments.study.study import Option, Study
from experiments.study.where import WHERE

STUDY = Study(
    name="sweep",
    help="""Simulate many closed loops with varied weights, failures and constants.

    The design is a Latin hypercube or a grid over weights, failures, failure times and constants of
    the testbed; each run is compared with the linear model. The default has 1000 runs of 4 s:
    10 to 30 minutes on two cores, 20 s with --quick.

    Rows are written to a Parquet dataset, OUT/unfinished, as they finish; Ctrl-C keeps them, and
    --resume continues. The result is identical to the bit for any number of workers and
    interruptions, on processors of one kind.

    Writes sweep.json, the rows as sweep.parquet (docs/sweep.md has its columns), tables as
    sweep.md, and a figure.

    Example: fjh sweep --quick --workers 2 --out /tmp/mine
    """,
    runs="experiments.sweep.runs:run_sweep",
    results="experiments.sweep.results:results",
    quick="40 runs of 0.5 s, for any design.",
    seed="the layout and the detector noise",
    options=(
        Option(
            "design",
            Path | None,
            None,
            "TOML file that says what is varied.  [default: experiments/sweep/default.toml]",
            "FILE",
            parse=check_file,
        ),
        *WHERE,
    ),
    streams=True,
    again="experiments.sweep.again:again",
)

ATLAS = Study(
    name="atlas",
    help="""Simulate the 138 failure conditions that differ by symmetry; compare them with theory.

    In a failure condition each strut works, is locked, or is free (without force); the mapping
    knows the condition. Of the 729, those that differ by rotation and mirror symmetry of the
    machine are simulated for 2 s of the spiral with the weights W_a to W_e of Table I and with the
    Jacobian of the nominal and of the estimated pose, and compared with their classification and
    the linear model. Nine minutes on two cores, one with --quick. Clusters, interruption and
    --resume are as in fjh sweep.

    Writes atlas.json, the rows as atlas.parquet (docs/sweep.md has its columns), the table as
    atlas.md, and a figure.

    Example: fjh atlas --quick
    """,
    runs="experiments.sweep.runs:run_atlas",
    results="experiments.sweep.atlas:results",
    quick="W_a only, 0.5 s.",
    options=WHERE,
    streams=True,
    again="experiments.sweep.again:again",
    in_report=None,
)
