"""The recording of `fjh track`: the robot with this controller, and beside it with another."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from experiments.recording.flight import info_of, of_flight
from experiments.recording.properties import results_of
from experiments.recording.screens import write_flights
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
    flights = {rig.title: of_flight(rig, tracked.run)}
    results = results_of(
        flights[rig.title],
        "track",
        checks=checks,
        predicted_before=summary["predicted_rms_before"],
        predicted_after=summary["predicted_rms_after_when_named"],
        verdict=summary["verdict"],
    )
    identity = f"track-{rig.title}-seed{tracked.seed}"
    lines = [f"- {sentence}" for sentence in said]
    about = info_of(rig, tracked.run, identity, lines, properties, results)
    if (other := tracked.other) is not None:
        flights[controller_label(other.name)] = of_flight(rig, other.run)
    write_flights(folder / "track.rrd", about, flights)
