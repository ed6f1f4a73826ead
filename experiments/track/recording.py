"""The recording of `fjh track`: the robot with this controller, and beside it with another."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from experiments.recording.record import About, write_views
from experiments.recording.view import view_of
from experiments.rig.units import loops_said
from experiments.study.controllers import controller_label
from experiments.study.provenance import version_properties
from experiments.study.results import Check
from experiments.track.runs import Tracked


def record(
    tracked: Tracked, summary: dict[str, Any], checks: Sequence[Check], folder: Path
) -> None:
    """Write `track.rrd`."""
    rig = tracked.rig
    properties = {"seed": summary["seed"], "control_period_s": summary["control_period_s"]}
    properties |= {"path_size": rig.size, "sensor_noise": rig.noise} | version_properties(summary)
    said = [summary["verdict"], *loops_said(rig.major, rig.margins)]
    about = About(
        study="track",
        identity=f"track-{rig.title}-seed{tracked.seed}",
        said=[f"- {sentence}" for sentence in said],
        parameters=properties,
        predicted=(summary["predicted_rms_before"], summary["predicted_rms_after_when_named"]),
        checks=checks,
        verdict=summary["verdict"],
    )
    runs = {rig.title: view_of(rig, tracked.run)}
    if (other := tracked.other) is not None:
        runs[controller_label(other.name)] = view_of(rig, other.run)
    write_views(folder / "track.rrd", about, runs)
