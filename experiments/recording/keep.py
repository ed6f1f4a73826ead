"""A hexapod run on disk, written and read back: its data (.npz) and its recording (.rrd)."""

import json
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from rerun.chunk import RrdReader

from experiments.recording.file import TIMELINE, RecordingInfo, at_most
from experiments.recording.marks import Mark
from experiments.recording.screens import RATE_HZ, write_run
from experiments.recording.shown import Shown, run_notes
from experiments.rig.hexapod.simulation import Trajectory
from experiments.study.files import write_arrays
from experiments.study.foreign import read_arrays
from experiments.study.study import WrongInput
from sim import Array

COLUMNS: dict[str, tuple[int, ...]] = {
    "time_s": (),
    **dict.fromkeys(("desired_rad", "true_rad", "measured_rad"), (2,)),
    **dict.fromkeys(("strut_input_percent", "strut_displacement_m"), (6,)),
    **dict.fromkeys(("secondary", "secondary_estimated"), (4,)),
    "closure_residual_m": (),
}
"""Shape of each signal of a run at one control tick."""

LARGEST = 1e6
"""In [s], [rad], [m] or [%]: what the machine does stays far below."""

_UNEVEN = 1e-6

_FORMER = {"strut": "actuator"}
"""Attributes of marks by the names that they have in earlier recordings."""


class NoRunError(WrongInput):
    """The file holds something else than a run."""


@dataclass(frozen=True)
class RecordedRun:
    """A run read back, with its marks; the experiment and its parameters are in the recording.

    Where there is no recording beside the data, they are empty.
    """

    shown: Shown
    experiment: str
    properties: dict[str, Any]


def record_run(
    folder: Path,
    name: str,
    identity: str,
    model: mujoco.MjModel,
    shown: Shown,
    *,
    said: Sequence[str],
    beside: Mapping[str, tuple[float | None, float | None]],
    properties: dict[str, Any],
    further: dict[str, Array] | None = None,
) -> None:
    """Write `name.npz`, every control tick, and `name.rrd`, with notes beside the views.

    The identity, experiment, run and seed, distinguishes the recording. Its notes have what was
    `said` of the run, a sentence or a list item each, the RMS of (alpha, beta) [urad] to compare
    with, by where they come from, and all parameters. `further` arrays go beside the run's own.
    """
    notes = run_notes(name, [*said, ""], shown.run, beside, properties)
    for_reading = {
        "experiment": identity.partition("-")[0],
        "marks": json.dumps([asdict(mark) for mark in shown.marks]),
    }
    write_arrays(folder / f"{name}.npz", asdict(shown.run) | (further or {}))
    about = RecordingInfo(identity, name, notes, properties | for_reading)
    write_run(folder / f"{name}.rrd", about, model, shown)


def read_run(path: Path) -> RecordedRun:
    """A run, with what :func:`record_run` wrote beside it.

    Raises:
        NoRunError: It holds something else.
        WrongInput: It is no such file, or not a whole one, or the recording beside it is not of it.
    """
    arrays = read_arrays(path)
    run, recording = whole_run(str(path), arrays), path.with_suffix(".rrd")
    if not recording.is_file():
        return RecordedRun(Shown(run), "", {})
    try:
        properties, true_urad = _read_recording(recording)
    except Exception as error:  # the reader's own errors have no common class
        reason = " ".join(str(error).split())
        raise WrongInput(f"{recording} is not a readable recording: {reason}") from None
    if not np.array_equal(true_urad, 1e6 * run.true_rad[at_most(RATE_HZ, run.time_s)]):
        raise WrongInput(f"{recording} is not the recording of {path.name}: their angles differ")
    try:
        marks = marks_from(properties.pop("marks", "[]"), end_s=float(run.time_s[-1]))
    except ValueError as error:
        raise WrongInput(f"{recording} has invalid marks: {error}") from None
    return RecordedRun(Shown(run, marks), str(properties.pop("experiment", "")), properties)


def _read_recording(path: Path) -> tuple[dict[str, Any], Array]:
    """Properties of a run's recording, and the true angles that it shows [urad], (T, 2)."""
    with warnings.catch_warnings(action="error"):  # of a file that ends too early it only warns
        recording = RrdReader(path)
        properties = recording.stream().filter(content="/__properties/run").to_chunks()
        angles = recording.stream().filter(content="/pointing/true", is_static=False).to_chunks()
    cells = {
        name: column[0]
        for chunk in properties
        for name, column in chunk.to_record_batch().to_pydict().items()
        if not name.startswith("rerun.")
    }
    batches = [chunk.to_record_batch() for chunk in angles]
    times = np.concatenate([batch.column(TIMELINE).cast("int64") for batch in batches])
    values = [batch.column("Scalars:scalars").flatten() for batch in batches]
    shown = np.concatenate(values).reshape(len(times), 2)
    plain = {name: cell[0] if len(cell) == 1 else cell for name, cell in cells.items()}
    return plain, shown[np.argsort(times)]


def marks_from(text: str, end_s: float) -> list[Mark]:
    """Marks of a run that lasts until `end_s`, from JSON: a list of their attributes.

    Raises:
        ValueError: It is something else; the message states what came.
    """
    try:
        entries: list[dict[str, Any]] = json.loads(text)
        named = [{_FORMER.get(key, key): value for key, value in each.items()} for each in entries]
        marks = [Mark(**each) for each in named]
        valid = all(_is_valid(mark, end_s) for mark in marks)
    except (ValueError, TypeError, AttributeError):
        valid, marks = False, []
    if not valid:
        raise ValueError(
            f"expected a list of failures of struts 0 to 5 within {end_s:g} s, got {text!s:.80}"
        )
    return marks


def _is_valid(mark: Mark, end_s: float) -> bool:
    return (
        isinstance(mark.actuator, int)
        and mark.actuator in range(6)
        and 0 <= mark.failed_s <= end_s
        and mark.failed_s <= mark.diagnosed_s
        and (mark.diagnosed_s <= end_s or not mark.is_found)
        and isinstance(mark.failure, str)
        and isinstance(mark.diagnosis, str)
    )


def whole_run(name: str, arrays: Mapping[str, Array]) -> Trajectory:
    """The run in the arrays of a file of this name; further arrays are ignored.

    Raises:
        NoRunError: A signal is missing.
        WrongInput: A signal, or the times, are not those of a run.
    """
    if missing := [signal for signal in COLUMNS if signal not in arrays]:
        raise NoRunError(f"{name} is not a run of the hexapod: {missing[0]} is missing")
    ticks = arrays["time_s"].size
    if ticks < 2:
        raise WrongInput(f"{name} is not a complete run: it has fewer than two ticks")
    for signal, columns in COLUMNS.items():
        if fault := _fault(arrays[signal], (ticks, *columns)):
            raise WrongInput(f"{name} is not a complete run: {signal} {fault}")
    steps_s = np.diff(arrays["time_s"])
    if not (steps_s.min() > 0 and np.ptp(steps_s) <= _UNEVEN * steps_s.max()):
        raise WrongInput(f"{name} is not a complete run: time_s does not increase in equal steps")
    return Trajectory(**{signal: arrays[signal] for signal in COLUMNS})


def _fault(values: Array, shape: tuple[int, ...]) -> str | None:
    """What no signal of a run may be, in words; None for a valid one."""
    if values.dtype != np.float64:
        return f"must be float64, got {values.dtype}"
    if values.shape != shape:
        return f"must have shape {shape}, got {values.shape}"
    if not np.isfinite(values).all():
        return "is not finite everywhere"
    if (largest := np.abs(values).max()) > LARGEST:
        return f"has values up to {largest:.3g}, expected at most {LARGEST:g}"
    return None
