"""Writer of a run of any robot: arrays of all ticks, and a recording in 3D with all signals."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

import argument_checks as check
from fjh.recording import Array
from fjh.recording.file import RecordingInfo
from fjh.recording.layout import write_scenes
from fjh.recording.properties import checked, constants
from fjh.recording.scene import scenes_of
from fjh.recording.view import RunView, as_run_arrays, stated_of
from fjh.rig import Rig, Run
from fjh.study.files import published, usable_file, write_arrays
from fjh.study.provenance import version_properties, versions
from fjh.study.result import Check

STATED_PROPERTY = "flight"
"""Name of the property of a recording with the JSON of :class:`.view.Stated`, for the reader."""


@dataclass(frozen=True)
class About:
    """Information from a study about a run, for the run's recording.

    Attributes:
        study: Name of the study.
        identity: Unique name of the recording in the viewer, such as study, name and seed.
        title: Title of the recording; empty: the robot's name.
        notes: Lines of Markdown on the conditions of the run and its results.
        parameters: Seed, versions, every constant; units in the names.
        compared: Reference RMS errors of the major rows [urad], [um], by their source.
        predicted: RMS errors of the major rows [rad], [m] by a linear model, before and after the
            first incident; None without a prediction.
        checks: Checks of the study.
        summary: Sentence on the result; empty: errors and the controller's status.
    """

    study: str
    identity: str
    title: str = ""
    notes: Sequence[str] = ()
    parameters: Mapping[str, Any] = field(default_factory=dict)
    compared: Mapping[str, Sequence[float | None]] = field(default_factory=dict)
    predicted: tuple[Any, Any] = (None, None)
    checks: Sequence[Check] = ()
    summary: str = ""


def record(path: str | Path, rig: Rig, run: Run) -> None:
    """Write a run as a Rerun recording (`.rrd`), and the arrays of all its ticks as `.npz`.

    Needs the extra `all`. The recording shows the robot in 3D with failed actuators marked, its
    path, errors, inputs and diagnoses; `rerun PATH` opens it. The `.npz` of the same name has
    :attr:`Run.arrays`. Either both files are written completely or none.

    Args:
        path: File of the recording, which ends in `.rrd`.
        rig: Robot of the run.
        run: Result of :meth:`Rig.fly`.

    Raises:
        OutputError: The path has another suffix, or the files cannot be written.
        TypeError, ValueError: An argument has another type, or the run is of another robot.
    """
    file = Path(check.instance("path", path, str, Path))
    nq = check.instance("rig", rig, Rig).model.nq
    if check.instance("run", run, Run).qpos.shape[1] != nq:
        raise ValueError(f"run must be of this rig, with {nq} joint positions, got {run}")
    folder = usable_file(file, ".rrd", option="path")
    parameters = {"control_period_s": rig.period_s} | version_properties({"versions": versions()})
    about = About("record", file.stem, notes=[run.status], parameters=parameters)
    with published(folder, file.with_suffix(".npz").name) as staging:
        write_run(staging / file.name, rig, run, about)


def write_run(
    path: Path,
    rig: Rig,
    run: Run,
    about: About,
    *,
    arrays: Mapping[str, Array] | None = None,
    known: str = "",
    machine_file: Path | None = None,
) -> None:
    """Write the recording of a run and its arrays into the folder of `path`.

    Args:
        path: File of the recording, `.rrd`.
        rig: The robot.
        run: Run of the robot.
        about: Information from the study about the run.
        arrays: Arrays for the `.npz` file, such as :func:`.hexapod_arrays`; None: `Run.arrays`.
        known: Addition to the text of each failure, such as "known to the mapping".
        machine_file: Machine file as in :func:`.stated_of`.
    """
    arrays = run.arrays if arrays is None else arrays
    stated = stated_of(rig, run, known=known, machine_file=machine_file)
    view = RunView(stated, as_run_arrays(arrays), rig.model)
    write_arrays(path.with_suffix(".npz"), arrays)
    write_views(path, about, {about.title or rig.title: view})


def write_views(path: Path, about: About, runs: Mapping[str, RunView]) -> None:
    """Write named runs side by side as one `.rrd` file; `about` describes the first run."""
    write_scenes(path, info_of(about, next(iter(runs.values()))), scenes_of(runs))


def info_of(about: About, run: RunView) -> RecordingInfo:
    """Return notes of a recording, and properties from which its run can be read."""
    parameters = {"model_sha256": run.stated.model_sha256} | dict(about.parameters)
    stated = json.dumps(asdict(run.stated), allow_nan=False)
    title = about.title or run.stated.robot
    lines = [f"# {title}", "", *about.notes, "", *_tables(about, run), "", *constants(parameters)]
    properties, results = parameters | {STATED_PROPERTY: stated}, results_of(about, run)
    return RecordingInfo(about.identity, title, "\n".join(lines), properties, results)


def _tables(about: About, run: RunView) -> list[str]:
    """Return Markdown tables of RMS errors, next to reference values, and of peaks."""
    stated, (names, secondary) = run.stated, run.secondary
    heads = [f"{row}, u{unit}" for row, unit in zip(run.rows, stated.row_units, strict=True)]
    lines = [_row("RMS error", *heads), _row(*["---"] * (1 + len(heads)))]
    for source, values in {"here": 1e6 * run.rms(), **about.compared}.items():
        lines.append(_row(source, *("" if v is None else f"{v:.4f}" for v in values)))
    lines += ["", "| peak | |", "| --- | --- |"]
    for name, peak in zip(names, np.abs(secondary).max(axis=0), strict=True):
        lines.append(_row(name, f"{peak:.3f}"))
    peaks = np.abs(run.arrays["inputs"]).max(axis=0)
    for unit in dict.fromkeys(stated.input_units):
        columns = [k for k, other in enumerate(stated.input_units) if other == unit]
        actuators = ", ".join(stated.actuators[k] for k in columns)
        values = ", ".join(f"{peaks[k]:.{2 if unit == '%' else 6}f}" for k in columns)
        lines.append(_row(f"input of {actuators} [{unit}]", values))
    if (gap_m := run.arrays["closure_residual_m"]).any():
        lines.append(_row("closure residual [nm]", f"{1e9 * gap_m.max():.2f}"))
    return lines


def _row(*cells: str) -> str:
    return f"| {' | '.join(cells)} |"


def results_of(about: About, run: RunView) -> dict[str, Any]:
    """Return the results of a run as properties, without those that the run does not have."""
    stated = run.stated
    texts = [f"{stated.text(change)} at {change.time_s:g} s" for change in stated.incidents]
    properties: dict[str, Any] = {"study": about.study, "robot": stated.robot}
    properties["failures"] = "; ".join(texts) or "none"
    if run.failures:
        first = run.failures[0]
        properties |= {"actuator": first.actuator, "kind": first.kind, "failed_s": first.time_s}
        if (diagnosis := run.diagnosis_of(first)) is not None:
            properties["named_s"] = diagnosis.time_s - first.time_s
            properties["named_kind"] = diagnosis.kind
    parts = run.parts
    for when, predicted in zip(("before", "after"), about.predicted, strict=True):
        if when in parts:
            properties |= _by_row(run, f"rms_{when}", run.rms(parts[when]))
            properties |= _by_row(run, f"predicted_rms_{when}", predicted)
    what = stated.text(stated.incidents[0]) if stated.incidents else "No failure"
    errors = f"{what}: RMS error of {run.rms_text()}."
    properties["verdict"] = about.summary or f"{errors} {stated.status}".strip()
    return properties | {"checks": checked(about.checks)}


def _by_row(run: RunView, name: str, values: Any) -> dict[str, float]:
    """Return one entry for each major row, and one for all rows if they have the same unit."""
    if values is None or not np.isfinite(values).all():
        return {}
    units = run.stated.row_units
    rows = zip(run.rows, units, values, strict=True)
    entries = {f"{name}_{row.replace(' ', '_')}_{unit}": float(value) for row, unit, value in rows}
    if len(set(units)) == 1:
        entries[f"{name}_{units[0]}"] = float(np.linalg.norm(values))
    return entries
