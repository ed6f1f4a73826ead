"""A run of any robot on disk: every tick as arrays, and the robot in 3D beside its signals."""

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

FLIGHT = "flight"
"""The property from which a run is read back: JSON of :class:`.view.Stated`."""


@dataclass(frozen=True)
class About:
    """A study's words and numbers on a run, besides what happened in it.

    Attributes:
        study: By whom it was run.
        identity: Distinguishes the recording for the viewer, as study, name and seed do.
        title: Of the recording, for people; empty is the robot's name.
        said: Lines of Markdown: how the run was made, what came out.
        parameters: Seed, versions, every constant; units in the names.
        compared: RMS errors of the major rows [urad], [um] to compare with, by their source.
        predicted: RMS errors of the major rows [rad], [m] by a linear model, until and from the
            first incident; None where the study predicts none.
        checks: Of the study.
        verdict: One sentence; empty is the errors and the controller's status.
    """

    study: str
    identity: str
    title: str = ""
    said: Sequence[str] = ()
    parameters: Mapping[str, Any] = field(default_factory=dict)
    compared: Mapping[str, Sequence[float | None]] = field(default_factory=dict)
    predicted: tuple[Any, Any] = (None, None)
    checks: Sequence[Check] = ()
    verdict: str = ""


def record(path: str | Path, rig: Rig, run: Run) -> None:
    """Write a run as a Rerun recording, and all its ticks beside it.

    Needs the extra `all`. The recording shows the robot in 3D, its failed actuators marked,
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
    parameters = {"control_period_s": rig.period_s} | version_properties({"versions": versions()})
    about = About("record", file.stem, said=[run.status], parameters=parameters)
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
    """Write the recording of a run, and its arrays beside it, into a folder that is published.

    Args:
        path: Of the recording, `.rrd`.
        rig: The robot.
        run: Of it.
        about: What the study says of it.
        arrays: What the `.npz` has: :func:`.hexapod_arrays` and more, or, which None is,
            `Run.arrays`.
        known: What else is to be said of each failure, as "known to the mapping".
        machine_file: As of :func:`.stated_of`.
    """
    arrays = run.arrays if arrays is None else arrays
    stated = stated_of(rig, run, known=known, machine_file=machine_file)
    view = RunView(stated, as_run_arrays(arrays), rig.model)
    write_arrays(path.with_suffix(".npz"), arrays)
    write_views(path, about, {about.title or rig.title: view})


def write_views(path: Path, about: About, runs: Mapping[str, RunView]) -> None:
    """Write runs side by side, by their names, as one `.rrd` file; `about` is of the first."""
    write_scenes(path, info_of(about, next(iter(runs.values()))), scenes_of(runs))


def info_of(about: About, run: RunView) -> RecordingInfo:
    """Notes and properties of the recording of a run; with these it is read back."""
    parameters = {"model_sha256": run.stated.model_sha256} | dict(about.parameters)
    stated = json.dumps(asdict(run.stated), allow_nan=False)
    title = about.title or run.stated.robot
    notes = "\n".join([f"# {title}", "", *about.said, "", *_tables(about, run)])
    notes = "\n".join([notes, "", *constants(parameters)])
    return RecordingInfo(
        about.identity, title, notes, parameters | {FLIGHT: stated}, results_of(about, run)
    )


def _tables(about: About, run: RunView) -> list[str]:
    """RMS errors and those to compare with, and peaks, in Markdown."""
    its, (names, secondary) = run.stated, run.secondary
    heads = [f"{row}, u{unit}" for row, unit in zip(run.rows, its.row_units, strict=True)]
    lines = [_row("RMS error", *heads), _row(*["---"] * (1 + len(heads)))]
    for source, values in {"here": 1e6 * run.rms(), **about.compared}.items():
        lines.append(_row(source, *("" if v is None else f"{v:.4f}" for v in values)))
    lines += ["", "| peak | |", "| --- | --- |"]
    for name, peak in zip(names, np.abs(secondary).max(axis=0), strict=True):
        lines.append(_row(name, f"{peak:.3f}"))
    peaks = np.abs(run.arrays["inputs"]).max(axis=0)
    for unit in dict.fromkeys(its.input_units):
        own = [k for k, each in enumerate(its.input_units) if each == unit]
        named = ", ".join(its.actuators[k] for k in own)
        values = ", ".join(f"{peaks[k]:.{2 if unit == '%' else 6}f}" for k in own)
        lines.append(_row(f"input of {named} [{unit}]", values))
    if (gap_m := run.arrays["closure_residual_m"]).any():
        lines.append(_row("closure residual [nm]", f"{1e9 * gap_m.max():.2f}"))
    return lines


def _row(*cells: str) -> str:
    return f"| {' | '.join(cells)} |"


def results_of(about: About, run: RunView) -> dict[str, Any]:
    """The results of a run as properties; what it does not have is absent."""
    its = run.stated
    texts = [f"{its.text(each)} at {each.time_s:g} s" for each in its.incidents]
    found: dict[str, Any] = {"study": about.study, "robot": its.robot}
    found["failures"] = "; ".join(texts) or "none"
    if run.failures:
        first = run.failures[0]
        found |= {"actuator": first.actuator, "kind": first.kind, "failed_s": first.time_s}
        if (diagnosis := run.diagnosis_of(first)) is not None:
            found["named_s"] = diagnosis.time_s - first.time_s
            found["named_kind"] = diagnosis.kind
    parts = run.parts
    for when, predicted in zip(("before", "after"), about.predicted, strict=True):
        if when in parts:
            found |= _by_row(run, f"rms_{when}", run.rms(parts[when]))
            found |= _by_row(run, f"predicted_rms_{when}", predicted)
    happened = its.text(its.incidents[0]) if its.incidents else "No failure"
    errors = f"{happened}: RMS error of {run.rms_text()}."
    found["verdict"] = about.verdict or f"{errors} {its.status}".strip()
    return found | {"checks": checked(about.checks)}


def _by_row(run: RunView, name: str, values: Any) -> dict[str, float]:
    """One entry a major row; and one of all of them, where they have one unit."""
    if values is None or not np.isfinite(values).all():
        return {}
    units = run.stated.row_units
    named = zip(run.rows, units, values, strict=True)
    found = {f"{name}_{row.replace(' ', '_')}_{unit}": float(each) for row, unit, each in named}
    if len(set(units)) == 1:
        found[f"{name}_{units[0]}"] = float(np.linalg.norm(values))
    return found
