"""A case as a row: what was drawn, what the diagnosis made of it, and the controllers' errors."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pyarrow as pa

from experiments.recover.plan import Case
from experiments.recover.predictions import ISOLABLE, separations
from experiments.recover.simulate import (
    SPANS,
    attempted,
    caused,
    errors,
    informed,
    is_lost,
    other,
    supervised,
    tick_at,
    unaware,
)
from experiments.rig.events import EVENTS
from experiments.rig.rig import Rig
from experiments.rig.run import Run
from experiments.study.campaign import Row
from experiments.study.study import WrongInput
from ftc.fdi.diagnosis import Diagnosis
from ftc.fdi.fault_model import Fault
from ftc.fdi.isolation.causes import Cause
from sim import Failure

CONTROLLERS = ("supervised", "informed", "unaware")

_INTEGERS = ("case", "draw", "plant_seed", "seed", "alarms", "withdrawn")
_WORDS = (
    *("sort", "sense", "mismatch", "course", "event", "actuator", "kind"),
    *("second_actuator", "second_kind", "status", "message", "report"),
    *("informed_ended", "unaware_ended"),
    *("first_actuator", "first_kind", "last_kind", "last_kinds"),
)
_SWITCHES = (
    *("isolable", "alarm_before", "right", "kind_right", "all_right", "healthy_named"),
    *("unexplained", "task_lost", "lost_rightly", "commands_changed"),
)
_NUMBERS = (
    *("factor", "begin_s", "duration_s", "turn_s", "radius", "time_s", "effectiveness"),
    *("second_time_s", "second_effectiveness", "separation_from_others", "separation_from_kinds"),
    *("alarm_s", "named_s", "last_effectiveness", "kind_confidence", "closure_residual_max_m"),
    *(f"{what}_{c}_{span}" for c in CONTROLLERS for span in SPANS for what in ("rms", "peak")),
)
_TYPES = {pa.int64(): _INTEGERS, pa.string(): _WORDS, pa.bool_(): _SWITCHES}
_TYPES |= {pa.float64(): _NUMBERS}
SCHEMA = pa.schema([(name, kind) for kind, names in _TYPES.items() for name in names])
"""Columns of the study's dataset: `alarm_s` and `named_s` from the failure or event on, errors of
all major rows together in sizes of the path."""


def row_of(case: Case) -> Row:
    """The row of a case, which is simulated here.

    Its status is "flown"; "ended" where the supervised controller's run ends by an error or an
    infinite number, which `message` has; or "refused", if the robot cannot have the event.
    """
    row, rig = case.parameters(), case.rig()
    try:
        failures = caused(rig, case)
    except WrongInput as refused:
        return row | {"status": "refused", "message": str(refused)}
    run, why = attempted(lambda: supervised(rig, case))
    row |= {"status": "ended", "message": why}
    beside = {"unaware": lambda: unaware(rig, case)} if "unaware" in case.compared else {}
    if run is not None:
        row |= supervised_columns(rig, case, run) | {"status": "flown"}
        if "informed" in case.compared and not row["lost_rightly"]:
            beside["informed"] = lambda: _informed(rig, case, failures, run)
        if case.sort == "healthy":
            # Whether alarms changed a command is found by a run without a diagnosis.
            without = unaware(rig, case) if row["alarms"] else run
            row["commands_changed"] = not np.array_equal(run.inputs, without.inputs)
    for controller, simulate in beside.items():
        theirs, row[f"{controller}_ended"] = attempted(simulate)
        row |= {} if theirs is None else errors(rig, case, theirs, controller)
    if case.model is None and case.sort == "failure" and case.mismatch in ("exact", "all"):
        others, kinds = separations(case)
        row |= {"separation_from_others": others, "separation_from_kinds": kinds}
        row["isolable"] = others >= ISOLABLE
    return row


def _informed(rig: Rig, case: Case, failures: tuple[Failure, ...], run: Run) -> Run:
    """The run with a controller that is informed of the first failure at once."""
    fault, tick = Fault.of(failures[0]), tick_at(rig, case, case.happens_s)
    stood = float(run.displacement[tick, fault.actuator])
    return informed(rig, replace(case, failures=failures, events=()), fault, stood)


def other_columns(case: Case, controller: str) -> Row:
    """Errors of somebody else's controller in a case; beside the dataset.

    Only in the main thread of a process, where a controller that takes too long can be stopped.
    """
    rig = case.rig()
    run, failed = other(rig, case, controller)
    return errors(rig, case, run, "other") | {"case": case.number, "controller_failure": failed}


def supervised_columns(rig: Rig, case: Case, run: Run) -> Row:
    """Columns of the supervised controller: errors, alarms, who was named, and what it reported.

    An actuator is rightly named from its failure or event on, if the names of a diagnosis can
    describe that; every other actuator is healthy. `right` is whether the first one named since
    then is, or, where none can be, whether the cause is; None: nothing can rightly be named.
    """
    state, failures, period_s = run.state, caused(rig, case), rig.period_s
    tick, expected = tick_at(rig, case, case.happens_s), _expected(rig, case, failures)
    onset = min((since for since, _ in expected.values()), default=tick)
    named = [(each, tick_at(rig, case, each.time_s)) for each in run.diagnoses]
    are_right = [
        each.actuator in expected and at >= expected[each.actuator][0] for each, at in named
    ]
    first = next((k for k, (_, at) in enumerate(named) if at >= onset), None)
    alarms = [each for each in state.watch.alarm_ticks if each >= tick]
    standing = {rig.actuators[each.fault.actuator]: each for each in state.standing}
    last = next(((name, standing[name]) for name in expected if name in standing), None)
    row: Row = {
        "alarms": len(state.watch.alarm_ticks),
        "alarm_before": len(alarms) < len(state.watch.alarm_ticks),
        "alarm_s": (alarms[0] - tick) * period_s if alarms else None,
        "right": _is_cause(rig, case, state.watch.causes),
        "healthy_named": not all(are_right),
        "withdrawn": sum(each.withdrawn_s is not None for each in run.diagnoses),
        "unexplained": state.watch.unexplained,
        "task_lost": run.task_lost,
        "lost_rightly": bool(failures) and is_lost(rig, failures),
        "report": run.status,
        "closure_residual_max_m": run.closure_max_m,
    }
    if first is not None:
        diagnosis, at = named[first]
        row |= {"named_s": (at - onset) * period_s, "first_kind": diagnosis.kind}
        row["first_actuator"] = diagnosis.actuator
    if expected:
        row["right"] = first is not None and are_right[first]
        row["kind_right"] = last is not None and _is_kind(expected, *last)
    if last is not None:
        _, diagnosis = last
        row |= {"last_kind": diagnosis.fault.kind, "last_kinds": " ".join(diagnosis.kinds)}
        row["last_effectiveness"] = diagnosis.fault.effectiveness
        row["kind_confidence"] = diagnosis.kind_confidence
    if case.failures:
        found = [_is_kind(expected, *each) for each in standing.items()]
        identified = standing.keys() == expected.keys() and all(found)
        row["all_right"] = identified and run.task_lost == row["lost_rightly"]
    return row | errors(rig, case, run, "supervised")


Expected = dict[str, tuple[int, tuple[str, ...]]]


def _expected(rig: Rig, case: Case, failures: tuple[Failure, ...]) -> Expected:
    """Actuators that may rightly be named, from which tick on, and as which kinds."""
    expected: Expected = {
        rig.actuators[each.number]: (tick_at(rig, case, each.time_s), (each.kind,))
        for each in failures
    }
    if not case.events:
        return expected
    [event] = case.events
    kind = EVENTS[event.name]
    onset = tick_at(rig, case, event.time_s + kind.after_s)
    if kind.named_as and event.actuator is not None:
        expected[rig.actuators[rig.number(event.actuator)]] = onset, kind.named_as
    return dict.fromkeys(expected, (onset, kind.named_as))


def _is_kind(expected: Expected, actuator: str, found: Diagnosis) -> bool:
    """Whether a diagnosis has the kind of a failure, or does not tell it apart from its own."""
    return actuator in expected and not {*expected[actuator][1]}.isdisjoint(found.kinds)


def _is_cause(rig: Rig, case: Case, causes: Sequence[Cause | None]) -> bool | None:
    """Whether what is no failure was rightly explained; None: there is nothing to explain."""
    if not case.events or (kind := case.events[0].kind).cause is None:
        return None
    actuator = case.events[0].actuator
    own = None if actuator is None else rig.number(actuator)
    found = [each for each in causes if each is not None and each.kind == kind.cause]
    return any(own is None or each.actuator == own for each in found)
