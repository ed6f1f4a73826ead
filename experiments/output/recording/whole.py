"""Whether arrays from a file are a run of the hexapod."""

from collections.abc import Mapping

import numpy as np

from experiments.hexapod.simulation import Trajectory
from experiments.output.study import WrongInput
from sim import Array

COLUMNS = {
    "time_s": (),
    "desired_rad": (2,),
    "true_rad": (2,),
    "measured_rad": (2,),
    "strut_input_percent": (6,),
    "strut_displacement_m": (6,),
    "secondary": (4,),
    "secondary_estimated": (4,),
    "closure_residual_m": (),
}
"""Shape of one control tick of each signal."""

LARGEST = 1e6
"""In [s], [rad], [m] or [%]: what the machine does stays far below."""

_UNEVEN = 1e-6


class NoRunError(WrongInput):
    """A file of something else."""


def whole_run(name: str, arrays: Mapping[str, Array]) -> Trajectory:
    """The run that the arrays of a file are; further ones are passed over.

    Args:
        name: Of the file.
        arrays: By name.

    Raises:
        NoRunError: A signal is missing.
        WrongInput: A signal has another type or shape, or values that no run has; or time does not
            run forward in even steps.
    """
    if missing := [signal for signal in COLUMNS if signal not in arrays]:
        raise NoRunError(f"{name} is no run of the hexapod: it lacks {missing[0]}")
    ticks = arrays["time_s"].size
    if ticks < 2:
        raise WrongInput(f"{name} is not a whole run: it has fewer than two ticks")
    for signal, columns in COLUMNS.items():
        fault = _fault(arrays[signal], (ticks, *columns))
        if fault:
            raise WrongInput(f"{name} is not a whole run: {signal} {fault}")
    steps_s = np.diff(arrays["time_s"])
    if not (steps_s.min() > 0 and np.ptp(steps_s) <= _UNEVEN * steps_s.max()):
        raise WrongInput(f"{name} is not a whole run: time_s does not run forward in even steps")
    return Trajectory(**{signal: arrays[signal] for signal in COLUMNS})


def _fault(values: Array, shape: tuple[int, ...]) -> str | None:
    """What a signal has that a run has not."""
    if values.dtype != np.float64:
        return f"must be float64, got {values.dtype}"
    if values.shape != shape:
        return f"must have shape {shape}, got {values.shape}"
    if not np.isfinite(values).all():
        return "is not finite everywhere"
    if (largest := np.abs(values).max()) > LARGEST:
        return f"has values up to {largest:.3g}, expected at most {LARGEST:g}"
    return None
