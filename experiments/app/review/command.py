"""The command `fjh review`."""

from pathlib import Path
from typing import Annotated

import typer

from experiments.app.command import machine_refused
from experiments.app.legacy import MachineFile
from experiments.output.files import published, usable_file
from experiments.output.terminal import raise_on_interrupt


def review(
    runs: Annotated[
        list[Path],
        typer.Argument(
            metavar="RUN", help="Folders of results, and single runs (.npz), of the hexapod."
        ),
    ],
    out: Annotated[Path, typer.Option(metavar="FILE.rrd", help="The recording to write.")] = Path(
        "review.rrd"
    ),
    model: MachineFile = None,
) -> None:
    """Put runs side by side in one recording.

    All columns of Table I, or any set of runs: a column each with spiral, errors, inputs and
    secondary motion, the same scales in all; a page with the hexapods in 3D, and one with the
    numbers, the paper's beside them. Seconds.

    Example: fjh review results/table1 --out /tmp/table1.rrd
    """
    from experiments.app.review.runs import about_runs, find_runs
    from experiments.hexapod.recording.screens import write_side_by_side
    from sim import hexapod, load_model, model_sha256

    folder = usable_file(out, ".rrd")
    raise_on_interrupt()
    with machine_refused():
        machine = load_model(model)
        hexapod(machine)  # refuses any other
        kept = find_runs(runs, model_sha256(model))
        shown = {name: one.shown for name, one in kept.items()}
        with published(folder, index=out.name) as staging:
            write_side_by_side(staging / out.name, about_runs(kept), machine, shown)
