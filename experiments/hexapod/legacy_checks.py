"""When the numbers of a table may be believed."""

from typing import Any

from experiments.hexapod.testbed import Bench

CLOSURE_LIMIT_M = 1e-8
"""A closed loop that opens further spoils the angles: 10 nm is about 0.03 urad."""

PREDICTION_TOLERANCE = 0.004
"""Largest relative distance of a whole run's RMS from the linear model's, which is an expectation.

Measured over all columns of Table I and eight seeds: 0.13 % at the most.
"""


def complaint(summary: dict[str, Any]) -> str | None:
    """One sentence on what makes a Table I unsound; None when nothing does."""
    columns, tolerance = summary["columns"], prediction_tolerance(summary["duration_s"])
    opened = max(
        summary["jacobian_comparison"]["next_seed_closure_residual_max_m"],
        *(column["closure_residual_max_m"] for column in columns),
        *(column["other_jacobian_closure_residual_max_m"] for column in columns),
    )
    if not opened < CLOSURE_LIMIT_M:
        return f"a closed loop opened by {opened:.1e} m, more than {CLOSURE_LIMIT_M:.0e} m"
    return next(filter(None, (off_prediction(column, tolerance) for column in columns)), None)


def prediction_tolerance(duration_s: float) -> float:
    """Largest relative distance from the linear model of an RMS over so much of the spiral.

    The noise of the detector scatters the RMS. Over a shorter part the error is smaller, as the
    spiral is, and the noise is averaged less: 1.13 % at the most over 4 s.
    """
    return PREDICTION_TOLERANCE * (Bench().duration_s / duration_s) ** 1.5


def off_prediction(run: dict[str, Any], tolerance: float) -> str | None:
    """One sentence on an RMS that is not the linear model's; None also where none is predicted."""
    for angle in ("alpha", "beta"):
        rms, predicted = run[f"{angle}_rms_urad"], run[f"predicted_{angle}_rms_urad"]
        if predicted is not None and not abs(rms - predicted) < tolerance * predicted:
            return (
                f"{angle} of {run['name']} comes out at {rms:.3f} urad RMS where the linear "
                f"model predicts {predicted:.3f}"
            )
    return None
