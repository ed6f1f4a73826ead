"""One failure of one robot: flown by both machines, filmed, and put into numbers."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from argument_checks.ties import greatest
from fjh.live.flight import Flight
from fjh.live.page import local_server, stop
from fjh.live.panel import BUTTONS
from fjh.live.session import LASTING, Kind, Session
from fjh.live.stage import FRAME_S, NAMES, Stage
from fjh.recording.file import round_down
from fjh.rig import Rig
from fjh.rig.events import EVENTS
from fjh.rig.mjcf import rig_of
from fjh.rig.options import RobotOptions
from fjh.rig.run import SOUND
from fjh.rig.units import norms_said

BREAKS_S, ENDS_S = 1.5, 4.5
BEGINS_S = 0.5
"""Of the errors before the failure: the path has begun."""
_TURN_RAD, _SHIFT, _BELOW, _NEARER, _HIGHER = 0.6, 0.3, 0.95, 0.66, 0.3
"""No magnified motion goes further: an angle, and a part of the machine's extent. In extents, too,
how far below the caption is, by how much the camera is nearer than the live page's, and higher."""

FAILING: dict[str, Kind] = {
    "Lock": "locked",
    "No force": "free",
    "Half force": "weak",
    "Loose": "loose",
}
_DISTURBING = {"Bump": "bump"} | {words: name for name, words in BUTTONS.items()}
HAPPENINGS = (*FAILING, *_DISTURBING)
_DATA = re.compile(r'(?<=window\.__VISER_EMBED_DATA__=")[^"]*')


@dataclass(frozen=True)
class Filmed:
    """What a page shows of a failure; numbers are in words, with units.

    Attributes:
        robot: Its title.
        happening: One of `HAPPENINGS`.
        of: The actuator that fails; None where none does.
        happens: The same in a sentence.
        status: What the supervisor made of the flight.
        said: What it said from the failure on, each with its time [s].
        errors: Of each machine, supervised first: RMS before, RMS and largest from then on.
        curves: Of each, the largest error within each frame, in parts of the path's radius.
        named_s: When an actuator was first named; None is never.
        factor: By which the motion is magnified.
        client: A page of viser with its data left out, the same for all.
        data: What belongs into it.
    """

    robot: str
    happening: str
    of: str | None
    happens: str
    status: str
    said: tuple[tuple[float, str], ...]
    errors: tuple[tuple[str, str, str], ...]
    curves: tuple[tuple[float, ...], ...]
    named_s: float | None
    factor: int
    client: str
    data: str


@cache
def _rig(model: Path | None, options: RobotOptions) -> Rig:
    return rig_of(model, options)


def filmed(model: Path | None, options: RobotOptions, happening: str, seed: int) -> Filmed:
    """A failure of the actuator that has moved most by then, or a disturbance.

    Args:
        model: An MJCF file; None is the hexapod.
        options: Of the robot.
        happening: One of `HAPPENINGS`.
        seed: Of all noise, and of what is drawn.

    Raises:
        WrongInput, sim.ModelError: As of :func:`asked_rig`.
        sim.SimulationDiverged: The physics left the finite numbers.
    """
    rig = _rig(model, options)
    session, period_s = Session(rig, seed), rig.period_s
    every, breaks = round(FRAME_S / period_s), round(BREAKS_S / period_s)
    session.advance(breaks - session.tick)
    actuator = None
    if happening in FAILING:
        actuator = greatest(np.ptp(session.flights[0].run(0).displacement, axis=0))
        session.make(actuator, FAILING[happening])
    elif (name := _DISTURBING[happening]) in LASTING:
        session.last(name, True)
    else:
        session.disturb(name)
    said = list[tuple[float, str]]()
    for tick in range(breaks, round(ENDS_S / period_s)):
        session.advance(1)
        sentence = session.flights[0].belief
        if not said or said[-1][1] != sentence:
            said.append((tick * period_s, sentence))
    run = session.flights[0].run(0)
    of = None if actuator is None else rig.actuators[actuator]
    html, factor = _film(session, f"{happening}, {of}" if of else happening, every)
    return Filmed(
        robot=rig.title,
        happening=happening,
        of=of,
        happens=EVENTS[FAILING.get(happening) or _DISTURBING[happening]].sentence,
        status=run.status,
        said=tuple(said),
        errors=tuple(_errors(rig, flight, breaks) for flight in session.flights),
        curves=tuple(_curve(rig, flight, every) for flight in session.flights),
        named_s=run.diagnoses[0].time_s if run.diagnoses else None,
        factor=factor,
        client=_DATA.sub("", html, count=1),
        data=_DATA.findall(html)[0],
    )


def _errors(rig: Rig, flight: Flight, breaks: int) -> tuple[str, str, str]:
    before = flight.error(slice(round(BEGINS_S / rig.period_s), breaks))
    after = flight.error(slice(breaks, flight.tick))
    rms = [np.sqrt((each**2).mean(axis=0)) for each in (before, after)]
    worst = after[greatest(np.linalg.norm(after, axis=1))]
    before_s, after_s, worst_s = (norms_said(each, rig.row_units) for each in (*rms, worst))
    return before_s, after_s, worst_s


def _curve(rig: Rig, flight: Flight, every: int) -> tuple[float, ...]:
    """The largest error within each frame, in parts of the path's radius."""
    size = np.linalg.norm(flight.error(slice(0, flight.tick)), axis=1) / rig.size
    frames = len(size) // every
    return tuple(size[: frames * every].reshape(frames, every).max(axis=1).tolist())


def _film(session: Session, words: str, every: int) -> tuple[str, int]:
    """The flights again, as a page of viser, and the factor by which their motion is magnified."""
    rig, flights = session.rig, session.flights
    breaks = round(BREAKS_S / rig.period_s)
    server = local_server(None)
    try:
        stage = Stage(server, rig, flights, NAMES)
        stage.factor = min(stage.factor, _visible(rig, flights))
        below = rig.model.stat.center - np.array([0.0, 0.0, _BELOW * rig.model.stat.extent])
        caption = server.scene.add_label("/caption", "", position=below, anchor="top-center")
        camera, raised = server.initial_camera, [0.0, 0.0, _HIGHER * rig.model.stat.extent]
        camera.position = camera.look_at + _NEARER * (camera.position - camera.look_at) + raised
        recorded = server.get_scene_serializer()
        for tick in range(every, flights[0].tick + 1, every):
            broken = tick > breaks
            states = session.states if broken else (SOUND,) * len(session.states)
            with server.atomic():
                stage.show(flights, states, session.course.outline, tick)
                caption.text = f"{tick * rig.period_s:.1f} s: {words if broken else 'all is sound'}"
            recorded.insert_sleep(every * rig.period_s)
        return recorded.as_html(), stage.factor
    finally:
        stop(server)


def _visible(rig: Rig, flights: Sequence[Flight]) -> int:
    """The round factor by which no major row moves too far to be seen."""
    rows = np.concatenate([flight.seen(slice(0, flight.tick))[2] for flight in flights])
    room = [_TURN_RAD if u == "rad" else _SHIFT * rig.model.stat.extent for u in rig.row_units]
    return int(round_down(np.clip((room / np.abs(rows).max(axis=0)).min(), 1.0, 5e9)))
