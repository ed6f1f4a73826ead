"""Reader of runs from their data (.npz) and recordings (.rrd), which may be untrusted files."""

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
from fjh.recording.record import STATED_PROPERTY
from fjh.recording.view import PUBLISHED, Change, RunView, Stated, as_run_arrays, stated_of
from fjh.rig import Rig
from fjh.rig.bodies import body_name
from fjh.rig.hexapod.closed_form import hexapod
from fjh.rig.units import ROWS
from fjh.study.errors import WrongInput
from fjh.study.input_checks import LARGEST_FILE, check_file
from fjh.study.untrusted_files import read_arrays
from sim import MODELS, load_model
from sim.mjcf import model_sha256

LARGEST = 1e6
"""Largest valid value in [s], [rad], [m] or [%], far above those of a machine."""
_UNEVEN = 1e-6
_OF_ANY = ("time_s", "desired", "true", "qpos")
"""Names of arrays that identify a run of any robot; studies of the hexapod use other names."""
_TRUE = ("/task/true", f"/{entity_of(0)}task/true")
"""Entities of the true displacements, of a single run or of the first of several."""


class NoRunError(WrongInput):
    """Error that a data file does not contain a run."""


@dataclass(frozen=True)
class RecordedRun:
    """Run read from files, with its study and parameters.

    Without a recording, study and parameters are empty.
    """

    view: RunView
    study: str
    parameters: dict[str, Any]


def read_run(path: Path, machine: Path | None = None) -> RecordedRun:
    """Read a run from its `.npz` file and the recording of the same name.

    `machine` is the MJCF for drawing; None: the file that the recording names, or the file of
    `models/` with the recorded SHA-256. Runs of the hexapod's studies need no recording, which has
    the failures.

    Raises:
        NoRunError: The file is not a run.
        WrongInput: The file is missing or incomplete; the recording is missing, of another run or
            of an earlier version; or the machine file is missing or has changed.
    """
    arrays, recording = read_arrays(path), path.with_suffix(".rrd")
    is_published = set(PUBLISHED.values()) <= arrays.keys()
    if not is_published and (missing := [name for name in _OF_ANY if name not in arrays]):
        raise NoRunError(f"{path} is not a run of any robot: it has no {missing[0]}")
    parameters, study, content = dict[str, Any](), "", None
    if recording.is_file():
        parameters, results = groups_of(recording)
        study = str(results.get("study", ""))
        content = _json(recording, parameters.pop(STATED_PROPERTY, ""))
    elif not is_published:
        raise WrongInput(
            f"{path} cannot be read without {recording.name}, which describes its robot"
        )
    model = load_model(machine if content is None else _machine_of(path, content, machine))
    try:
        stated = _stated(content) if content else stated_of(Rig.hexapod(), machine_file=machine)
        _check_stated(stated, model)
    except (ValueError, LookupError, TypeError, AttributeError) as error:
        raise WrongInput(f"{path} and {recording.name} are not a run: {error}") from None
    try:
        _check_arrays(arrays, stated, model.nq)
    except ValueError as error:
        raise WrongInput(f"{path} is not a complete run: {error}") from None
    view = RunView(stated, as_run_arrays(arrays), model)
    if content is not None and not _is_of(recording, view):
        raise WrongInput(
            f"{recording} is not the recording of {path.name}: their displacements differ"
        )
    return RecordedRun(view, study, parameters)


def _json(recording: Path, text: str) -> dict[str, Any]:
    """Return the unchecked fields of :class:`.view.Stated` in a recording."""
    with suppress(ValueError):
        content = json.loads(text)
        if isinstance(content, dict) and content.keys() == {field.name for field in fields(Stated)}:
            return content
    raise WrongInput(f"{recording} is of another version of fjh and cannot be read: simulate again")


def _stated(content: dict[str, Any]) -> Stated:
    keys = ("incidents", "diagnoses")
    changes = {key: [Change(**entry) for entry in content[key]] for key in keys}
    return Stated(**{**content, **changes})


def _check_stated(stated: Stated, model: mujoco.MjModel) -> None:
    """Raise a ValueError or another exception if fields are invalid for this robot model."""
    if stated.hexapod:
        hexapod(model)  # raises for any other robot
    n, changes = len(stated.actuators), [*stated.incidents, *stated.diagnoses]
    texts = [stated.robot, stated.known, stated.status, *stated.actuators, *stated.rows]
    texts += [*stated.row_units, *stated.actuator_units, *stated.input_units]
    texts += [change.kind for change in changes]
    if not all(isinstance(text, str) for text in texts):
        raise ValueError("names, units and kinds must be text")
    sizes = [len(names) for names in (stated.actuator_units, stated.input_units, stated.bodies)]
    if sizes != [n] * 3 or np.array(stated.limits, dtype=float).shape != (2, n):
        raise ValueError(f"units, bodies and limits must be of {n} actuators")
    bodies, rows = {body_name(model, k) for k in range(model.nbody)}, set(range(len(ROWS)))
    if not {name for names in stated.bodies for name in names} <= bodies:
        raise ValueError("bodies must be those of the robot")
    if len(stated.rows) != len(rows) or not stated.major or not set(stated.major) <= rows:
        raise ValueError(f"major must be some of {len(rows)} rows")
    if len(stated.row_units) != len(stated.major):
        raise ValueError("row_units must be of the major rows")
    for change in changes:
        if change.actuator not in (*stated.actuators, None) or not 0.0 <= change.time_s < np.inf:
            raise ValueError(f"no actuator of the robot, or no time of a run: {change}")


def _check_arrays(arrays: Mapping[str, Array], stated: Stated, nq: int) -> None:
    """Raise a ValueError if arrays and fields are not those of one run."""
    n, m1, N = len(stated.actuators), len(stated.major), arrays["time_s"].size
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
            values = np.where(np.isnan(values), 0.0, values)  # sensor samples may be missing
        if not np.abs(values).max(initial=0.0) <= LARGEST:
            raise ValueError(f"values of {name} must be at most {LARGEST:g}")
    steps_s = np.diff(arrays["time_s"])
    if N < 2 or not (steps_s.min() > 0 and np.ptp(steps_s) <= _UNEVEN * steps_s.max()):
        raise ValueError("time_s must increase in equal steps, of two ticks at least")


def _is_of(recording: Path, run: RunView) -> bool:
    """Return whether the true displacements in a recording equal those of the run bit by bit."""
    reader, true = RrdReader(recording), run.arrays["true"]
    for entity in _TRUE:
        chunks = reader.stream().filter(content=entity, is_static=False).to_chunks()
        batches = [chunk.to_record_batch() for chunk in chunks]
        if batches:
            times = np.concatenate([batch.column(TIMELINE).cast("int64") for batch in batches])
            values = [batch.column("Scalars:scalars").flatten() for batch in batches]
            order = np.argsort(times)  # noqa: TID251 - whole numbers, all different
            recorded = np.concatenate(values).reshape(len(times), -1)[order]
            ticks = np.searchsorted(np.rint(1e9 * run.time_s), np.sort(times))
            return bool(ticks.max() < len(true)) and np.array_equal(recorded, 1e6 * true[ticks])
    return False


def _machine_of(path: Path, content: Mapping[str, Any], given: Path | None) -> Path:
    """Return the machine file of a run, checked by the SHA-256 in its recording."""
    name, sha256 = str(content["model_file"]), content["model_sha256"]
    if given is not None:
        if sha256 != model_sha256(check_file(given)):
            raise WrongInput(f"{path} is a run of another machine: give its file with --model FILE")
        return given
    candidates: Iterator[Path] = (Path(file) for file in ([name] if name else []))
    for file in (*candidates, *sorted(MODELS.glob("*.xml"))):
        is_one = file.is_file() and file.stat().st_size <= LARGEST_FILE
        if is_one and model_sha256(file) == sha256:
            return file
    raise WrongInput(
        f"{path} is a run of another machine, {name or 'none of models/'}, and its file is missing "
        "or has changed: give it with --model FILE"
    )
