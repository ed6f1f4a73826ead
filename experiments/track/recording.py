"""The recording of `fjh track`: the robot with this controller, and beside it with another."""

from pathlib import Path
from typing import Any

from experiments.recording.file import RecordingInfo
from experiments.recording.flight import driven
from experiments.recording.mechanism import write_mechanism
from experiments.study.controllers import controller_label
from experiments.study.provenance import version_properties
from experiments.track.runs import Tracked


def record(tracked: Tracked, summary: dict[str, Any], folder: Path) -> None:
    """Write `track.rrd`."""
    rig = tracked.rig
    properties = {key: summary[key] for key in ("seed", "model_sha256", "control_period_s")}
    properties |= {"path_size": rig.size, "sensor_noise": rig.noise} | version_properties(summary)
    said = [summary["verdict"], *(f"Loop: {margin}." for margin in rig.margins)]
    text = "\n".join([f"# {rig.title}", "", *(f"- {sentence}" for sentence in said)])
    identity = f"track-{rig.title}-seed{tracked.seed}"
    about = RecordingInfo(identity, rig.title, text, properties)
    flights = {rig.title: driven(rig, tracked.run)}
    if (other := tracked.other) is not None:
        flights[controller_label(other.name)] = driven(rig, other.run)
    write_mechanism(folder / "track.rrd", about, rig.model, flights)
