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


def percent(difference: Array, whole: Array) -> float:
    """Size of a difference of twists or wrenches (..., 6), in percent of the whole.

    Rotation and translation, or moment and force, each against its own; the larger of the two.
    """
    parts = (slice(0, 3), slice(3, 6))
    ratios = [np.linalg.norm(difference[..., p]) / np.linalg.norm(whole[..., p]) for p in parts]
    return float(100 * max(ratios))
