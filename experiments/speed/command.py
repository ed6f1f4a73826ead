"""The command `fjh bench`."""

from pathlib import Path
from typing import Annotated

import typer

from experiments.conduct import Seed
from experiments.files import published, usable_folder, write_json
from experiments.terminal import progress


def bench(
    out: Annotated[Path, typer.Option(help="Folder for bench.json.")] = Path("results/bench"),
    seed: Seed = 0,
    quick: Annotated[
        bool, typer.Option("--quick", help="Time 0.5 s of simulation instead of 4 s.")
    ] = False,
) -> None:
    """Time the loop against bare physics.

    Ratios of medians of five, in one process.
    """
    from experiments.speed.study import measure

    folder = usable_folder(out)
    with progress("bench") as on_progress:
        result = measure(
            seconds=0.5 if quick else 4.0, repeats=5, seed=seed, on_progress=on_progress
        )
    with published(folder, index="bench.json") as staging:
        write_json(staging / "bench.json", result)
    for name, ratio in result["closed_loop_over_mj_step"].items():
        factor = result["real_time_factor"][f"closed_loop_{name}"]
        print(f"{name} Jacobian: {ratio:.2f} x mj_step, {factor:.1f} x real time")
