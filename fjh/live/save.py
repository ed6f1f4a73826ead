"""Recording of the last minute of both machines."""

from dataclasses import replace
from itertools import count
from pathlib import Path

from fjh.live.live_run import LiveRun
from fjh.live.session import Session
from fjh.live.stage import NAMES
from fjh.recording.record import About, write_views
from fjh.recording.view import Change, RunView, in_order, view_of
from fjh.rig import Rig, Run
from fjh.rig.run import HEALTHY
from fjh.study.files import published
from fjh.study.provenance import version_properties, versions


def save_recording(folder: Path, session: Session) -> str:
    """Write the last minute as a new recording in a folder; return a sentence with its name.

    Raises:
        OutputError: The folder cannot be written; the message states the reason.
    """
    rig, logged = session.rig, session.last_minute()
    number = next(k for k in count(1) if not (folder / f"live_{k}.rrd").exists())
    name, pairs = f"live_{number}.rrd", zip(NAMES, session.runs, logged, strict=True)
    views = {label: _view(rig, live, run) for label, live, run in pairs}
    about = About(
        study="live",
        identity=f"live-{rig.title}-{number}",
        notes=[f"- {label}: {view.stated.status}" for label, view in views.items()],
        parameters={"control_period_s": rig.period_s}
        | version_properties({"versions": versions()}),
    )
    with published(folder, index=name) as staging:
        write_views(staging / name, about, views)
    return f"The last {logged[0].time_s[-1] - logged[0].time_s[0]:.0f} s are in {folder / name}."


def _view(rig: Rig, live: LiveRun, run: Run) -> RunView:
    """Return the view of a run, with its repairs as incidents."""
    view = view_of(rig, run)
    repairs = [
        Change(rig.actuators[k], HEALTHY, at_s)
        for at_s, k, kind in live.changes
        if kind == HEALTHY and at_s >= run.time_s[0]
    ]
    incidents = in_order([*view.stated.incidents, *repairs])
    return replace(view, stated=replace(view.stated, incidents=incidents))
