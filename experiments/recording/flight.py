"""A flight of any robot, kept: every tick as arrays, and the robot in 3D beside its signals."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import argument_checks as check
from experiments.recording.file import RecordingInfo
from experiments.recording.hexapod import FULL
from experiments.recording.keep import flight_properties
from experiments.recording.notes import constants
from experiments.recording.properties import results_of
from experiments.recording.robot import of_robot
from experiments.recording.screens import write_flights
from experiments.recording.shown import Shown
from experiments.rig import Rig, Run
from experiments.study.files import published, usable_file, write_arrays
from experiments.study.provenance import version_properties, versions
from sim import model_sha256


def record(path: str | Path, rig: Rig, run: Run) -> None:
    """Write a flight as a Rerun recording, and all its ticks beside it.

    Needs the extra `testbed`. The recording shows the robot in 3D, its failed actuators marked,
    its path, errors, inputs and what the diagnosis made of it; `rerun PATH` opens it. The `.npz` of
    the same name has :attr:`Run.arrays`. Both files appear whole or not at all.

    Args:
        path: Of the recording, ending in `.rrd`.
        rig: The robot.
        run: What :meth:`Rig.fly` gave.

    Raises:
        OutputError: Another ending, or the files cannot be written; the message says why.
        TypeError, ValueError: No path, rig or run; or a run of another robot.
    """
    file = Path(check.instance("path", path, str, Path))
    nq = check.instance("rig", rig, Rig).model.nq
    if check.instance("run", run, Run).qpos.shape[1] != nq:
        raise ValueError(f"run must be of this rig, of {nq} joint positions, got {run}")
    folder = usable_file(file, ".rrd", option="path")
    stated = stated_of(rig, run)
    shown = of_robot(run.arrays, stated, rig.model)
    properties = {"control_period_s": rig.period_s} | version_properties({"versions": versions()})
    said = [run.status, "", *constants(properties)]
    about = info_of(rig, run, file.stem, said, properties, results_of(shown, "record"))
    arrays = file.with_suffix(".npz").name
    with published(folder, arrays) as staging:
        write_arrays(staging / arrays, run.arrays)
        write_flights(staging / file.name, about, {rig.title: shown})


def info_of(
    rig: Rig,
    run: Run,
    identity: str,
    said: Sequence[str],
    properties: Mapping[str, Any],
    results: dict[str, Any],
) -> RecordingInfo:
    """What a recording of a flight says of itself: lines of Markdown, constants, results."""
    text = "\n".join([f"# {rig.title}", "", *said])
    own = {**properties, **flight_properties(stated_of(rig, run))}
    return RecordingInfo(identity, rig.title, text, own, results)


def of_flight(rig: Rig, run: Run) -> Shown:
    """A flight as it is shown, and as it would be read back."""
    return of_robot(run.arrays, stated_of(rig, run), rig.model)


def stated_of(rig: Rig, run: Run) -> dict[str, Any]:
    """What is needed beside the arrays of a flight to show it, as JSON has it.

    `track.json` has entries of the same names.
    """
    limits, is_percent = rig.limits, rig.file is None  # of the hexapod's amplifiers
    if is_percent:
        limits = -FULL, FULL
    elif limits is None:
        limits = tuple(np.full(len(rig.actuators), bound) for bound in (-np.inf, np.inf))
    return {
        "robot": rig.title,
        "model_file": "" if rig.file is None else str(rig.file),
        "model_sha256": model_sha256(rig.file),
        "actuators": list(rig.actuators),
        "actuator_units": list(rig.units),
        "input_units": ["%"] * len(rig.units) if is_percent else list(rig.units),
        "limits": [[x if np.isfinite(x) else None for x in each.tolist()] for each in limits],
        "bodies": list(rig.bodies),
        "major": list(rig.major),
        "units": list(rig.row_units),
        "failures": [_happened(rig, each.kind, each.number, each.time_s) for each in run.failures],
        "diagnoses": [
            {"actuator": each.actuator, "kind": each.kind, "time_s": each.time_s}
            | {"withdrawn_s": each.withdrawn_s}
            for each in run.diagnoses
        ],
        "events": [_happened(rig, each.name, each.actuator, each.time_s) for each in run.events],
        "status": run.status,
    }


def _happened(rig: Rig, kind: str, actuator: Any, time_s: float) -> dict[str, Any]:
    name = None if actuator is None else rig.actuators[int(actuator)]
    return {"actuator": name, "kind": kind, "name": kind, "time_s": float(time_s)}
