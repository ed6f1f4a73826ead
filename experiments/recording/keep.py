"""A hexapod run on disk: its data (.npz, the record) and its recording (.rrd, the view)."""

import json
import zipfile
import zlib
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

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
        experiment: That flew it; empty when the file does not say.
        properties: All its parameters; none when the file does not say.
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
    said = {
        "experiment": np.array(about.recording_id.partition("-")[0]),
        "properties": np.array(json.dumps(about.properties)),
    }
    arrays = asdict(shown.run) | (further or {}) | _mark_arrays(shown) | said
    write_arrays(folder / f"{name}.npz", arrays)
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
    names = [f"mark_{field.name}" for field in fields(Mark)]
    columns = [arrays[name].tolist() for name in names if name in arrays]
    return Kept(
        Shown(run, [Mark(*values) for values in zip(*columns, strict=True)]),
        str(arrays.get("experiment", "")),
        json.loads(str(arrays.get("properties", "{}"))),
    )


def _is_finite(values: Array) -> bool:
    return values.dtype.kind == "f" and bool(np.isfinite(values).all())


def _mark_arrays(shown: Shown) -> dict[str, Array]:
    """Marks as arrays, one entry each."""
    return {
        f"mark_{field.name}": np.array([getattr(mark, field.name) for mark in shown.marks])
        for field in fields(Mark)
    }
