"""The command `fjh table1`."""

from pathlib import Path
from typing import Annotated

import typer

from experiments.app.command import diverged_into
from experiments.app.legacy import MachineFile, Out, Seed
from experiments.hexapod.choices import ConfigurationName, JacobianChoice
from experiments.output.files import usable_folder
from experiments.output.findings import Findings
from experiments.output.study import Progress


def table1(
    out: Out = Path("results/table1"),
    seed: Seed = 0,
    quick: Annotated[
        bool, typer.Option("--quick", help="Only the first 4 s of the 16 s spiral.")
    ] = False,
    jacobian: Annotated[
        JacobianChoice,
        typer.Option(
            help="Jacobian in the mapping: analytic, at the estimated pose every control tick, or "
            "constant, at the nominal pose as eq. (39). Both are run; this one makes the table."
        ),
    ] = "analytic",
    configuration: Annotated[
        ConfigurationName,
        typer.Option(
            help="Constants of the bench: calibrated to columns W_a to W_e, or, fitted to the last "
            "column as well, with a spiral that turns the other way and a limit of 95 urad on the "
            "pointing that the compensators may demand (docs/uncorrected.md)."
        ),
    ] = "calibrated",
    model: MachineFile = None,
    *,
    progress: Progress,
) -> Findings:
    """Reproduce Table I and Figures 4 to 6.

    Six spirals of 16 s, sound and with strut 1 locked, and the linear model of the bench beside
    them: a minute on two cores, 20 s with --quick.

    Writes table1.json, the table as table1.md, Figures 4 to 6, and for each column of the table
    its data (.npz, 1 kHz) and its recording (.rrd, 500 Hz).

    Example: fjh table1 --configuration demand-limit --seed 7 --out /tmp/mine
    """
    # Late: the help text need not wait for MuJoCo's and matplotlib's import.
    from experiments.table1 import report
    from experiments.table1.study import run_table1
    from experiments.table1.summary import summarize
    from experiments.table1.text import findings

    folder = usable_folder(out)
    with progress("Table I") as on_progress, diverged_into(folder):
        result = run_table1(
            mjcf=model,
            seed=seed,
            quick=quick,
            jacobian=jacobian,
            configuration=configuration,
            on_progress=on_progress,
        )
    return findings(report.write(folder, result, summarize(result)))
