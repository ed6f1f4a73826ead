"""The recording of `fjh track`: the mechanism in 3D, its path, actuators, limits, closures."""

from pathlib import Path
from typing import Any

import numpy as np

from experiments.recording.file import RecordingInfo, at_most
from experiments.recording.marks import Mark
from experiments.recording.mechanism import Driven, write_mechanism
from experiments.recording.views import Plot, Task
from experiments.rig.run import Run
from experiments.study.controllers import controller_label
from experiments.study.provenance import version_properties
from experiments.track.runs import Tracked
from experiments.track.words import ROWS

_SIGNALS_HZ = 200


def record(tracked: Tracked, summary: dict[str, Any], folder: Path) -> None:
    """Write `track.rrd`."""
    rig, run = tracked.rig, tracked.run
    properties = {key: summary[key] for key in ("seed", "model_sha256", "control_period_s")}
    properties |= {"path_size": rig.size, "sensor_noise": rig.noise} | version_properties(summary)
    said = [summary["verdict"], *(f"Loop: {margin}." for margin in rig.margins)]
    text = "\n".join([f"# {rig.title}", "", *(f"- {sentence}" for sentence in said)])
    identity = f"track-{rig.title}-seed{tracked.seed}"
    about = RecordingInfo(identity, rig.title, text, properties)
    every = at_most(_SIGNALS_HZ, run.time_s)
    plots = [
        _error(tracked, summary, run),
        Plot(
            "actuators",
            f"Actuators from the start [{', '.join(dict.fromkeys(rig.units))}]",
            list(rig.actuators),
            run.time_s[every],
            run.displacement[every],
        ),
        *_limits(tracked, every),
        *_closure(tracked, every),
    ]
    driven = Driven(
        run.time_s,
        run.qpos,
        plots,
        _task(tracked, summary),
        nominal=run.qpos[0],
        marks=_marks(tracked, summary),
    )
    conditions = {rig.title: driven}
    if (other := tracked.other) is not None:
        theirs = other.run
        conditions[controller_label(other.name)] = Driven(
            theirs.time_s,
            theirs.qpos,
            [_error(tracked, summary, theirs)],
            nominal=theirs.qpos[0],
        )
    write_mechanism(folder / "track.rrd", about, rig.model, conditions)


def _error(tracked: Tracked, summary: dict[str, Any], run: Run) -> Plot:
    """Of each major row."""
    every = at_most(_SIGNALS_HZ, run.time_s)
    names = [
        f"{ROWS[row]} off [u{unit}]"
        for row, unit in zip(tracked.rig.major, summary["units"], strict=True)
    ]
    error = 1e6 * (run.desired - run.true)[every]
    return Plot("error", "Desired - true", names, run.time_s[every], error)


def _limits(tracked: Tracked, every: slice) -> list[Plot]:
    """Where each actuator that is limited on both sides is in its range."""
    if tracked.rig.limits is None:
        return []
    lower, upper = tracked.rig.limits
    limited = np.flatnonzero(np.isfinite(upper - lower) & (upper > lower))
    if not limited.size:
        return []
    span = (upper - lower)[limited]
    part = 100 * (tracked.run.displacement[every][:, limited] - lower[limited]) / span
    names = [f"{tracked.rig.actuators[k]} [%]" for k in limited]
    return [Plot("limits", "Position in its range [%]", names, tracked.run.time_s[every], part)]


def _closure(tracked: Tracked, every: slice) -> list[Plot]:
    """The largest gap of a closed loop; nothing where there are none."""
    gap_um = 1e6 * tracked.run.closure_m[every, None]
    if not gap_um.any():
        return []
    names = ["largest gap [um]"]
    return [Plot("closure", "Closure residual [um]", names, tracked.run.time_s[every], gap_um)]


def _task(tracked: Tracked, summary: dict[str, Any]) -> Task | None:
    """Desired and reached path in the plane of the first two rows; None of a single row."""
    major, run = tracked.rig.major, tracked.run
    if len(major) < 2:
        return None
    names = ROWS[major[0]], ROWS[major[1]]
    unit = f"u{summary['units'][0]}"
    return Task(names, unit, 1e6 * run.desired[:, :2], 1e6 * run.true[:, :2])


def _marks(tracked: Tracked, summary: dict[str, Any]) -> tuple[tuple[str, Mark], ...]:
    """Where actuators fail, by the body that they move, and what was made of it."""
    marks = []
    for failure, entry in zip(tracked.failures, summary["failures"], strict=True):
        body = tracked.rig.bodies[failure.number]
        if body is None:
            continue
        label, named = f"{entry['actuator']} {entry['kind']}", dict[str, Any]()
        found = next(
            (one for one in summary["diagnoses"] if one["actuator"] == entry["actuator"]), None
        )
        if found is not None and found["delay_s"] is not None:
            said = f"{label}, named {found['kind']}"
            named = {"diagnosed_s": found["time_s"], "diagnosis": said}
        marks.append((body, Mark(failure.number, failure.time_s, label, **named)))
    return tuple(marks)
