"""A flight of any robot in which something happens, as a row: against one that does nothing."""

from math import ceil

import numpy as np
import pyarrow as pa

from experiments.recover.event_row import doing_nothing, ended, named
from experiments.recover.mechanism_flight import MechanismFlight
from experiments.recover.recovery import RECOVERED_S, supervised
from experiments.rig.events.hooks import events_of
from experiments.rig.rig import Rig
from experiments.rig.run import Run
from experiments.study.campaign import Row
from experiments.study.study import WrongInput

_RMS = tuple(
    f"rms_{who}_{when}" for who in ("supervised", "unaware") for when in ("since", "after")
)
_SWITCHES = (
    *("alarm_before", "strut_right", "kind_right", "cause_right"),
    *("sound_named", "unexplained", "task_lost"),
)

SCHEMA = pa.schema(
    [
        *((name, pa.int64()) for name in ("case", "seed", "alarms", "withdrawn")),
        *((name, pa.string()) for name in ("status", "message", "event", "actuator", "said")),
        *((name, pa.string()) for name in ("first_named", "first_kind", "unaware_ended")),
        *((name, pa.bool_()) for name in _SWITCHES),
        *((name, pa.float64()) for name in ("time_s", "alarm_ms", "named_ms", *_RMS)),
        ("closure_residual_max_m", pa.float64()),
    ]
)
"""Columns of the robot's events; RMS errors in sizes of the path, `after` from 0.5 s on."""


def row_of(flight: MechanismFlight) -> Row:
    """The row of a flight, which is simulated here.

    Its status is "flown"; "refused" if the robot cannot have the event; or "ended" where the
    supervised controller's flight ends by an error or an infinite number, which `message` has.
    """
    rig, [event] = flight.rig(), flight.events
    actuator = None if event.actuator is None else rig.actuators[rig.number(event.actuator)]
    row: Row = {"case": flight.number, "seed": flight.seed, "event": event.name}
    row |= {"actuator": actuator, "time_s": event.time_s}
    try:
        failures = events_of(rig, flight.events, seed=flight.seed)[1]
    except WrongInput as refused:
        return row | {"status": "refused", "message": str(refused)}
    struck = ceil(event.time_s / rig.period_s - 1e-6)
    unaware, row["unaware_ended"] = ended(lambda: doing_nothing(rig, flight))
    if unaware is not None:
        row |= _errors("unaware", rig, unaware, struck)
    flown, why = ended(lambda: supervised(rig, flight))
    if flown is None:
        return row | {"status": "ended", "message": why}
    run, found = flown
    row |= _errors("supervised", rig, run, struck) | {"status": "flown", "said": run.status}
    row |= named(rig, flight, failures, run, found, struck)
    first = row.pop("first_strut")
    return row | {"first_named": None if first is None else rig.actuators[first - 1]}


def _errors(who: str, rig: Rig, run: Run, struck: int) -> Row:
    """Of all major rows together, in sizes of the path: from the event on, and 0.5 s later on."""
    square = (((run.desired - run.true) / rig.size) ** 2).sum(axis=1)
    spans = {"since": struck, "after": struck + round(RECOVERED_S / rig.period_s)}
    return {f"rms_{who}_{when}": float(np.sqrt(square[k:].mean())) for when, k in spans.items()}
