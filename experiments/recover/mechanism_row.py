"""A flight of any robot as a row: what was drawn, what the diagnosis made of it, and the errors."""

import pyarrow as pa

from experiments.recover.mechanism_flight import MechanismFlight, MechanismFlown, fly
from experiments.study.campaign import Row
from sim import SimulationDiverged

_WORDS = ("status", "message", "sense", "actuator", "kind", "named")
_NUMBERS = (
    *("effectiveness", "time_s", "alarm_delay_s", "named_delay_s"),
    *("rms_before", "rms_after", "rms_informed", "closure_residual_max_m"),
)
_SWITCHES = (
    *("isolable", "alarm_before", "right", "all_right"),
    *("unexplained", "sound_named", "task_lost", "lost_rightly"),
)

SCHEMA = pa.schema(
    [
        *((name, pa.int64()) for name in ("case", "seed", "alarms")),
        *((name, pa.string()) for name in _WORDS),
        ("kinds", pa.list_(pa.string())),
        *((name, pa.bool_()) for name in _SWITCHES),
        *((name, pa.float64()) for name in _NUMBERS),
    ]
)
"""Columns of the robot's dataset: times from the failure, RMS errors in sizes of the path."""


def row_of(flight: MechanismFlight) -> Row:
    """The row of a flight, which is simulated here; its status is "flown" or "diverged"."""
    try:
        return flown_row(fly(flight))
    except SimulationDiverged as diverged:
        return _drawn(flight) | {"status": "diverged", "message": str(diverged)}


def flown_row(flown: MechanismFlown) -> Row:
    """The row of a flight that stayed finite."""
    flight, found, rig = flown.flight, flown.found, flown.flight.rig()
    row = _drawn(flight) | {
        "status": "flown",
        "alarms": len(found.alarm_ticks),
        "unexplained": found.unexplained,
        "sound_named": found.sound_named,
        "task_lost": found.task_lost,
        "lost_rightly": found.lost_rightly,
        "rms_before": flown.rms[0],
        "closure_residual_max_m": found.closure_residual_max_m,
    }
    if (fault := flight.fault) is None:
        return row
    first, struck = found.first, found.struck[0]
    delays = {
        "alarm_delay_s": found.detected,
        "named_delay_s": None if first is None else first.tick,
    }
    standing = {each.fault.actuator: each for each in found.standing}.get(fault.actuator)
    return row | {
        "alarm_before": found.alarm_before,
        **{key: None if at is None else (at - struck) * rig.period_s for key, at in delays.items()},
        "named": None if first is None else rig.actuators[first.fault.actuator],
        "right": found.strut_right,
        "kinds": [] if standing is None else list(standing.kinds),
        "all_right": found.all_right,
        "rms_after": flown.rms[1],
        "rms_informed": flown.rms_informed,
    }


def _drawn(flight: MechanismFlight) -> Row:
    drawn = {"case": flight.number, "seed": flight.seed, "sense": flight.sense}
    if (fault := flight.fault) is None or flight.failure is None:
        return drawn | {"kind": "none"}
    return drawn | {
        "actuator": flight.rig().actuators[fault.actuator],
        "kind": fault.kind,
        "effectiveness": fault.effectiveness if fault.kind == "weak" else None,
        "time_s": flight.failure.time_s,
        "isolable": flight.isolable,
    }
