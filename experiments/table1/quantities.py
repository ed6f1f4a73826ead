"""The numbers of a column of Table I."""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from experiments.rig.hexapod import metrics
from experiments.rig.hexapod.columns import secondary, secondary_estimated
from experiments.rig.hexapod.metrics import each_angle
from experiments.rig.run import Run, rms
from experiments.study.quantity import Quantity
from experiments.table1.robustness import TOLERANCE, MismatchedRun
from sim import Array


class Measured(NamedTuple):
    """A run, and what its errors are compared with."""

    run: Run
    paper_urad: tuple[float, float] | None = None
    predicted_rad: Array | None = None
    other: Run | None = None  # with the other Jacobian
    mismatched: MismatchedRun | None = None


RMS = replace(metrics.RMS, heading="*, urad", format=".4f")
PREDICTED = replace(metrics.PREDICTED, heading="  linear model", format=".4f")
DETECTOR = Quantity(
    "*_measured_rms_urad",
    lambda m: 1e6 * rms(m.run.desired - m.run.measured),
    heading="  detector",
    format=".4f",
)
PAPER = Quantity("paper_*_rms_urad", lambda m: m.paper_urad, heading="  paper", format=".4f")
OTHER_JACOBIAN = Quantity("other_jacobian_*_rms_urad", lambda m: m.other and 1e6 * m.other.rms())
MISMATCHED = (
    Quantity(
        "mismatched_*_rms_urad",
        lambda m: m.mismatched and 1e6 * m.mismatched.rms_rad,
        "the RMS error of * with all mismatches, {:.3f} urad,",
        "  mismatched",
        ".4f",
        agrees_with="mismatched_predicted_*_rms_urad",
        within=TOLERANCE,
    ),
    Quantity(
        "mismatched_predicted_*_rms_urad",
        lambda m: m.mismatched and 1e6 * m.mismatched.predicted_rad,
        "the nominal linear model's, {:.3f} urad,",
        "    predicted",
        ".4f",
    ),
)
"""Of both angles, for `each_angle`."""

CLOSURE = replace(metrics.CLOSURE, heading="closure, m", format=".1e")
OTHER_CLOSURE = replace(
    metrics.CLOSURE,
    key="other_jacobian_closure_residual_max_m",
    of=lambda m: m.other and m.other.closure_max_m,
)


def error_quantities(*, with_paper: bool) -> tuple[Quantity, ...]:
    """Of both angles, in the order of the table; the paper's numbers are of whole spirals only."""
    printed = (PAPER,) if with_paper else ()
    return each_angle(RMS, PREDICTED, DETECTOR, *printed, *MISMATCHED, OTHER_JACOBIAN)


COLUMN = (
    *error_quantities(with_paper=True),
    Quantity("strut_input_rms_percent", lambda m: rms(m.run.inputs).tolist()),
    Quantity("strut_input_peak_percent", lambda m: np.abs(m.run.inputs).max(0).tolist()),
    Quantity("secondary_peak", lambda m: _peaks(secondary(m.run))),
    Quantity("secondary_peak_estimated", lambda m: _peaks(secondary_estimated(m.run))),
    CLOSURE,
)
"""All of a run."""


def _peaks(motion: Array) -> dict[str, Any]:
    names = ("gamma_urad", "t_x_um", "t_y_um", "t_z_um")
    return dict(zip(names, (1e6 * np.abs(motion).max(0)).tolist(), strict=True))
