"""What must hold in every study of a robot."""

from typing import Any

from experiments.study.results import Check
from sim import CLOSURE_TOLERANCE


def closure_check(summary: dict[str, Any]) -> Check:
    """Whether the robot's loops stayed closed in all runs."""
    gap_m = summary["closure_residual_max_m"]
    return Check("closure residual [m]", summary["robot"], gap_m, CLOSURE_TOLERANCE)
