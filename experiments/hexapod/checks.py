"""Checks that the runs of the hexapod share: closed loops, and the linear model's prediction."""

from collections.abc import Mapping
from typing import Any

from experiments.hexapod.testbed import Bench
from experiments.output.results import Check

CLOSURE_LIMIT_M = 1e-8
"""A closed loop that opens further spoils the angles: 10 nm is about 0.03 urad."""

PREDICTION_TOLERANCE = 0.004
"""Largest relative distance of a whole run's RMS from the linear model's, which is an expectation.

Measured over all columns of Table I and eight seeds: 0.13 % at the most.
"""


def prediction_tolerance(duration_s: float) -> float:
    """Largest relative distance from the linear model of an RMS over so much of the spiral.

    The noise of the detector scatters the RMS. Over a shorter part the error is smaller, as the
    spiral is, and the noise is averaged less: 1.13 % at the most over 4 s.
    """
    return PREDICTION_TOLERANCE * (Bench().duration_s / duration_s) ** 1.5


def closure_check(where: str, closure_residual_m: float) -> Check:
    """No loop of the mechanism opened."""
    return Check("closure residual [m]", where, closure_residual_m, CLOSURE_LIMIT_M)


def prediction_checks(run: Mapping[str, Any], tolerance: float) -> list[Check]:
    """The RMS errors of a run of a summary are the linear model's; none where none is predicted."""
    checks = []
    for angle in ("alpha", "beta"):
        rms, predicted = run[f"{angle}_rms_urad"], run[f"predicted_{angle}_rms_urad"]
        if predicted is not None:
            what = (
                f"relative distance of the RMS error of {angle}, {rms:.3f} urad, from the linear "
                f"model's, {predicted:.3f} urad,"
            )
            checks.append(Check(what, run["name"], abs(rms - predicted) / predicted, tolerance))
    return checks


def is_cut(summary: Mapping[str, Any]) -> bool:
    """Whether only a part of the spiral was run, which the paper's numbers do not compare with."""
    return summary["duration_s"] < summary["bench"]["duration_s"]
