"""What is read off a run and its loops: errors, inputs, gaps, margins."""

from typing import Any

import numpy as np

from experiments.hexapod.compensator import Loop
from experiments.hexapod.simulation import Trajectory
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


def loop_measures(loop: Loop) -> dict[str, Any]:
    """Compensator and margins of one pointing loop, ready for JSON."""
    return {
        "numerator": loop.numerator.tolist(),
        "denominator": loop.denominator.tolist(),
        "crossover_hz": loop.crossover_hz,
        "gain_margin_db": finite_or_none(loop.gain_margin_db),
        "phase_margin_deg": loop.phase_margin_deg,
        "phase_crossover_hz": finite_or_none(loop.phase_crossover_hz),
        "sentence": str(loop),
    }


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
