"""A hexapod run on disk: its data (.npz, the record) and its recording (.rrd, the view)."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from rerun.chunk import RrdReader

from experiments.hexapod.recording.notes import run_notes
from experiments.hexapod.recording.run import RATE_HZ, write_run
from experiments.hexapod.recording.shown import Shown
from experiments.output.files import write_arrays
from experiments.output.recording.file import TIMELINE, About, at_most
from experiments.output.recording.marks import marks_from
from experiments.output.recording.whole import whole_run
from experiments.output.study import WrongInput
from sim import Array


@dataclass(frozen=True)
class Kept:
    """A run read back from its data.

    Attributes:
        shown: The run, with its marks.
        experiment: That flew it; empty when there is no recording beside the data.
        properties: All its parameters; none when there is none.
    """

    shown: Shown
    experiment: str
    properties: dict[str, Any]


def keep_run(
    folder: Path,
    name: str,
    about: About,
    model: mujoco.MjModel,
    shown: Shown,
    further: dict[str, Array] | None = None,
) -> None:
    """Write `name.npz`, every control tick, and `name.rrd`.

    Args:
        folder: Where.
        name: Of both files, without ending.
        about: What the recording says of itself.
        model: The machine that is drawn.
        shown: The run.
        further: Arrays beside the run's own.
    """
    told = {
        "experiment": about.recording_id.partition("-")[0],
        "marks": json.dumps([asdict(mark) for mark in shown.marks]),
    }
    write_arrays(folder / f"{name}.npz", asdict(shown.run) | (further or {}))
    about = replace(about, properties=about.properties | told)
    write_run(folder / f"{name}.rrd", about, model, shown)


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
    """Write a run's data and its recording, with notes beside the views.

    Args:
        folder: Where.
        name: Of both files, without ending, and of the recording.
        identity: What tells the recording from others: experiment, run and seed.
        model: The machine that is drawn.
        shown: The run.
        said: What was done, a sentence or a list item each.
        beside: RMS of (alpha, beta) [urad] to compare with, by where they come from.
        properties: All parameters.
        further: Arrays beside the run's own.
    """
    notes = run_notes(name.replace("_", " "), [*said, ""], shown.run, beside, properties)
    keep_run(folder, name, About(identity, name, notes, properties), model, shown, further)


def read_run(path: Path) -> Kept:
    """A run, with what :func:`keep_run` wrote beside it.

    Raises:
        NoRunError: It holds something else.
        WrongInput: It is no such file, or not a whole one, or the recording beside it is not of it.
    """
    try:
        with np.load(path) as file:
            arrays = dict(file)
    except Exception:  # numpy and zipfile raise a dozen kinds, MemoryError among them
        raise WrongInput(f"{path} is not a readable .npz file") from None
    run, recording = whole_run(str(path), arrays), path.with_suffix(".rrd")
    if not recording.is_file():
        return Kept(Shown(run), "", {})
    try:
        properties, true_urad = _read_recording(recording)
    except Exception as error:  # the reader's own errors have no common class
        reason = " ".join(str(error).split())
        raise WrongInput(f"{recording} is not a readable recording: {reason}") from None
    if not np.array_equal(true_urad, 1e6 * run.true_rad[at_most(RATE_HZ, run.time_s)]):
        raise WrongInput(f"{recording} is not the recording of {path.name}: they hold other angles")
    try:
        marks = marks_from(properties.pop("marks", "[]"), end_s=float(run.time_s[-1]))
    except ValueError as error:
        raise WrongInput(f"{recording} has marks that are none: {error}") from None
    return Kept(Shown(run, marks), str(properties.pop("experiment", "")), properties)


def _read_recording(path: Path) -> tuple[dict[str, Any], Array]:
    """Properties of a run's recording, and the true angles that it shows [urad], (T, 2)."""
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
