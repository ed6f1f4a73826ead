"""A case as a row: what was drawn, what the diagnosis made of it, and the controllers' errors."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from experiments.recover.plan import Case, about, around, exact_rig
from experiments.recover.predictions import ISOLABLE, separations
from experiments.study import Row
from fjh.rig.events import EVENTS
from fjh.rig.events.hooks import events_of
from fjh.rig.hexapod.fault_tolerance import STILL, fault_text
from fjh.rig.other_controller import simulate_with
from fjh.rig.rig import Rig
from fjh.rig.run import Run, tick_of
from fjh.study.errors import WrongInput
from ftc import Measurement, NestedState, OracleController, goal_after, is_possible
from ftc.fdi import Cause, Diagnosis, Fault, static_share
from sim import Array, Failure, SimulationDiverged

CONTROLLERS = ("supervised", "informed", "unaware")
SPANS = ("before", "during", "after", "since")
"""Of a run: before what happens, from then until recovery, from recovery on; and both of these."""

COLUMNS = [
    *("case", "sort", "sense", "draw", "mismatch", "factor", "plant_seed", "seed"),
    *("begin_s", "duration_s", "course", "turn_s", "radius"),
    *("event", "actuator", "kind", "effectiveness", "time_s"),
    *("second_actuator", "second_kind", "second_effectiveness", "second_time_s"),
    *("isolable", "separation_from_others", "separation_from_kinds"),
    *("status", "message", "informed_ended", "unaware_ended"),
    *("alarms", "alarm_before", "alarm_s", "named_s", "first_actuator", "first_kind"),
    *("last_kind", "last_kinds", "last_effectiveness", "kind_confidence"),
    *("right", "kind_right", "all_right", "healthy_named", "withdrawn", "unexplained"),
    *("task_lost", "lost_rightly", "commands_changed", "report", "closure_residual_max_m"),
    *(f"{what}_{c}_{span}" for c in CONTROLLERS for span in SPANS for what in ("rms", "peak")),
]
"""Of the dataset: `alarm_s` and `named_s` from the failure or event on, errors of all major rows
together in sizes of the path."""


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
            fault, tick = Fault.of(failures[0]), tick_at(rig, case, case.happens_s)
            told = replace(case, failures=failures, events=())
            stood = float(run.displacement[tick, fault.actuator])
            beside["informed"] = lambda: informed(rig, told, fault, stood)
        if case.sort == "healthy":
            # Whether alarms changed a command is found by a run without a diagnosis.
            without = unaware(rig, case) if row["alarms"] else run
            row["commands_changed"] = not np.array_equal(run.inputs, without.inputs)
    for controller, simulate in beside.items():
        theirs, row[f"{controller}_ended"] = attempted(simulate)
        row |= {} if theirs is None else errors(rig, case, theirs, controller)
    if case.controller is not None:
        row |= fly_other(case, case.controller)[0]
    if case.model is None and case.sort == "failure" and case.mismatch in ("exact", "all"):
        others, kinds = separations(case)
        row |= {"separation_from_others": others, "separation_from_kinds": kinds}
        row["isolable"] = others >= ISOLABLE
    return row


def fly(case: Case) -> tuple[Row, Run]:
    """The supervised controller's columns of a row, and its run."""
    rig = case.rig()
    run = supervised(rig, case)
    return supervised_columns(rig, case, run), run


def fly_other(case: Case, controller: str) -> tuple[Row, Run]:
    """Errors of somebody else's controller in a case, a sentence if it failed, and its run.

    Only in the main thread of a process, where a controller that takes too long can be stopped.
    """
    rig = case.rig()
    run, failure = simulate_with(rig, controller, case.path(rig), **_how(case))
    return errors(rig, case, run, "other") | {"controller_failure": failure}, run


# What a diagnosis is worth.


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
    alarms = [each for each in state.monitor_state.alarm_ticks if each >= tick]
    standing = {rig.actuators[each.fault.actuator]: each for each in state.active_diagnoses}
    last = next(((name, standing[name]) for name in expected if name in standing), None)
    row: Row = {
        "alarms": len(state.monitor_state.alarm_ticks),
        "alarm_before": len(alarms) < len(state.monitor_state.alarm_ticks),
        "alarm_s": (alarms[0] - tick) * period_s if alarms else None,
        "right": _is_cause(rig, case, state.monitor_state.causes),
        "healthy_named": not all(are_right),
        "withdrawn": sum(each.withdrawn_s is not None for each in run.diagnoses),
        "unexplained": state.monitor_state.unexplained,
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
    if kind.correct_kinds and event.actuator is not None:
        expected[rig.actuators[rig.number(event.actuator)]] = onset, kind.correct_kinds
    return dict.fromkeys(expected, (onset, kind.correct_kinds))


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


# Runs.


@dataclass(frozen=True)
class Holding(OracleController):
    """Controller that keeps its state at a tick without a finite reading."""

    def step(
        self,
        state: NestedState,
        reference: Array,
        measurement: Measurement,
        *,
        feedforward: Array | None = None,
    ) -> NestedState:
        """One control tick."""
        if not np.isfinite(measurement.output).all():
            return replace(state, ticks=state.ticks + 1)
        return super().step(state, reference, measurement, feedforward=feedforward)


def supervised(rig: Rig, case: Case) -> Run:
    """The run with a controller that diagnoses."""
    return _run(rig, case, rig.supervisor(case.dither))


def unaware(rig: Rig, case: Case) -> Run:
    """The run with a controller that goes on as if nothing had happened."""
    controller, secondary = rig.controller(), None if case.dither is None else case.dither.at
    return _run(rig, case, Holding(controller, controller, None, secondary=secondary))


def informed(rig: Rig, case: Case, fault: Fault, displacement: float, late_s: float = 0.0) -> Run:
    """The run with a controller that is informed of a fault so long after what happens.

    `displacement` is where that actuator stood when it failed, with any controller.
    """
    n, share = len(rig.actuators), static_share(rig.nominal, fault)
    lost, acting = np.zeros(n), np.zeros(n)
    acting[fault.actuator] = share
    if fault.kind != "locked" and late_s == 0:
        lost[fault.actuator] = (1 - share) * displacement
    news = Diagnosis.known(fault, displacement)
    after = rig.controller(goal_after(rig.goal, [news], rig.nominal, rig.unused))
    tick = tick_at(rig, case, case.happens_s) + round(late_s / rig.period_s)
    secondary = None if case.dither is None else case.dither.at
    return _run(rig, case, OracleController(rig.controller(), after, tick, lost, secondary, acting))


def _run(rig: Rig, case: Case, controller: Any) -> Run:
    return rig.fly(controller, case.path(rig), events=case.events or None, **_how(case))


def _how(case: Case) -> dict[str, Any]:
    return {"failures": case.failures, "seed": case.seed, "begin_s": case.begin_s}


def attempted(run: Callable[[], Run]) -> tuple[Run | None, str | None]:
    """A run; or nothing, and why it ended early: that is a result, not the end of the study."""
    try:
        return run(), None
    except (ValueError, SimulationDiverged) as error:
        return None, f"{type(error).__name__}: {error}"


def caused(rig: Rig, case: Case) -> tuple[Failure, ...]:
    """All failures of a case, those that events bring included.

    Raises:
        WrongInput: The robot cannot have such an event.
    """
    _, of_events = events_of(rig, case.events, begin_s=case.begin_s, seed=case.seed)
    return (*case.failures, *of_events)


def is_lost(rig: Rig, failures: tuple[Failure, ...]) -> bool:
    """Whether the actuators that are left cannot do the major task, by the failure atlas."""
    return not is_possible(rig.classified([Fault.of(each) for each in failures]))


def tick_at(rig: Rig, case: Case, time_s: float) -> int:
    """The first tick of a run from a time on; one beyond its last if that is infinite."""
    return tick_of(min(time_s - case.begin_s, case.duration_s), rig.period_s)


def distance(rig: Rig, run: Run) -> Array:
    """Size of desired minus true displacements of all major rows, in sizes of the path, (N,)."""
    return np.linalg.norm(run.error, axis=1) / rig.size


def errors(rig: Rig, case: Case, run: Run, controller: str) -> Row:
    """RMS and peak error in each span, in sizes of the path, as columns of a controller."""
    begin, recovers = (round(s / rig.period_s) for s in (case.transient_s, case.recovered_s))
    tick, error = tick_at(rig, case, case.happens_s), distance(rig, run)
    ends = (begin, tick), (tick, tick + recovers), (tick + recovers, None), (tick, None)
    row: Row = {}
    for span, (first, last) in zip(SPANS, ends, strict=True):
        if len(part := error[first:last]):
            row[f"rms_{controller}_{span}"] = float(np.sqrt((part**2).mean()))
            row[f"peak_{controller}_{span}"] = float(part.max())
    return row


# Beside the rows.

LATE_S = (0.03, 0.1, 0.3, 1.0)
INFORMED_LATE = (
    Failure(0, "locked", 8.25),
    Failure(0, "free", 8.25),
    Failure(0, "weak", 8.25, effectiveness=1.0),
)
"""Of these a controller is informed so late, or wrongly; the last is no failure at all."""


def informed_late(failure: Failure) -> list[Row]:
    """Rows of a controller that is told the truth, ever later; then, that another strut locked.

    The struts stand without a secondary displacement; errors in sizes of the path.
    """
    case = around(Case("failure", mismatch="exact", dither=about(0.0), failures=(failure,)))
    rig, truth = exact_rig(), Fault.of(failure)
    run, tick = unaware(rig, case), tick_at(rig, case, case.happens_s)
    nothing = errors(rig, case, run, "told_nothing")["rms_told_nothing_after"]
    news = [(truth, late_s) for late_s in LATE_S]
    news += [(Fault(k, "locked"), 0.0) for k in range(6) if k != truth.actuator]
    rows = []
    for fault, late_s in news:
        stood = float(run.displacement[tick, fault.actuator])
        found = errors(rig, case, informed(rig, case, fault, stood, late_s), "told")
        row = {"truth": fault_text(None if truth.is_healthy else truth), "told": fault_text(fault)}
        row |= {"late_s": late_s, "rms_told_nothing_after": nothing}
        kept = ("peak_told_during", "rms_told_after", "peak_told_after")
        rows.append(row | {key: found[key] for key in kept})
    return rows


def dither_cost(case: Case, duration_s: float) -> list[Row]:
    """A row for each major row: its RMS error without failures, and changes by dither and by seed.

    On the exact plant. `moved` is how far the dither moves all major rows together on a plant that
    is not the model: there the actuators do not cancel. In sizes of the path.
    """
    rig, mixed = exact_rig(), exact_rig().with_mismatch("all", case.plant_seed)
    case = replace(case, begin_s=0.0, duration_s=duration_s, failures=())
    still = replace(case, dither=replace(case.dither or STILL, amplitude=0.0))
    quiet, moved = (unaware(mixed, each) for each in (still, case))
    alone, swinging, reseeded = (
        unaware(rig, each).rms() / rig.size
        for each in (still, case, replace(still, seed=case.seed + 1))
    )
    apart = distance(rig, replace(quiet, desired=moved.true))
    found = {"rms": alone, "change": swinging - alone, "reseeded": reseeded - alone}
    found["moved"] = np.full(len(alone), np.sqrt((apart**2).mean()))
    return [
        {"row": row} | {key: float(values[k]) for key, values in found.items()}
        for k, row in enumerate(rig.major)
    ]
