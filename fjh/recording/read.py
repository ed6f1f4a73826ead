"""A run read back from its data (.npz) and its recording (.rrd), which anybody may have written."""

import json
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from rerun.chunk import RrdReader

from fjh.recording import Array
from fjh.recording.file import TIMELINE
from fjh.recording.layout import entity_of
from fjh.recording.properties import groups_of
from fjh.recording.record import FLIGHT
from fjh.recording.view import PUBLISHED, Change, RunView, Stated, as_run_arrays, stated_of
from fjh.rig import Rig
from fjh.rig.bodies import body_name
from fjh.rig.hexapod.closed_form import hexapod
from fjh.rig.units import ROWS
from fjh.study.errors import WrongInput
from fjh.study.foreign import read_arrays
from fjh.study.spelling import LARGEST_FILE, check_file
from sim import MODELS, load_model
from sim.mjcf import model_sha256

LARGEST = 1e6
"""Largest value in [s], [rad], [m] or [%]: what a machine does stays far below."""
_UNEVEN = 1e-6
_OF_ANY = ("time_s", "desired", "true", "qpos")
"""Arrays by which a run is known that is none of the hexapod's studies."""
_TRUE = ("/task/true", f"/{entity_of(0)}task/true")
"""Entities of the true displacements of the only or first run of a recording."""


class NoRunError(WrongInput):
    """The file holds something else than a run."""


@dataclass(frozen=True)
class RecordedRun:
    """A run read back, the study by which it was recorded, and its parameters.

    Where there is no recording beside the data, the last two are empty.
    """

    view: RunView
    study: str
    parameters: dict[str, Any]


def read_run(path: Path, machine: Path | None = None) -> RecordedRun:
    """A run, with what its recording says of it; drawn with the machine file of this path.

    None is the file that the recording names, or that of `models/` with its SHA-256. A run of the
    hexapod's studies needs no recording; nothing is known then of failures.

    Raises:
        NoRunError: It holds something else.
        WrongInput: It is no such file, or not a whole one; the recording beside it is missing, not
            of it or of an earlier version; its machine file is another, or is nowhere.
    """
    arrays, recording = read_arrays(path), path.with_suffix(".rrd")
    is_published = set(PUBLISHED.values()) <= arrays.keys()
    if not is_published and (missing := [name for name in _OF_ANY if name not in arrays]):
        raise NoRunError(f"{path} is not a run of the hexapod or another robot: no {missing[0]}")
    parameters, study, found = dict[str, Any](), "", None
    if recording.is_file():
        parameters, results = groups_of(recording)
        study, found = str(results.get("study", "")), _json(recording, parameters.pop(FLIGHT, ""))
    elif not is_published:
        raise WrongInput(
            f"{path} cannot be read without {recording.name}, which says of what it is"
        )
    model = load_model(machine if found is None else _machine_of(path, found, machine))
    try:
        its = stated_of(Rig.hexapod(), machine_file=machine) if found is None else _stated(found)
        _check_stated(its, model)
    except (ValueError, LookupError, TypeError, AttributeError) as error:
        raise WrongInput(f"{path} and {recording.name} are not a run: {error}") from None
    try:
        _check_arrays(arrays, its, model.nq)
    except ValueError as error:
        raise WrongInput(f"{path} is not a complete run: {error}") from None
    view = RunView(its, as_run_arrays(arrays), model)
    if found is not None and not _is_of(recording, view):
        raise WrongInput(
            f"{recording} is not the recording of {path.name}: their displacements differ"
        )
    return RecordedRun(view, study, parameters)


def _json(recording: Path, text: str) -> dict[str, Any]:
    """The fields of :class:`.view.Stated` that a recording has, not yet checked."""
    with suppress(ValueError):
        found = json.loads(text)
        if isinstance(found, dict) and found.keys() == {each.name for each in fields(Stated)}:
            return found
    raise WrongInput(f"{recording} was recorded by an earlier version, and cannot be read back")


def _stated(found: dict[str, Any]) -> Stated:
    changes = {key: [Change(**each) for each in found[key]] for key in ("incidents", "diagnoses")}
    return Stated(**{**found, **changes})


def _check_stated(its: Stated, model: mujoco.MjModel) -> None:
    """Raise a ValueError or another error where no run of a robot of this model states so."""
    if its.hexapod:
        hexapod(model)  # raises for any other
    n, changes = len(its.actuators), [*its.incidents, *its.diagnoses]
    texts = [its.robot, its.known, its.status, *its.actuators, *its.rows, *its.row_units]
    texts += [*its.actuator_units, *its.input_units, *(each.kind for each in changes)]
    if not all(isinstance(text, str) for text in texts):
        raise ValueError("names, units and kinds must be text")
    sizes = [len(each) for each in (its.actuator_units, its.input_units, its.bodies)]
    if sizes != [n] * 3 or np.array(its.limits, dtype=float).shape != (2, n):
        raise ValueError(f"units, bodies and limits must be of {n} actuators")
    bodies, rows = {body_name(model, k) for k in range(model.nbody)}, set(range(len(ROWS)))
    if not {name for each in its.bodies for name in each} <= bodies:
        raise ValueError("bodies must be those of the robot")
    if len(its.rows) != len(rows) or not its.major or not set(its.major) <= rows:
        raise ValueError(f"major must be some of {len(rows)} rows")
    if len(its.row_units) != len(its.major):
        raise ValueError("row_units must be of the major rows")
    for each in changes:
        if each.actuator not in (*its.actuators, None) or not 0.0 <= each.time_s < np.inf:
            raise ValueError(f"no actuator of the robot, or no time of a run: {each}")


def _check_arrays(arrays: Mapping[str, Array], its: Stated, nq: int) -> None:
    """Raise a ValueError where these are not the arrays of such a run."""
    n, m1, N = len(its.actuators), len(its.major), arrays["time_s"].size
    widths = dict.fromkeys(("desired", "true", "measured"), m1)
    widths |= dict.fromkeys(("inputs", "displacement"), n)
    if PUBLISHED["true"] in arrays:
        widths = {PUBLISHED[name]: width for name, width in widths.items()}
        widths |= dict.fromkeys(("secondary", "secondary_estimated"), len(ROWS) - m1)
    else:
        widths |= {"task": len(ROWS), "qpos": nq}
    shapes = {name: (N, width) for name, width in widths.items()}
    for name, shape in {"time_s": (N,), **shapes, "closure_residual_m": (N,)}.items():
        if name not in arrays:
            raise ValueError(f"it has no {name}")
        values = arrays[name]
        if values.dtype != np.float64 or values.shape != shape:
            got = f"{values.dtype} of shape {values.shape}"
            raise ValueError(f"{name} must be float64 of shape {shape}, got {got}")
        if name.startswith("measured"):
            values = np.where(np.isnan(values), 0.0, values)  # samples of sensors may be missing
        if not np.abs(values).max(initial=0.0) <= LARGEST:
            raise ValueError(f"{name} must be at most {LARGEST:g} everywhere")
    steps_s = np.diff(arrays["time_s"])
    if N < 2 or not (steps_s.min() > 0 and np.ptp(steps_s) <= _UNEVEN * steps_s.max()):
        raise ValueError("time_s must increase in equal steps, of two ticks at least")


def _is_of(recording: Path, run: RunView) -> bool:
    """Whether the true displacements in a recording are the run's, to the bit."""
    reader, true = RrdReader(recording), run.arrays["true"]
    for entity in _TRUE:
        chunks = reader.stream().filter(content=entity, is_static=False).to_chunks()
        batches = [chunk.to_record_batch() for chunk in chunks]
        if batches:
            times = np.concatenate([each.column(TIMELINE).cast("int64") for each in batches])
            values = [each.column("Scalars:scalars").flatten() for each in batches]
            order = np.argsort(times)  # noqa: TID251 - whole numbers, all different
            shown = np.concatenate(values).reshape(len(times), -1)[order]
            ticks = np.searchsorted(np.rint(1e9 * run.time_s), np.sort(times))
            return bool(ticks.max() < len(true)) and np.array_equal(shown, 1e6 * true[ticks])
    return False


def _machine_of(path: Path, found: Mapping[str, Any], given: Path | None) -> Path:
    """The machine file of a run, by what its recording states."""
    named, sha256 = str(found["model_file"]), found["model_sha256"]
    if given is not None:
        if sha256 != model_sha256(check_file(given)):
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
