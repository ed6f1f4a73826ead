"""A flight as a row: what was drawn, what the diagnosis made of it, and the pointing errors."""

from collections.abc import Callable

import numpy as np
import pyarrow as pa

from experiments.recover import event_row, predictions
from experiments.recover.flight import Flight, Sort, exact_rig
from experiments.recover.pointing import WHEN, error_columns
from experiments.recover.recovery import (
    Identification,
    fault_unaware,
    informed,
    supervised,
)
from experiments.rig.other_controller import fly_with
from experiments.rig.run import Run
from experiments.study.campaign import Row
from ftc.fdi.diagnosis import Diagnosis
from sim import SimulationDiverged

CONTROLLERS = ("supervised", "informed", "unaware")

_INTEGERS = ("strut", "second_strut", "first_strut", "last_strut", "alarms")
_WORDS = ("kind", "second_kind", "first_kind", "last_kind", "last_kinds", "message")
_SWITCHES = (
    *("alarm_before", "sound_named", "strut_right", "kind_right", "cause_right", "all_right"),
    "commands_changed",
    *("unexplained", "task_lost", "lost_rightly"),
)
_NUMBERS = (
    *("time_s", "effectiveness", "second_time_s", "second_effectiveness"),
    *("separation_from_others", "separation_from_kinds"),
    *("alarm_ms", "named_ms", "first_effectiveness", "first_confidence"),
    *("last_effectiveness", "kind_confidence", "closure_residual_max_m"),
    *(f"{what}_{c}_{w}_urad" for c in CONTROLLERS for w in WHEN for what in ("rms", "peak")),
)

SCHEMA = pa.schema(
    [
        ("case", pa.int64()),
        ("sort", pa.string()),
        ("draw", pa.int64()),
        ("mismatch", pa.string()),
        ("factor", pa.float64()),
        *((name, pa.int64()) for name in ("plant_seed", "seed")),
        *((name, pa.float64()) for name in ("begin_s", "duration_s")),
        ("status", pa.string()),
        *((name, pa.int64()) for name in _INTEGERS),
        *((name, pa.string()) for name in _WORDS),
        *((name, pa.bool_()) for name in _SWITCHES),
        *((name, pa.float64()) for name in _NUMBERS),
        *((name, pa.int64()) for name in event_row.COLUMNS["integers"]),
        *((name, pa.string()) for name in event_row.COLUMNS["words"]),
        *((name, pa.float64()) for name in event_row.COLUMNS["numbers"]),
    ]
)
"""Columns of the study's dataset; struts count from 1, ticks from the flight's first failure."""


def row_of(flight: Flight) -> Row:
    """The row of a flight, which is simulated here; its status is "flown" or "diverged".

    Or "ended", if the supervised controller of an event raised an error.
    """
    try:
        return flight.parameters() | {"status": "flown"} | _FLY[flight.sort](flight)
    except SimulationDiverged as diverged:
        return flight.parameters() | {"status": "diverged", "message": str(diverged)}


def _failure(flight: Flight) -> Row:
    """Two controllers, or three where their errors are compared by kind of failure."""
    rig, fault = flight.rig(), flight.fault
    run, found = supervised(rig, flight)
    stuck_m = float(run.displacement[found.struck[0], fault.actuator])
    row = supervised_columns(flight, run, found)
    row |= error_columns("informed", informed(rig, flight, fault, stuck_m))
    if flight.mismatch == "all":
        row |= error_columns("unaware", fault_unaware(rig, flight))
    if flight.mismatch in ("exact", "all"):  # the rows for which the isolation rate is given
        others, kinds = predictions.from_others_and_kinds(exact_rig(), flight)
        row |= {"separation_from_others": others, "separation_from_kinds": kinds}
    return row


def other_columns(flight: Flight, controller: str) -> Row:
    """The same errors of another controller, and a sentence if it failed; beside the dataset.

    Only in the main thread of a process, where a controller that takes too long can be stopped.
    """
    run, failed = flown_with(flight, controller)
    return error_columns("other", run) | {"case": flight.number, "controller_failure": failed}


def flown_with(flight: Flight, controller: str) -> tuple[Run, str | None]:
    """The flight with another controller, and a sentence if it failed."""
    rig, part = flight.rig(), {"seed": flight.seed, "begin_s": flight.begin_s}
    return fly_with(rig, controller, flight.path(rig), failures=flight.failures, **part)


def supervised_columns(flight: Flight, run: Run, found: Identification) -> Row:
    """What the row has of the supervised controller alone."""
    match flight.sort:
        case "sound":
            return _watched(found)
        case "pair":
            return _identified(flight, found)
        case "event":
            return event_row.supervised_columns(flight.rig(), flight, run, found)
        case "failure" | "size":
            return _identified(flight, found) | error_columns("supervised", run)


def _alone(flight: Flight) -> Row:
    return supervised_columns(flight, *supervised(flight.rig(), flight))


def _sound(flight: Flight) -> Row:
    """Whether alarms changed a command is found by flying again without a diagnosis."""
    rig = flight.rig()
    run, found = supervised(rig, flight)
    changed = False
    if found.alarm_ticks:
        changed = not np.array_equal(run.inputs, fault_unaware(rig, flight).inputs)
    return supervised_columns(flight, run, found) | {"commands_changed": changed}


_FLY: dict[Sort, Callable[[Flight], Row]] = {
    "failure": _failure,
    "size": _alone,
    "sound": _sound,
    "pair": _alone,
    "event": event_row.event_columns,
}


def _watched(found: Identification) -> Row:
    return {
        "alarms": len(found.alarm_ticks),
        **{name: getattr(found, name) for name in ("alarm_before", "sound_named", "unexplained")},
        "task_lost": found.task_lost,
        "lost_rightly": found.lost_rightly,
        "closure_residual_max_m": found.closure_residual_max_m,
    }


def _identified(flight: Flight, found: Identification) -> Row:
    first = found.first
    own = [each for each in found.standing if each.fault.actuator == flight.fault.actuator]
    last = own[-1] if own else None
    return {
        **_watched(found),
        "strut_right": found.strut_right,
        "kind_right": last is not None and flight.fault.kind in last.kinds,
        "all_right": found.all_right,
        "alarm_ms": _after_ms(found, found.detected),
        "named_ms": _after_ms(found, first and first.tick),
        "first_strut": first and first.fault.actuator + 1,
        "first_kind": first and first.fault.kind,
        "first_effectiveness": first and first.fault.effectiveness,
        "first_confidence": first and first.actuator_confidence,
        **_last(last),
    }


def _last(last: Diagnosis | None) -> Row:
    """The last diagnosis of the strut that failed first."""
    if last is None:
        return {}
    return {
        "last_strut": last.fault.actuator + 1,
        "last_kind": last.fault.kind,
        "last_kinds": " ".join(last.kinds),
        "last_effectiveness": last.fault.effectiveness,
        "kind_confidence": last.kind_confidence,
    }


def _after_ms(found: Identification, tick: int | None) -> float | None:
    return None if tick is None else 1e3 * exact_rig().period_s * (tick - found.struck[0])
