"""What the linear model says of a candidate before anything is simulated."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from experiments.hexapod.compensator import Loop
from experiments.hexapod.metrics import rms
from experiments.hexapod.prediction import predicted_error_rad, sensitivity_peak
from experiments.hexapod.simulation import nominal_loops
from experiments.uncorrected.candidate import COLUMNS, Candidate
from sim import Array, load_model

LOCKS_M = np.linspace(-250e-6, 250e-6, 101)
"""Where strut 1 is stuck, in the sweep of the lock."""

SETTLED_S = 2.0
"""Time for the loop to take the payload to the centre before a spiral."""


@dataclass(frozen=True)
class Predicted:
    """What the linear model says of one candidate.

    Attributes:
        loops: The (alpha, beta) compensators.
        rms_urad: (2,) by column; None: unstable, or saturated.
        sensitivity: Peak sensitivity of the stable loops, by column.
        settled_urad: (2,) of W_d and W_e if these, other than the uncorrected run, start after the
            loop has settled; None as in `rms_urad`.
    """

    loops: tuple[Loop, Loop]
    rms_urad: dict[str, Array | None]
    sensitivity: dict[str, float | None]
    settled_urad: dict[str, Array | None]


def predict(candidate: Candidate, seed: int, duration_s: float) -> Predicted:
    """The linear model's word on a candidate's four columns."""
    machine = candidate.machine(load_model())
    loops = nominal_loops(machine, candidate.bench)
    rms_urad: dict[str, Array | None] = {}
    sensitivity: dict[str, float | None] = {}
    settled_urad: dict[str, Array | None] = {}
    for column in COLUMNS:
        run = candidate.run(column, seed)
        error = predicted_error_rad(machine, candidate.bench, loops, **run, duration_s=duration_s)
        rms_urad[column] = None if error is None or candidate.saturates else 1e6 * rms(error)
        loop = {key: run[key] for key in ("goal", "failures")}
        sensitivity[column] = (
            None if error is None else sensitivity_peak(machine, candidate.bench, loops, **loop)
        )
    for column in ("W_d", "W_e"):
        later: dict[str, Any] = {"lead_in_s": SETTLED_S}
        run = candidate.run(column, seed) | later
        error = predicted_error_rad(machine, candidate.bench, loops, **run, duration_s=duration_s)
        settled_urad[column] = None if error is None or candidate.saturates else 1e6 * rms(error)
    return Predicted(loops, rms_urad, sensitivity, settled_urad)


def lock_sweep(candidate: Candidate, loops: tuple[Loop, Loop], seed: int) -> Array:
    """Ratios of the uncorrected to the sound RMS over LOCKS_M, shape (101, 2).

    The error is linear in the place of the lock: two responses give all.
    """
    machine, bench = candidate.machine(load_model()), candidate.bench
    run = candidate.run("W_a_uncorrected", seed)
    sound = predicted_error_rad(machine, bench, loops, **candidate.run("W_a", seed))
    at_centre, off = (
        predicted_error_rad(machine, bench, loops, **run | {"start_m": start_m * np.eye(6)[0]})
        for start_m in (0.0, 1e-4)
    )
    assert sound is not None and at_centre is not None and off is not None  # by choice of candidate
    errors = at_centre[:, None] + (off - at_centre)[:, None] * (LOCKS_M / 1e-4)[:, None]
    return rms(errors) / rms(sound)
