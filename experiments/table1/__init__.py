"""Table I and Figures 4 to 6: the six tracking experiments of section 4.2."""

from typing import Literal

from experiments.rig.options import MACHINE_FILE, JacobianChoice
from experiments.study.controllers import CONTROLLER
from experiments.study.study import Option, Study

ConfigurationName = Literal["calibrated", "demand-limit"]
"""Configurations of the bench in Table I, see :mod:`experiments.table1.runs`."""

STUDY = Study(
    name="table1",
    help="""Reproduce Table I and Figures 4 to 6 of the paper.

    The hexapod tracks a spiral for 16 s in six cases (columns W_a to W_e and W_a uncorrected),
    without failure and with strut 1 locked. The pointing errors are compared with the linear model
    of the testbed and with the paper. Three cases are simulated once more with plants that differ
    from the controller's model. A minute and a half on two cores, 30 s with --quick.

    Writes table1.json, the table as table1.md, Figures 4 to 6, and for each column of the table
    its data (.npz, 1 kHz) and its recording (.rrd, 200 Hz). With --controller three more columns,
    by that controller: without failure, with strut 1 locked and known, and locked and not known.

    Example: fjh table1 --configuration demand-limit --seed 7 --out /tmp/mine
    """,
    runs="experiments.table1.runs:run_table1",
    results="experiments.table1.results:results",
    quick="Only the first 4 s of the 16 s spiral, one mismatched plant.",
    options=(
        Option(
            "jacobian",
            JacobianChoice,
            "analytic",
            "Jacobian of the mapping: analytic, at the estimated pose in every control tick, or "
            "constant, at the nominal pose as in eq. (39). Both are simulated; the table shows "
            "this one.",
        ),
        Option(
            "configuration",
            ConfigurationName,
            "calibrated",
            "Constants of the testbed: calibrated, fitted to columns W_a to W_e; demand-limit, "
            "fitted to the last column as well by a clockwise spiral and a limit of 95 urad on the "
            "pointing that the compensators may demand (docs/uncorrected.md).",
        ),
        MACHINE_FILE,
        CONTROLLER,
    ),
)
