"""A flight of any robot, kept: every tick as arrays, and the robot in 3D beside its signals."""

from pathlib import Path
from typing import Any

import numpy as np

from experiments.recording.file import RecordingInfo, at_most
from experiments.recording.marks import Mark
from experiments.recording.mechanism import Driven, write_mechanism
from experiments.recording.shown import constants
from experiments.recording.views import Plot, Task
from experiments.rig import Rig, Run
from experiments.rig.run import named_since
from experiments.rig.units import ROWS
from experiments.study.files import published, usable_file, write_arrays
from experiments.study.provenance import version_properties, versions

_SIGNALS_HZ = 200


def record(path: str | Path, rig: Rig, run: Run) -> None:
    """Write a flight as a Rerun recording, and all its ticks beside it.

    Needs the extra `testbed`. The recording shows the robot in 3D, its failed actuators marked,
    its path, errors, actuators, limits and closures; `rerun PATH` opens it. The `.npz` of the same
    name has :attr:`Run.arrays`. Both files appear whole or not at all.

    Args:
        path: Of the recording, ending in `.rrd`.
        rig: The robot.
        run: What :meth:`Rig.fly` gave.

    Raises:
        OutputError: Another ending, or the files cannot be written; the message says why.
    """
    file = Path(path)
    folder = usable_file(file, ".rrd", option="path")
    error = np.sqrt(np.mean((run.desired - run.true) ** 2, axis=0))
    rms = {
        f"rms_error_{ROWS[row].replace(' ', '_')}_{unit}": float(value)
        for row, unit, value in zip(rig.major, rig.row_units, error, strict=True)
    }
    properties = rms | {"control_period_s": rig.period_s}
    properties |= version_properties({"versions": versions()})
    said = [f"# {rig.title}", "", run.status, "", *constants(properties)]
    about = RecordingInfo(file.stem, rig.title, "\n".join(said), properties)
    arrays = file.with_suffix(".npz").name
    with published(folder, arrays) as staging:
        write_arrays(staging / arrays, run.arrays)
        write_mechanism(staging / file.name, about, rig.model, {rig.title: driven(rig, run)})


def driven(rig: Rig, run: Run) -> Driven:
    """A flight as a recording shows it: the robot, its marks, its path and its signals."""
    every = at_most(_SIGNALS_HZ, run.time_s)
    time_s, named = run.time_s[every], zip(rig.major, rig.row_units, strict=True)
    errors = [f"{ROWS[row]} off [u{unit}]" for row, unit in named]
    error = 1e6 * (run.desired - run.true)[every]
    units = ", ".join(dict.fromkeys(rig.units))
    title, displacement = f"Actuators from the start [{units}]", run.displacement[every]
    plots = [
        Plot("error", "Desired - true", errors, time_s, error),
        Plot("actuators", title, list(rig.actuators), time_s, displacement),
        *_limits(rig, run, every),
        *_closure(run, every),
    ]
    task, marks = _task(rig, run), _marks(rig, run)
    return Driven(run.time_s, run.qpos, plots, task, nominal=run.qpos[0], marks=marks)


def _limits(rig: Rig, run: Run, every: slice) -> list[Plot]:
    """Where each actuator that is limited on both sides is in its range."""
    if rig.limits is None:
        return []
    lower, upper = rig.limits
    limited = np.flatnonzero(np.isfinite(upper - lower) & (upper > lower))
    if not limited.size:
        return []
    span = (upper - lower)[limited]
    part = 100 * (run.displacement[every][:, limited] - lower[limited]) / span
    names = [f"{rig.actuators[k]} [%]" for k in limited]
    return [Plot("limits", "Position in its range [%]", names, run.time_s[every], part)]


def _closure(run: Run, every: slice) -> list[Plot]:
    """The largest gap of a closed loop; nothing where there are none."""
    gap_um = 1e6 * run.closure_m[every, None]
    if not gap_um.any():
        return []
    names = ["largest gap [um]"]
    return [Plot("closure", "Closure residual [um]", names, run.time_s[every], gap_um)]


def _task(rig: Rig, run: Run) -> Task | None:
    """Desired and reached path in the plane of the first two rows; None of a single row."""
    if len(rig.major) < 2:
        return None
    names = ROWS[rig.major[0]], ROWS[rig.major[1]]
    unit = f"u{rig.row_units[0]}"
    return Task(names, unit, 1e6 * run.desired[:, :2], 1e6 * run.true[:, :2])


def _marks(rig: Rig, run: Run) -> tuple[tuple[str, Mark], ...]:
    """Where actuators fail, by the body that they move, and what was made of it."""
    marks = []
    for failure in run.failures:
        body = rig.bodies[failure.number]
        if body is None:
            continue
        label, diagnosis = f"{rig.actuators[failure.number]} {failure.kind}", dict[str, Any]()
        for found in named_since(rig, run, failure)[:1]:
            said = f"{label}, named {found.kind}"
            diagnosis = {"diagnosed_s": found.time_s, "diagnosis": said}
        marks.append((body, Mark(failure.number, failure.time_s, label, **diagnosis)))
    return tuple(marks)
