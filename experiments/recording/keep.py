"""A run on disk, written and read back: its data (.npz) and its recording (.rrd)."""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from rerun.chunk import RrdReader

from experiments.recording.file import TIMELINE, RecordingInfo
from experiments.recording.hexapod import of_hexapod
from experiments.recording.marks import Mark, marks_from, marks_text
from experiments.recording.notes import run_notes
from experiments.recording.properties import groups_of, results_of
from experiments.recording.robot import of_robot
from experiments.recording.screens import entity_of, write_flights
from experiments.recording.shown import Shown
from experiments.rig.hexapod.columns import hexapod_arrays
from experiments.rig.run import Run
from experiments.study.files import write_arrays
from experiments.study.foreign import read_arrays, read_json
from experiments.study.results import Check
from experiments.study.spelling import LARGEST_FILE
from experiments.study.study import WrongInput
from sim import MODELS, Array, hexapod, load_model, model_sha256

COLUMNS: dict[str, tuple[int, ...]] = {
    "time_s": (),
    **dict.fromkeys(("desired_rad", "true_rad", "measured_rad"), (2,)),
    **dict.fromkeys(("strut_input_percent", "strut_displacement_m"), (6,)),
    **dict.fromkeys(("secondary", "secondary_estimated"), (4,)),
    "closure_residual_m": (),
}
"""Shape of each signal of a run of the hexapod at one control tick."""
_OF_ANY = ("time_s", "desired", "true", "qpos")
"""Signals by which a run of another robot is known."""

LARGEST = 1e6
"""In [s], [rad], [m] or [%]: what the machine does stays far below."""

_UNEVEN = 1e-6
_TRUE = ("/task/true", f"/{entity_of(0)}task/true", "/pointing/true")
"""Where a recording has the true displacements; the last is of earlier ones."""
_READING = ("marks", "flight", "experiment")
"""Properties for reading a run back, which are no parameters."""


class NoRunError(WrongInput):
    """The file holds something else than a run."""


@dataclass(frozen=True)
class RecordedRun:
    """A run read back; the study and its parameters are in the recording.

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
    run: Run,
    marks: Sequence[Mark],
    *,
    said: Sequence[str],
    beside: Mapping[str, tuple[float | None, float | None]],
    properties: dict[str, Any],
    further: dict[str, Array] | None = None,
    predicted_rad: Sequence[float] | None = None,
    checks: Sequence[Check] = (),
    verdict: str = "",
) -> None:
    """Write `name.npz`, every control tick of a run of the hexapod, and `name.rrd`.

    The identity, experiment, run and seed, distinguishes the recording. Its notes have what was
    `said` of the run, a sentence or a list item each, the RMS of (alpha, beta) [urad] to compare
    with, by where they come from, and all parameters. `further` arrays go beside the run's own. The
    rest is of :func:`.properties.results_of`; the prediction is of a whole run, and left out where
    something fails on the way.
    """
    arrays = hexapod_arrays(run)
    shown = of_hexapod(arrays, model, marks)
    study, whole = identity.partition("-")[0], shown.first_tick in (0, len(run.time_s))
    predicted = predicted_rad if whole else None
    results = results_of(
        shown,
        study,
        checks=checks,
        predicted_before=predicted,
        predicted_after=predicted,
        verdict=verdict,
    )
    notes = run_notes(name, [*said, ""], shown, beside, properties)
    for_reading = {"marks": marks_text(marks)}
    write_arrays(folder / f"{name}.npz", arrays | (further or {}))
    about = RecordingInfo(identity, name, notes, properties | for_reading, results)
    write_flights(folder / f"{name}.rrd", about, {name: shown})


def flight_properties(stated: Mapping[str, Any]) -> dict[str, Any]:
    """What is stated of a flight of any robot, as properties for reading it back."""
    plain = {key: stated[key] for key in ("model_file", "model_sha256")}
    return plain | {"flight": json.dumps(stated, allow_nan=False)}


def read_run(path: Path, machine: Path | None = None) -> RecordedRun:
    """A run, with what its recording says of it; drawn with the machine file of this path.

    None is the file that the recording names, or that of `models/` with its SHA-256.

    Raises:
        NoRunError: It holds something else.
        WrongInput: It is no such file, or not a whole one; the recording beside it is not of it;
            its machine file is another, or is nowhere.
    """
    arrays, recording = read_arrays(path), path.with_suffix(".rrd")
    is_hexapod = all(name in arrays for name in COLUMNS)
    if not is_hexapod and (missing := [name for name in _OF_ANY if name not in arrays]):
        raise NoRunError(f"{path} is not a run of the hexapod or another robot: no {missing[0]}")
    run = whole_run(str(path), arrays) if is_hexapod else None
    properties, results = dict[str, Any](), dict[str, Any]()
    if recording.is_file():
        properties, results = groups_of(recording)
        true, time_s = (arrays["true_rad" if is_hexapod else "true"], arrays["time_s"])
        if not _is_of(recording, time_s, true):
            raise WrongInput(
                f"{recording} is not the recording of {path.name}: their displacements differ"
            )
    if run is not None:
        shown = _hexapod(path, run, properties, machine)
    else:
        shown = _robot(path, arrays, properties, machine)
    experiment = str(results.get("study", properties.get("experiment", "")))
    kept = {name: value for name, value in properties.items() if name not in _READING}
    return RecordedRun(shown, experiment, kept)


def _is_of(recording: Path, time_s: Array, true: Array) -> bool:
    """Whether the true displacements in a recording are the run's, to the bit."""
    reader = RrdReader(recording)
    for entity in _TRUE:
        chunks = reader.stream().filter(content=entity, is_static=False).to_chunks()
        batches = [chunk.to_record_batch() for chunk in chunks]
        if batches:
            times = np.concatenate([each.column(TIMELINE).cast("int64") for each in batches])
            values = [each.column("Scalars:scalars").flatten() for each in batches]
            shown = np.concatenate(values).reshape(len(times), -1)[np.argsort(times)]
            ticks = np.searchsorted(np.rint(1e9 * time_s), np.sort(times))
            return bool(ticks.max() < len(true)) and np.array_equal(shown, 1e6 * true[ticks])
    return False


def _hexapod(
    path: Path, run: Mapping[str, Array], properties: Mapping[str, Any], machine: Path | None
) -> Shown:
    try:
        marks = marks_from(properties.get("marks", "[]"), end_s=float(run["time_s"][-1]))
    except ValueError as error:
        raise WrongInput(f"{path.with_suffix('.rrd')} has invalid marks: {error}") from None
    model = load_model(_machine_of(path, properties, machine))
    hexapod(model)  # raises for any other
    return of_hexapod(run, model, marks)


def _robot(
    path: Path, arrays: Mapping[str, Array], properties: Mapping[str, Any], machine: Path | None
) -> Shown:
    """From what the recording states, or else `track.json`."""
    source = path.with_suffix(".rrd") if "flight" in properties else path.with_name("track.json")
    try:
        stated = json.loads(properties["flight"]) if "flight" in properties else read_json(source)
        model = load_model(_machine_of(path, stated, machine))
        return of_robot(arrays, stated, model)
    except (ValueError, LookupError, TypeError, AttributeError) as error:
        if isinstance(error, WrongInput):
            raise
        raise WrongInput(f"{path} and {source.name} are not a run: {error}") from None


def _machine_of(path: Path, stated: Mapping[str, Any], given: Path | None) -> Path | None:
    """The machine file of a run; None is that of the hexapod."""
    sha256, named = stated.get("model_sha256"), str(stated.get("model_file", ""))
    if given is not None or sha256 is None:
        if sha256 not in (None, model_sha256(given)):
            raise WrongInput(f"{path} is a run of another machine; --model FILE draws that")
        return given
    candidates: Iterator[Path] = (Path(each) for each in ([named] if named else []))
    for file in (*candidates, *sorted(MODELS.glob("*.xml"))):
        is_one = file.is_file() and file.stat().st_size <= LARGEST_FILE
        if is_one and model_sha256(file) == sha256:
            return file
    raise WrongInput(
        f"{path} is a run of another machine, {named or 'which is none of models/'}, and the file "
        "is not there as it was; --model FILE draws it"
    )


def whole_run(name: str, arrays: Mapping[str, Array]) -> dict[str, Array]:
    """The run of the hexapod in the arrays of a file of this name; others are ignored.

    Raises:
        WrongInput: A signal, or the times, are not those of a run.
    """
    ticks = arrays["time_s"].size
    if ticks < 2:
        raise WrongInput(f"{name} is not a complete run: it has fewer than two ticks")
    for signal, columns in COLUMNS.items():
        if fault := _fault(arrays[signal], (ticks, *columns)):
            raise WrongInput(f"{name} is not a complete run: {signal} {fault}")
    steps_s = np.diff(arrays["time_s"])
    if not (steps_s.min() > 0 and np.ptp(steps_s) <= _UNEVEN * steps_s.max()):
        raise WrongInput(f"{name} is not a complete run: time_s does not increase in equal steps")
    return {signal: arrays[signal] for signal in COLUMNS}


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
