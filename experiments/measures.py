"""What is read off a run: errors, inputs, gaps."""

import numpy as np

from experiments.run import Trajectory
from sim import Array


def rms(signal: Array) -> Array:
    """Root mean square over time, the first axis."""
    return np.sqrt((signal**2).mean(axis=0))


def pointing_rms_urad(run: Trajectory) -> Array:
    """RMS of desired minus true (alpha, beta), shape (2,)."""
    return 1e6 * rms(run.desired_rad - run.true_rad)


def finite_or_none(value: float) -> float | None:
    """JSON has no infinity: a phase that never crosses has no gain margin."""
    return value if np.isfinite(value) else None


def closure_residual_max_m(run: Trajectory) -> float:
    """Largest gap of a closed loop in the whole run."""
    return float(run.closure_residual_m.max())
