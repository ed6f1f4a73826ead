"""Table I and Figures 4 to 6: six tracking experiments of section 4.2."""

from experiments.hexapod.choices import MACHINE_FILE, ConfigurationName, JacobianChoice
from experiments.output.study import Option, Study

STUDY = Study(
    name="table1",
    help="""Reproduce Table I and Figures 4 to 6.

    Simulates six spirals of 16 s, with all struts sound and with strut 1 locked, and compares them
    with the linear model of the bench and with the paper. A minute on two cores, 20 s with --quick.

    Writes table1.json, the table as table1.md, Figures 4 to 6, and for each column of the table
    its data (.npz, 1 kHz) and its recording (.rrd, 500 Hz).

    Example: fjh table1 --configuration demand-limit --seed 7 --out /tmp/mine
    """,
    runs="experiments.table1.runs:run_table1",
    results="experiments.table1.results:results",
    quick="Only the first 4 s of the 16 s spiral.",
    options=(
        Option(
            "jacobian",
            JacobianChoice,
            "analytic",
            "Jacobian in the mapping: analytic, at the estimated pose every control tick, or "
            "constant, at the nominal pose as eq. (39). Both are run; this one makes the table.",
        ),
        Option(
            "configuration",
            ConfigurationName,
            "calibrated",
            "Constants of the bench: calibrated to columns W_a to W_e, or, fitted to the last "
            "column as well, with a spiral that turns the other way and a limit of 95 urad on the "
            "pointing that the compensators may demand (docs/uncorrected.md).",
        ),
        MACHINE_FILE,
    ),
)
