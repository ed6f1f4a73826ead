"""The command `fjh bench`."""

from pathlib import Path
from typing import Annotated

import typer

from experiments.conduct import Out, Progress, Seed
from experiments.files import published, usable_folder, write_index
from experiments.findings import Findings


def bench(
    out: Out = Path("results/bench"),
    seed: Seed = 0,
    quick: Annotated[
        bool, typer.Option("--quick", help="Time 0.5 s of simulation instead of 4 s.")
    ] = False,
    *,
    progress: Progress,
) -> Findings:
    """Time the control loop against bare physics.

    Ratios of medians of five, in one process: half a minute, 7 s with --quick. Leave the machine
    alone meanwhile.

    Writes bench.json.

    Example: fjh bench
    """
    from experiments.speed.study import measure
    from experiments.speed.text import findings

    folder, simulated_s = usable_folder(out), 0.5 if quick else 4.0
    with progress("bench") as on_progress:
        result = measure(seconds=simulated_s, repeats=5, seed=seed, on_progress=on_progress)
    with published(folder, index="bench.json") as staging:
        return findings(write_index(staging / "bench.json", result))
