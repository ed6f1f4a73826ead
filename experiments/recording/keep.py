"""A hexapod run on disk: its data (.npz, the record) and its recording (.rrd, the view)."""

import json
import zipfile
import zlib
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from rerun.chunk import RrdReader

from experiments.conduct import WrongInput
from experiments.files import write_arrays
from experiments.recording.file import About
from experiments.recording.marks import Mark
from experiments.recording.run import write_run
from experiments.recording.shown import Shown
from experiments.run import Trajectory
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


def read_run(path: Path) -> Kept:
    """A run, with what :func:`keep_run` wrote beside it.

    Raises:
        WrongInput: It is no such file, or not a whole one.
    """
    try:
        with np.load(path) as file:
            arrays = dict(file)
    except (OSError, ValueError, TypeError, EOFError, zipfile.BadZipFile, zlib.error):
        raise WrongInput(f"{path} is not a readable .npz file") from None
    signals = [field.name for field in fields(Trajectory)]
    if missing := [name for name in signals if name not in arrays]:
        raise WrongInput(f"{path} is no run of the hexapod: it lacks {missing[0]}")
    run = Trajectory(**{name: arrays[name] for name in signals})
    rows = {len(np.atleast_1d(values)) for values in asdict(run).values()}
    if len(rows) != 1 or rows.pop() < 2 or not all(map(_is_finite, asdict(run).values())):
        raise WrongInput(f"{path} is not a whole run: rows are missing or not finite")
    properties = _properties(path.with_suffix(".rrd"))
    marks = [Mark(**mark) for mark in json.loads(properties.pop("marks", "[]"))]
    return Kept(Shown(run, marks), properties.pop("experiment", ""), properties)


def _properties(recording: Path) -> dict[str, Any]:
    """Of the recording beside the data; none where there is no recording."""
    if not recording.is_file():
        return {}
    try:
        chunks = RrdReader(recording).stream().filter(content="/__properties/run").to_chunks()
    except Exception as error:  # the reader's own errors have no common class
        raise WrongInput(f"{recording} is not a readable recording: {error}") from None
    columns = {
        name: column[0]
        for chunk in chunks
        for name, column in chunk.to_record_batch().to_pydict().items()
        if not name.startswith("rerun.")
    }
    return {name: cell[0] if len(cell) == 1 else cell for name, cell in columns.items()}


def _is_finite(values: Array) -> bool:
    return values.dtype.kind == "f" and bool(np.isfinite(values).all())
