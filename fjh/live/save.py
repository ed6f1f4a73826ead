"""The last minute of both machines, as a recording."""

from dataclasses import replace
from itertools import count
from pathlib import Path

from fjh.live.live_run import LiveRun
from fjh.live.session import Session
from fjh.live.stage import NAMES
from fjh.recording.record import About, write_views
from fjh.recording.view import Change, RunView, in_order, view_of
from fjh.rig import Rig, Run
from fjh.rig.run import SOUND
from fjh.study.files import published
from fjh.study.provenance import version_properties, versions


def save_recording(folder: Path, session: Session) -> str:
    """Write what happened of late as a recording, beside former ones; where it is, in a sentence.

    Raises:
        OutputError: The folder or the disk refuses; the message says why.
    """
    rig, runs = session.rig, session.last_minute()
    number = next(k for k in count(1) if not (folder / f"live_{k}.rrd").exists())
    name, pairs = f"live_{number}.rrd", zip(NAMES, session.flights, runs, strict=True)
    views = {of: _view(rig, flight, run) for of, flight, run in pairs}
    about = About(
        study="live",
        identity=f"live-{rig.title}-{number}",
        notes=[f"- {of}: {view.stated.status}" for of, view in views.items()],
        parameters={"control_period_s": rig.period_s}
        | version_properties({"versions": versions()}),
    )
    with published(folder, index=name) as staging:
        write_views(staging / name, about, views)
    return f"The last {runs[0].time_s[-1] - runs[0].time_s[0]:.0f} s are in {folder / name}."


def _view(rig: Rig, flight: LiveRun, run: Run) -> RunView:
    """A run with what was repaired in it."""
    view = view_of(rig, run)
    repairs = [
        Change(rig.actuators[k], SOUND, at_s)
        for at_s, k, kind in flight.changes
        if kind == SOUND and at_s >= run.time_s[0]
    ]
    incidents = in_order([*view.stated.incidents, *repairs])
    return replace(view, stated=replace(view.stated, incidents=incidents))
