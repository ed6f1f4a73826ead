"""Simulation of a case, with its row: parameters, diagnosis, errors by controller."""

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
"""Parts of a run: before onset, from onset to recovery, after recovery, and since onset."""

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
"""Columns of the dataset. `alarm_s` and `named_s` (time of identification) are relative to the
onset; errors of all major rows together are in sizes of the path."""


def row_of(case: Case) -> Row:
    """Simulate a case; return its row.

    The status is "flown" (completed); "ended", if the run of the supervised controller ends by the
    error in `message`; or "refused", if the robot cannot have the event.
    """
    row, rig = case.parameters(), case.rig()
    try:
        failures = all_failures(rig, case)
    except WrongInput as error:
        return row | {"status": "refused", "message": str(error)}
    run, reason = attempt(lambda: simulate_supervised(rig, case))
    row |= {"status": "ended", "message": reason}
    simulations = (
        {"unaware": lambda: simulate_undiagnosed(rig, case)} if "unaware" in case.compared else {}
    )
    if run is not None:
        row |= supervised_columns(rig, case, run) | {"status": "flown"}
        if "informed" in case.compared and not row["lost_rightly"]:
            fault, tick = Fault.of(failures[0]), tick_at(rig, case, case.onset_s)
            informed_case = replace(case, failures=failures, events=())
            position = float(run.displacement[tick, fault.actuator])
            simulations["informed"] = lambda: simulate_informed(rig, informed_case, fault, position)
        if case.sort == "healthy":
            # A run without diagnosis shows whether alarms changed a command.
            undiagnosed_run = simulate_undiagnosed(rig, case) if row["alarms"] else run
            row["commands_changed"] = not np.array_equal(run.inputs, undiagnosed_run.inputs)
    for controller, simulation in simulations.items():
        other_run, row[f"{controller}_ended"] = attempt(simulation)
        row |= {} if other_run is None else errors(rig, case, other_run, controller)
    if case.controller is not None:
        row |= simulate_other(case, case.controller)[0]
    if case.model is None and case.sort == "failure" and case.mismatch in ("exact", "all"):
        others, kinds = separations(case)
        row |= {"separation_from_others": others, "separation_from_kinds": kinds}
        row["isolable"] = others >= ISOLABLE
    return row


def simulate(case: Case) -> tuple[Row, Run]:
    """Simulate the supervised controller; return its columns of the row, and the run."""
    rig = case.rig()
    run = simulate_supervised(rig, case)
    return supervised_columns(rig, case, run), run


def simulate_other(case: Case, controller: str) -> tuple[Row, Run]:
    """Simulate another controller; return its errors (and failure, if any), and the run.

    Call this in the main thread of a process, where a slow controller can be stopped.
    """
    rig = case.rig()
    run, failure = simulate_with(rig, controller, case.path(rig), **_run_arguments(case))
    return errors(rig, case, run, "other") | {"controller_failure": failure}, run


# Evaluation of the diagnosis.


def supervised_columns(rig: Rig, case: Case, run: Run) -> Row:
    """Return the columns of the supervised controller: errors, alarms, diagnoses.

    Correct diagnoses are those of actuators since their failure or event, if diagnoses can describe
    it. `right` is whether the first actuator identified since onset is correct or, for events
    without a failed actuator, whether the cause is; None without diagnosis.
    """
    state, failures, period_s = run.state, all_failures(rig, case), rig.period_s
    faults = [Fault.of(failure) for failure in failures]
    tick, expected = tick_at(rig, case, case.onset_s), _expected(rig, case, failures)
    onset = min((since for since, _ in expected.values()), default=tick)
    isolated = [(item, tick_at(rig, case, item.time_s)) for item in run.diagnoses]
    are_right = [
        item.actuator in expected and at >= expected[item.actuator][0] for item, at in isolated
    ]
    first = next((k for k, (_, at) in enumerate(isolated) if at >= onset), None)
    alarms = [alarm for alarm in state.monitor_state.alarm_ticks if alarm >= tick]
    active = {rig.actuators[one.fault.actuator]: one for one in state.active_diagnoses}
    last = next(((name, active[name]) for name in expected if name in active), None)
    row: Row = {
        "alarms": len(state.monitor_state.alarm_ticks),
        "alarm_before": len(alarms) < len(state.monitor_state.alarm_ticks),
        "alarm_s": (alarms[0] - tick) * period_s if alarms else None,
        "right": _is_cause(rig, case, state.monitor_state.causes),
        "healthy_named": not all(are_right),
        "withdrawn": sum(diagnosis.withdrawn_s is not None for diagnosis in run.diagnoses),
        "unexplained": state.monitor_state.unexplained,
        "task_lost": run.task_lost,
        "lost_rightly": bool(failures) and not is_possible(rig.classified(faults)),
        "report": run.status,
        "closure_residual_max_m": run.closure_max_m,
    }
    if first is not None:
        diagnosis, at = isolated[first]
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
        kinds_match = [_is_kind(expected, *item) for item in active.items()]
        identified = active.keys() == expected.keys() and all(kinds_match)
        row["all_right"] = identified and run.task_lost == row["lost_rightly"]
    return row | errors(rig, case, run, "supervised")


Expected = dict[str, tuple[int, tuple[str, ...]]]


def _expected(rig: Rig, case: Case, failures: tuple[Failure, ...]) -> Expected:
    """Return the actuators that may be correctly diagnosed, with first tick and kinds."""
    expected: Expected = {
        rig.actuators[failure.number]: (tick_at(rig, case, failure.time_s), (failure.kind,))
        for failure in failures
    }
    if not case.events:
        return expected
    [event] = case.events
    kind = EVENTS[event.name]
    onset = tick_at(rig, case, event.time_s + kind.after_s)
    if kind.correct_kinds and event.actuator is not None:
        expected[rig.actuators[rig.number(event.actuator)]] = onset, kind.correct_kinds
    return dict.fromkeys(expected, (onset, kind.correct_kinds))


def _is_kind(expected: Expected, actuator: str, diagnosis: Diagnosis) -> bool:
    """Return whether the kind of a diagnosis is correct for its actuator."""
    return actuator in expected and not {*expected[actuator][1]}.isdisjoint(diagnosis.kinds)


def _is_cause(rig: Rig, case: Case, causes: Sequence[Cause | None]) -> bool | None:
    """Return whether the cause of an event without failure was identified; else None."""
    if not case.events or (kind := case.events[0].kind).cause is None:
        return None
    actuator = case.events[0].actuator
    number = None if actuator is None else rig.number(actuator)
    matches = [cause for cause in causes if cause is not None and cause.kind == kind.cause]
    return any(number is None or cause.actuator == number for cause in matches)


# Runs.


@dataclass(frozen=True)
class HoldingController(OracleController):
    """Controller that keeps its state at ticks without a finite reading."""

    def step(
        self,
        state: NestedState,
        reference: Array,
        measurement: Measurement,
        *,
        feedforward: Array | None = None,
    ) -> NestedState:
        """Perform one control tick."""
        if not np.isfinite(measurement.output).all():
            return replace(state, ticks=state.ticks + 1)
        return super().step(state, reference, measurement, feedforward=feedforward)


def simulate_supervised(rig: Rig, case: Case) -> Run:
    """Simulate a case with the supervisor."""
    return _run(rig, case, rig.supervisor(case.dither))


def simulate_undiagnosed(rig: Rig, case: Case) -> Run:
    """Simulate a case with a controller without diagnosis."""
    controller, secondary = rig.controller(), None if case.dither is None else case.dither.at
    return _run(rig, case, HoldingController(controller, controller, None, secondary=secondary))


def simulate_informed(
    rig: Rig, case: Case, fault: Fault, displacement: float, late_s: float = 0.0
) -> Run:
    """Simulate a case with a controller informed of a fault `late_s` after the onset.

    `displacement` is that of the actuator at its failure.
    """
    n, share = len(rig.actuators), static_share(rig.nominal, fault)
    lost, acting = np.zeros(n), np.zeros(n)
    acting[fault.actuator] = share
    if fault.kind != "locked" and late_s == 0:
        lost[fault.actuator] = (1 - share) * displacement
    diagnosis = Diagnosis.known(fault, displacement)
    after = rig.controller(goal_after(rig.goal, [diagnosis], rig.nominal, rig.unused))
    tick = tick_at(rig, case, case.onset_s) + round(late_s / rig.period_s)
    secondary = None if case.dither is None else case.dither.at
    return _run(rig, case, OracleController(rig.controller(), after, tick, lost, secondary, acting))


def _run(rig: Rig, case: Case, controller: Any) -> Run:
    return rig.fly(controller, case.path(rig), events=case.events or None, **_run_arguments(case))


def _run_arguments(case: Case) -> dict[str, Any]:
    return {"failures": case.failures, "seed": case.seed, "begin_s": case.begin_s}


def attempt(run: Callable[[], Run]) -> tuple[Run | None, str | None]:
    """Return a run and None, or None and the reason why it ended early."""
    try:
        return run(), None
    except (ValueError, SimulationDiverged) as error:
        return None, f"{type(error).__name__}: {error}"


def all_failures(rig: Rig, case: Case) -> tuple[Failure, ...]:
    """Return all failures of a case, including those caused by events.

    Raises:
        WrongInput: The robot cannot have such an event.
    """
    _, of_events = events_of(rig, case.events, begin_s=case.begin_s, seed=case.seed)
    return (*case.failures, *of_events)


def tick_at(rig: Rig, case: Case, time_s: float) -> int:
    """Return the first tick at or after a time; the number of ticks for later times."""
    return tick_of(min(time_s - case.begin_s, case.duration_s), rig.period_s)


def distance(rig: Rig, run: Run) -> Array:
    """Return the norm of desired minus true major displacements, in sizes of the path, (N,)."""
    return np.linalg.norm(run.error, axis=1) / rig.size


def errors(rig: Rig, case: Case, run: Run, controller: str) -> Row:
    """Return the columns of a controller: RMS and peak error in each span, in sizes of the path."""
    start, recovers = (round(s / rig.period_s) for s in (case.transient_s, case.recovered_s))
    tick, error = tick_at(rig, case, case.onset_s), distance(rig, run)
    ends = (start, tick), (tick, tick + recovers), (tick + recovers, None), (tick, None)
    row: Row = {}
    for span, (first, last) in zip(SPANS, ends, strict=True):
        if len(part := error[first:last]):
            row[f"rms_{controller}_{span}"] = float(np.sqrt((part**2).mean()))
            row[f"peak_{controller}_{span}"] = float(part.max())
    return row


# Additional analyses.

LATE_S = (0.03, 0.1, 0.3, 1.0)
LATE_FAILURES = (
    Failure(0, "locked", 8.25),
    Failure(0, "free", 8.25),
    Failure(0, "weak", 8.25, effectiveness=1.0),
)
"""Failures of which a controller is informed late or incorrectly; the last one has no effect."""


def informed_late(failure: Failure) -> list[Row]:
    """Return rows of controllers that are informed late, or of a lock of another strut.

    The posture is nominal; errors are in sizes of the path.
    """
    case = around(Case("failure", mismatch="exact", dither=about(0.0), failures=(failure,)))
    rig, truth = exact_rig(), Fault.of(failure)
    run, tick = simulate_undiagnosed(rig, case), tick_at(rig, case, case.onset_s)
    uninformed = errors(rig, case, run, "told_nothing")["rms_told_nothing_after"]
    informed_of = [(truth, late_s) for late_s in LATE_S]
    informed_of += [(Fault(k, "locked"), 0.0) for k in range(6) if k != truth.actuator]
    rows = []
    for fault, late_s in informed_of:
        position = float(run.displacement[tick, fault.actuator])
        informed_run = simulate_informed(rig, case, fault, position, late_s)
        measures = errors(rig, case, informed_run, "told")
        row = {"truth": fault_text(None if truth.is_healthy else truth), "told": fault_text(fault)}
        row |= {"late_s": late_s, "rms_told_nothing_after": uninformed}
        columns = ("peak_told_during", "rms_told_after", "peak_told_after")
        rows.append(row | {key: measures[key] for key in columns})
    return rows


def dither_cost(case: Case, duration_s: float) -> list[Row]:
    """Return each major row's RMS error without failures, and its changes by dither and by seed.

    The plant is exact, except for `moved`: the motion of all major rows by the dither on a plant
    with all mismatches, where the actuators' effects do not cancel. Units are sizes of the path.
    """
    rig, mixed = exact_rig(), exact_rig().with_mismatch("all", case.plant_seed)
    case = replace(case, begin_s=0.0, duration_s=duration_s, failures=())
    still = replace(case, dither=replace(case.dither or STILL, amplitude=0.0))
    quiet, moved = (simulate_undiagnosed(mixed, run_case) for run_case in (still, case))
    alone, dithered, reseeded = (
        simulate_undiagnosed(rig, run_case).rms() / rig.size
        for run_case in (still, case, replace(still, seed=case.seed + 1))
    )
    path_change = distance(rig, replace(quiet, desired=moved.true))
    measures = {"rms": alone, "change": dithered - alone, "reseeded": reseeded - alone}
    measures["moved"] = np.full(len(alone), np.sqrt((path_change**2).mean()))
    return [
        {"row": row} | {key: float(values[k]) for key, values in measures.items()}
        for k, row in enumerate(rig.major)
    ]
