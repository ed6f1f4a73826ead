"""How fast: the closed loop beside bare physics, the mapping beside other libraries."""

from pathlib import Path

from experiments.output.study import Option, Study

STUDY = Study(
    name="bench",
    help="""Time the control loop and the mapping against physics and other libraries.

    The closed loop is compared with MuJoCo's bare steps, one tick with mink, and one Problem 1 with
    daqp, PlaCo, LAPACK and the printed formula, also over the number of actuators and the size of a
    batch. All answers are compared first. The contenders are timed by turns in one process: 2
    minutes, 20 s with --quick. No other work should run meanwhile.

    Writes bench.json (times in us, medians and their ranges), the tables as bench.md, and a figure.

    Example: fjh bench --quick --save /tmp/before.json
    """,
    runs="experiments.benchmark.runs:run_bench",
    results="experiments.benchmark.results:results",
    quick="2 s of the spiral, fewer rounds, batches up to 10,000.",
    seed="the detector noise and the random problems",
    options=(
        Option("save", Path | None, None, "Keep the numbers here too, for --compare.", "FILE.json"),
        Option(
            "compare",
            Path | None,
            None,
            "Print what changed, by more than noise, since these were saved.",
            "FILE.json",
        ),
        Option(
            "check",
            bool,
            False,
            "Fail, exit code 1, when a stable ratio is beyond twice its bound.",
        ),
    ),
)
