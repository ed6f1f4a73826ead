"""When the study of the last column may be believed."""

from typing import Any

import numpy as np

from experiments.hexapod.checks import CLOSURE_LIMIT_M

PREDICTION_TOLERANCE = 0.03
"""Largest relative distance of an RMS from the linear model's, under the same noise.

Measured: 2.3 % on a floor near resonance, where the physics step shows; 0.7 % everywhere else.
"""


def complaint(summary: dict[str, Any]) -> str | None:
    """One sentence on what makes the study unsound; None when nothing does."""
    runs = [
        column | {"name": f"{column['name']} of {candidate['name']}"}
        for candidate in summary["candidates"]
        for column in candidate["columns"]
    ]
    for run in runs:
        stable = run["sensitivity_peak"] is not None
        opened = run["closure_residual_max_m"]
        if stable and opened is not None and not opened < CLOSURE_LIMIT_M:
            return f"in {run['name']} a loop opened by {opened:.1e} m"
        if sentence := _off(run):
            return sentence
    for point in summary["checked_points"]:
        where = f"{point['damping_ratio']:g}, {point['alpha_crossover_hz']:g} Hz"
        if sentence := _off(point | {"name": f"{point['name']} at {where} of the map"}):
            return sentence
    return None


def _off(run: dict[str, Any]) -> str | None:
    """One sentence on a run that is not the linear model's, where that has a say."""
    if run["predicted_urad"] is None:
        return None
    if run.get("diverged_at_s") is not None:
        return f"{run['name']} diverged, and the linear model calls it stable"
    if run["simulated_urad"] is None:
        return None
    simulated, predicted = np.array(run["simulated_urad"]), np.array(run["predicted_urad"])
    off = float(np.abs(simulated / predicted - 1).max())
    if off < PREDICTION_TOLERANCE:
        return None
    return f"{run['name']} is {100 * off:.1f} % off the linear model"
