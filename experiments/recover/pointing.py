"""Pointing errors of a flight of the hexapod: before something happens, while it does, after."""

from dataclasses import dataclass

import numpy as np

from experiments.recover.recovery import BEFORE_S, RECOVERED_S
from experiments.rig.run import Run
from experiments.study.campaign import Row
from sim import Array

WHEN = ("before", "during", "after")

_TRANSIENT_S = 0.5
"""Of each flight, not counted; half of the time before what happens, if that is less."""


@dataclass(frozen=True)
class Errors:
    """Pointing error |desired - true|, both angles together: before, during, after recovery."""

    rms_urad: tuple[float, ...]
    peak_urad: tuple[float, ...]


def errors(run: Run, struck_s: float = BEFORE_S) -> Errors:
    """Before, during and after what happens so long after the first tick: see RECOVERED_S."""
    period_s = run.time_s[1] - run.time_s[0]
    begin_s = min(_TRANSIENT_S, struck_s / 2)
    edges = [round(s / period_s) for s in (begin_s, struck_s, struck_s + RECOVERED_S)]
    _, *parts = np.split(pointing_error_urad(run.desired, run.true), edges)
    return Errors(
        rms_urad=tuple(float(np.sqrt((part**2).mean())) for part in parts),
        peak_urad=tuple(float(part.max()) for part in parts),
    )


def error_columns(controller: str, run: Run, struck_s: float = BEFORE_S) -> Row:
    """They as columns of the dataset."""
    found = errors(run, struck_s)
    return {
        f"{what}_{controller}_{when}_urad": getattr(found, f"{what}_urad")[k]
        for k, when in enumerate(WHEN)
        for what in ("rms", "peak")
    }


def pointing_error_urad(desired_rad: Array, true_rad: Array) -> Array:
    """Size of desired minus true (alpha, beta), shape (N,)."""
    return 1e6 * np.linalg.norm(desired_rad - true_rad, axis=1)
