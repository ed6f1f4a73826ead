"""When the numbers of a table may be believed."""

from typing import Any

CLOSURE_LIMIT_M = 1e-8
"""A closed loop that opens further spoils the angles: 10 nm is about 0.03 urad."""

PREDICTION_TOLERANCE = 0.05
"""Largest relative distance of an RMS from the linear model's."""


def complaint(summary: dict[str, Any]) -> str | None:
    """One sentence on what makes a Table I unsound; None when nothing does."""
    columns = summary["columns"]
    opened = max(
        summary["jacobian_comparison"]["next_seed_closure_residual_max_m"],
        *(column["closure_residual_max_m"] for column in columns),
        *(column["other_jacobian_closure_residual_max_m"] for column in columns),
    )
    if not opened < CLOSURE_LIMIT_M:
        return f"a closed loop opened by {opened:.1e} m, more than {CLOSURE_LIMIT_M:.0e} m"
    return next(filter(None, map(off_prediction, columns)), None)


def off_prediction(run: dict[str, Any]) -> str | None:
    """One sentence on an RMS that is not the linear model's; None also where none is predicted."""
    for angle in ("alpha", "beta"):
        rms, predicted = run[f"{angle}_rms_urad"], run[f"predicted_{angle}_rms_urad"]
        if predicted is not None and not abs(rms - predicted) < PREDICTION_TOLERANCE * predicted:
            return (
                f"{angle} of {run['name']} comes out at {rms:.3f} urad RMS where the linear "
                f"model predicts {predicted:.3f}"
            )
    return None
