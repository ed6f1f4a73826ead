"""The command `fjh bench`."""

from pathlib import Path
from typing import Annotated

import typer

from experiments.app.legacy import Out, seed_option
from experiments.benchmark import extra
from experiments.output.files import published, usable_file, usable_folder, write_json
from experiments.output.findings import Findings
from experiments.output.study import Progress, WrongInput


def bench(
    out: Out = Path("results/bench"),
    seed: Annotated[int, seed_option("detector noise and random problems")] = 0,
    quick: Annotated[
        bool,
        typer.Option("--quick", help="2 s of the spiral, fewer rounds, batches up to 10,000."),
    ] = False,
    save: Annotated[
        Path | None,
        typer.Option(metavar="FILE.json", help="Keep the numbers here too, for --compare."),
    ] = None,
    compare: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.json", help="Print what changed since these were saved, beyond noise."
        ),
    ] = None,
    check: Annotated[
        bool,
        typer.Option("--check", help="Unsound, exit code 1, when a ratio leaves its stable bound."),
    ] = False,
    *,
    progress: Progress,
) -> Findings:
    """Time the control loop and the mapping against physics and other libraries.

    The closed loop beside MuJoCo's bare steps; one tick beside mink; one Problem 1 beside daqp,
    PlaCo, LAPACK and the printed formula; growth. All answers are compared first. Medians by
    turns in one process: 2 minutes, 20 s with --quick. Leave the machine alone meanwhile.

    Writes bench.json, times in us, the tables as bench.md, and a figure.

    Example: fjh bench --quick --save /tmp/before.json
    """
    if absent := extra.missing():
        raise WrongInput(
            f"fjh bench compares with packages that are not installed, {', '.join(absent)}: "
            'pip install ".[bench]" in a checkout, or make venv'
        )
    from experiments.benchmark import comparison, report
    from experiments.benchmark.study import FULL, QUICK, measure
    from experiments.benchmark.summary import summarize
    from experiments.benchmark.text import findings

    folder = usable_folder(out)
    if save is not None:
        usable_file(save, ".json", option="--save")
    before = None if compare is None else comparison.saved(compare)
    with progress("bench") as on_progress:
        timed = measure(seed=seed, effort=QUICK if quick else FULL, on_progress=on_progress)
    summary = summarize(timed)
    if save is not None:
        with published(save.parent, index=save.name) as staging:
            write_json(staging / save.name, summary)
    if before is not None:
        summary["comparison"] = comparison.compare(summary, before)
    return findings(report.write(folder, summary), check=check)
