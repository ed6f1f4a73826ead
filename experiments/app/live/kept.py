"""The last minute of both machines, as a recording."""

from itertools import count
from pathlib import Path

from experiments.app.live.flight import Flight
from experiments.app.live.session import Session
from experiments.app.live.stage import NAMES
from experiments.recording.flight import info_of, stated_of
from experiments.recording.properties import results_of
from experiments.recording.robot import of_robot
from experiments.recording.screens import write_flights
from experiments.recording.shown import Shown
from experiments.rig import Rig, Run
from experiments.rig.run import SOUND
from experiments.study.files import published
from experiments.study.provenance import version_properties, versions


def keep(folder: Path, session: Session) -> str:
    """Write what happened of late as a recording, beside former ones; where it is, in a sentence.

    Raises:
        OutputError: The folder or the disk refuses; the message says why.
    """
    rig, runs = session.rig, session.last_minute()
    number = next(k for k in count(1) if not (folder / f"live_{k}.rrd").exists())
    name = f"live_{number}.rrd"
    pairs = zip(NAMES, session.flights, runs, strict=True)
    flights = {of: _shown(rig, flight, run) for of, flight, run in pairs}
    said = [f"- {of}: {shown.status}" for of, shown in flights.items()]
    properties = {"control_period_s": rig.period_s} | version_properties({"versions": versions()})
    results = results_of(flights[NAMES[0]], "live")
    about = info_of(rig, runs[0], f"live-{rig.title}-{number}", said, properties, results)
    with published(folder, index=name) as staging:
        write_flights(staging / name, about, flights)
    return f"The last {runs[0].time_s[-1] - runs[0].time_s[0]:.0f} s are in {folder / name}."


def _shown(rig: Rig, flight: Flight, run: Run) -> Shown:
    """A flight with what was repaired in it."""
    stated = stated_of(rig, run)
    stated["failures"] += [
        {"actuator": rig.actuators[k], "kind": SOUND, "time_s": at_s}
        for at_s, k, kind in flight.changes
        if kind == SOUND and at_s >= run.time_s[0]
    ]
    return of_robot(run.arrays, stated, rig.model)
