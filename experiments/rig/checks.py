"""What must hold in every study of a robot."""

from experiments.study.result import Check

CLOSURE_LIMIT_M = 1e-8
"""A larger closure residual affects the hexapod's angles: 10 nm is about 0.03 urad."""


def closure_check(where: str, gap_m: float, limit_m: float = CLOSURE_LIMIT_M) -> Check:
    """Check of the largest gap of a closed loop."""
    return Check("closure residual [m]", where, gap_m, limit_m)
