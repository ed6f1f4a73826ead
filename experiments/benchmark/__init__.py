"""The benchmark: times of the closed loop and the mapping, compared with other libraries."""

from experiments.study.study import Option, Study

STUDY = Study(
    name="bench",
    help="""Time the control loop and the mapping against physics and other libraries.

    The benchmark compares the closed loop with the physics alone, one control tick with mink, one
    Problem 1 with daqp, PlaCo, LAPACK and the paper's formula, for several numbers of actuators and
    batch sizes, and Problem 1 and three levels under limits with daqp. All results are compared
    before the timing; the calls take turns in one process. 2 minutes, one with --quick; do not run
    other work meanwhile.

    Writes bench.json (times in us, medians and their ranges), the tables as bench.md, and a figure.

    Example: fjh bench --quick --out /tmp/before
    """,
    runs="experiments.benchmark.runs:run_bench",
    results="experiments.benchmark.results:results",
    quick="2 s of the spiral, fewer rounds, batches up to 10,000.",
    seed="the detector noise and the random problems",
    options=(
        Option(
            "check",
            bool,
            False,
            "Exit with 1 if a stable ratio exceeds three times its bound.",
        ),
    ),
)
