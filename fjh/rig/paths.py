"""Paths of the major task: displacements from the start in each row."""

from pathlib import Path

import numpy as np

import argument_checks as check
from fjh.rig.hexapod.trajectory import spiral
from fjh.study.errors import WrongInput
from fjh.study.input_checks import nearest
from fjh.study.untrusted_files import read_arrays
from sim import Array

PATHS = ("spiral", "circle", "steps")
"""Names of the built-in paths."""

_SOFT_START_S = 0.5


def path_of(
    name: str, rows: int, size: float, time_s: Array, turn_s: float, period_s: float
) -> Array:
    """Return desired major displacements at each tick, shape (N, rows), in [rad] or [m].

    A spiral or circle uses the first two rows (a single row moves as a sine), and other rows stay
    at zero. A circle starts at rest at zero; steps go out and back along one row after the other.

    Args:
        name: One of `PATHS`, or FILE.npz with `time_s` and `desired`.
        rows: Number of major rows.
        size: Radius or step, [rad] or [m].
        time_s: Times of the ticks, (N,) [s].
        turn_s: Time of one turn, or of four steps [s].
        period_s: Control period [s].

    Raises:
        WrongInput: There is no such path, or the file has no valid one.
    """
    path = np.zeros((len(time_s), rows))
    if name == "spiral":
        duration_s = float(time_s[-1] + period_s)
        plane = spiral(time_s, size, duration_s / turn_s, duration_s)
    elif name == "circle":
        # The phase starts at rest, so that the velocity does not jump at the start.
        ramp = np.minimum(time_s, _SOFT_START_S)
        phase = time_s - ramp + ramp**2 / (2 * _SOFT_START_S)
        angle = 2 * np.pi * phase / turn_s
        plane = size * np.column_stack([np.sin(angle), 1 - np.cos(angle)])
    elif name == "steps":
        step = (4 * time_s / turn_s).astype(int) % (2 * rows)
        at = np.flatnonzero(step % 2 == 1)
        path[at, step[at] // 2] = size
        return path
    else:
        return _from_file(Path(name), rows, time_s)
    path[:, : min(rows, 2)] = plane[:, :rows]
    return path


def _from_file(file: Path, rows: int, time_s: Array) -> Array:
    """Interpolate a path from `time_s` (K,) and `desired` (K, rows) of an .npz file linearly."""
    if file.suffix != ".npz":
        near = nearest(str(file), PATHS)
        raise WrongInput(f"path must be {', '.join(PATHS)} or FILE.npz, got {file!s:.80}{near}")
    arrays = read_arrays(file)
    try:
        times = check.array("time_s", arrays["time_s"])
        desired = check.array("desired", arrays["desired"])
    except (KeyError, ValueError, TypeError) as error:
        raise WrongInput(f"path {file} holds no path: {error}") from None
    fits = times.ndim == 1 and len(times) > 0 and desired.shape == (len(times), rows)
    if not fits or (np.diff(times) <= 0).any():
        raise WrongInput(
            f"path {file} must have ascending time_s (N,) and desired (N, {rows}), got shapes "
            f"{times.shape} and {desired.shape}"
        )
    return np.column_stack([np.interp(time_s, times, column) for column in desired.T])
