"""A flight in which something happens, as columns: against controllers that do nothing and know."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, get_args

import numpy as np

from experiments.recover.flight import Flight
from experiments.recover.pointing import error_columns, pointing_error_urad
from experiments.recover.recovery import Flight as AnyFlight
from experiments.recover.recovery import Identification, fault_unaware, informed, supervised
from experiments.rig.events import EVENTS
from experiments.rig.events.hooks import events_of
from experiments.rig.rig import Rig
from experiments.rig.run import Named, Run
from experiments.study.campaign import Row
from ftc.controller import Measurement
from ftc.fdi.fault_model import Fault
from ftc.oracle import OracleController, OracleState
from sim import Array, Failure, FailureKind, SimulationDiverged

COLUMNS: dict[str, tuple[str, ...]] = {
    "integers": ("withdrawn",),
    "words": ("event", "course", "said", "unaware_ended"),
    "numbers": (
        *("turn_s", "radius"),
        *(f"rms_{name}_since_urad" for name in ("supervised", "informed", "unaware")),
    ),
}
"""That only these flights have, by what they hold: `since` is from the event to the end, `said` the
status of the supervised controller."""


def event_columns(flight: Flight) -> Row:
    """A controller that diagnoses; one that does nothing; one that is told at once, if it can be.

    A controller whose flight ends early by an error or an infinite number has no errors; the row
    has the error's message.
    """
    rig, [event] = flight.rig(), flight.events
    struck = _struck(rig, flight)
    row = {
        "event": event.name,
        "course": flight.course.shape,
        "turn_s": flight.course.turn_s,
        "radius": flight.course.radius,
        "time_s": event.time_s,
        "strut": None if event.actuator is None else rig.number(event.actuator) + 1,
    }
    unaware, why = ended(lambda: doing_nothing(rig, flight))
    row["unaware_ended"] = why
    if unaware is not None:
        row |= _errors("unaware", unaware, struck)
    flown, why = ended(lambda: supervised(rig, flight))
    if flown is None:
        return row | {"status": "ended", "message": why}
    run, found = flown
    row |= supervised_columns(rig, flight, run, found)
    if event.name in get_args(FailureKind):
        failures = _failures(rig, flight)
        known = replace(flight, failures=tuple(failures), events=())
        fault = Fault.of(failures[0])
        stuck_m = float(run.displacement[struck, fault.actuator])
        row |= _errors("informed", informed(rig, known, fault, stuck_m), struck)
    return row


def supervised_columns(rig: Rig, flight: Flight, run: Run, found: Identification) -> Row:
    """What the row has of the controller that diagnoses."""
    struck, failures = _struck(rig, flight), _failures(rig, flight)
    row = _errors("supervised", run, struck) | named(rig, flight, failures, run, found, struck)
    return row | {"said": run.status}


def _struck(rig: Rig, flight: Flight) -> int:
    return round((flight.events[0].time_s - flight.begin_s) / rig.period_s)


def _failures(rig: Rig, flight: Flight) -> list[Failure]:
    return events_of(rig, flight.events, begin_s=flight.begin_s, seed=flight.seed)[1]


def named(
    rig: Rig,
    flight: AnyFlight,
    failures: list[Failure],
    run: Run,
    found: Identification,
    struck: int,
) -> Row:
    """What the diagnosis made of it: who was named, rightly or not, and what it said.

    An actuator is rightly named from its event on, if that is one that the names of a diagnosis can
    describe; every other actuator is sound.
    """
    [event] = flight.events
    kind = EVENTS[event.name]
    onset_s = event.time_s + kind.after_s
    failed = {rig.actuators[each.number] for each in failures}
    if kind.named_as and event.actuator is not None:
        failed.add(rig.actuators[rig.number(event.actuator)])

    def is_right(one: Named) -> bool:
        return one.actuator in failed and one.time_s >= onset_s - 1e-9

    since = [one for one in run.diagnoses if one.time_s >= onset_s - 1e-9]
    first = next(iter(since), None)
    standing = [one for one in since if one.withdrawn_s is None and is_right(one)]
    alarms = [tick for tick in found.alarm_ticks if tick >= struck]
    return {
        "alarms": len(found.alarm_ticks),
        "alarm_before": len(alarms) < len(found.alarm_ticks),
        "alarm_ms": 1e3 * rig.period_s * (alarms[0] - struck) if alarms else None,
        "named_ms": None if first is None else 1e3 * (first.time_s - onset_s),
        "first_strut": None if first is None else rig.number(first.actuator) + 1,
        "first_kind": None if first is None else first.kind,
        "strut_right": first is not None and is_right(first),
        "kind_right": any(one.kind in kind.named_as for one in standing),
        "cause_right": any(
            each.kind == kind.cause
            and (event.actuator is None or each.actuator == rig.number(event.actuator))
            for each in found.causes
            if each is not None
        ),
        "sound_named": not all(is_right(one) for one in run.diagnoses),
        "withdrawn": sum(one.withdrawn_s is not None for one in run.diagnoses),
        "unexplained": found.unexplained,
        "task_lost": found.task_lost,
        "closure_residual_max_m": found.closure_residual_max_m,
    }


def _errors(controller: str, run: Run, struck: int) -> Row:
    since = pointing_error_urad(run.desired, run.true)[struck:]
    whole = {f"rms_{controller}_since_urad": float(np.sqrt((since**2).mean()))}
    struck_s = struck * float(run.time_s[1] - run.time_s[0])
    return error_columns(controller, run, struck_s) | whole


def ended(fly: Callable[[], Any]) -> tuple[Any, str | None]:
    """What a flight gives; or nothing, and why it ended early: a finding, not the study's end."""
    try:
        return fly(), None
    except (ValueError, SimulationDiverged) as error:
        return None, f"{type(error).__name__}: {error}"


def doing_nothing(rig: Rig, flight: AnyFlight) -> Run:
    """The flight with a controller that holds its commands where a reading is no number."""
    return fault_unaware(rig, flight, Holding)


@dataclass(frozen=True)
class Holding(OracleController):
    """Controller that keeps its state at a tick without a finite reading."""

    def step(
        self,
        state: OracleState,
        reference: Array,
        measurement: Measurement,
        *,
        feedforward: Array | None = None,
    ) -> OracleState:
        """One control tick."""
        if not np.isfinite(measurement.output).all():
            return replace(state, ticks=state.ticks + 1)
        return super().step(state, reference, measurement, feedforward=feedforward)
