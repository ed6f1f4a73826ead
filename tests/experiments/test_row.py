"""Tests of the rows of `fjh paper recover`: status, diagnoses and errors."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from experiments.recover import plan
from experiments.recover import row as rows
from experiments.recover.plan import Case, exact_rig
from fjh.rig.events import Event
from fjh.rig.run import DiagnosedFailure
from ftc import Measurement
from ftc.fdi import Cause, Diagnosis, Fault
from sim import Failure, SimulationDiverged


def test_a_run_that_ends_early_is_a_row(monkeypatch):
    def fails(*_arguments):
        raise ValueError("no such number")

    def diverges(*_arguments):
        raise SimulationDiverged(0.03, np.zeros(3))

    monkeypatch.setattr(rows, "simulate_supervised", fails)
    monkeypatch.setattr(rows, "simulate_undiagnosed", diverges)
    row = rows.row_of(plan.hexapod_events(["locked"], 1, 2.0, 0)[1])
    assert row["status"] == "ended" and row["message"] == "ValueError: no such number"
    assert "non-finite" in row["unaware_ended"] and set(row) <= set(rows.COLUMNS)
    assert row["actuator"] == "strut1" and "rms_unaware_since" not in row


@pytest.mark.long
@pytest.mark.parametrize(("seed", "index"), [(0, 3), (0, 288), (1, 27)])
def test_a_lock_is_not_confused_with_the_opposite_strut_or_the_floor(seed, index):
    """Hysteresis, dampers and the floor are similar to it in half a period of the dither."""
    case = plan.hexapod_failures([("failure", "all", 1.0, index + 1)], 0, 0.1, seed)[index]
    assert rows.tick_at(exact_rig(), case, case.onset_s) == round(1e3 * plan.BEFORE_S)
    row, _ = rows.simulate(case)
    assert row["right"] and not row["healthy_named"] and not row["alarm_before"]


@pytest.mark.long
def test_any_change_of_commands_by_an_alarm_is_reported(monkeypatch):
    """The supervised controller without an alarm sends the commands of one without diagnosis."""
    [case] = plan.hexapod_failures([], 1, 0.1, 0)
    run = rows.simulate_supervised(case.rig(), case)
    assert run.state.monitor_state.alarm_ticks == ()
    np.testing.assert_array_equal(run.inputs, rows.simulate_undiagnosed(case.rig(), case).inputs)
    monitor_state = replace(run.state.monitor_state, alarm_ticks=(5,))
    state = replace(run.state, monitor_state=monitor_state)
    alarmed = replace(run, inputs=run.inputs + 1e-12, state=state)
    monkeypatch.setattr(rows, "simulate_supervised", lambda *_: alarmed)
    assert rows.row_of(case)["commands_changed"]


def test_a_controller_without_diagnosis_keeps_its_commands_on_nan():
    controller = exact_rig().controller()
    holding = rows.HoldingController(controller, controller, None)
    state = holding.step(holding.start(), np.full(2, 1e-6), Measurement(np.zeros(2), np.zeros(6)))
    state_after = holding.step(
        state, np.full(2, 1e-6), Measurement(np.array([np.nan, 0]), np.zeros(6))
    )
    assert state_after.ticks == 2 and state_after.controller is state.controller


def columns_of(
    *isolated: tuple[int, Any, int],
    withdrawn_s: float | None = None,
    causes: tuple[Cause | None, ...] = (),
    **case: Any,
) -> dict:
    """Return the columns of a run of 5 s with these diagnoses, 10 ms after their alarms."""
    faults = {strut: Fault(strut, kind) for strut, kind, _ in isolated if withdrawn_s is None}
    alarms = tuple(tick - 10 for _, _, tick in isolated)
    monitor_state = SimpleNamespace(alarm_ticks=alarms, causes=causes, unexplained=False)
    run: Any = SimpleNamespace(
        diagnoses=[
            DiagnosedFailure(f"strut{k + 1}", kind, t / 1e3, withdrawn_s) for k, kind, t in isolated
        ],
        state=SimpleNamespace(
            monitor_state=monitor_state,
            active_diagnoses=list(map(Diagnosis.known, faults.values())),
        ),
        task_lost=False,
        status="",
        closure_max_m=0.0,
        error=np.zeros((5000, 2)),
    )
    own = Case(case.pop("sort", "event"), duration_s=5.0, **case)
    return rows.supervised_columns(exact_rig(), own, run)


@pytest.mark.parametrize(
    ("isolated", "right", "healthy_named", "all_right"),
    [
        ([(0, "locked", 2010), (4, "free", 3010)], True, False, True),
        ([(0, "free", 2010), (4, "free", 3010)], True, False, False),
        ([(4, "free", 2010), (0, "locked", 2020), (4, "free", 3010)], False, True, True),
        ([(3, "locked", 1999), (0, "locked", 2010), (4, "free", 3010)], True, True, False),
        ([], False, False, False),
    ],
)
def test_an_actuator_is_correctly_identified_only_after_its_failure(
    isolated, right, healthy_named, all_right
):
    pair = (Failure(0, "locked", 2.0), Failure(4, "free", 3.0))
    columns = columns_of(*isolated, sort="pair", failures=pair)
    assert (columns["right"], columns["healthy_named"]) == (right, healthy_named)
    assert columns["all_right"] == all_right


@pytest.mark.parametrize(
    ("event", "isolated", "right", "healthy_named"),
    [
        (Event("locked", 1.0, 0), (0, "locked", 1070), True, False),
        (Event("locked", 1.0, 0), (0, "locked", 900), False, True),
        (Event("bump_then_lock", 1.0, 0), (0, "locked", 1070), False, True),  # before the lock
        (Event("bump_then_lock", 1.0, 0), (0, "locked", 1500), True, False),
        (Event("push", 1.0), (0, "locked", 1070), False, True),
    ],
)
def test_after_an_event_only_the_failed_actuator_is_correct(event, isolated, right, healthy_named):
    columns = columns_of(isolated, events=(event,))
    assert (bool(columns["right"]), columns["healthy_named"]) == (right, healthy_named)
    assert not columns_of(isolated, withdrawn_s=1.9, events=(event,)).get("kind_right")


@pytest.mark.parametrize(
    ("event", "cause", "right"),
    [
        (Event("drift", 1.0, "strut2"), Cause("offset", 1), True),
        (Event("drift", 1.0, 1), Cause("offset", 2), False),
        (Event("drift", 1.0, 1), Cause("supply"), False),
        (Event("sag", 1.0), Cause("supply"), True),
        (Event("bias", 1.0), Cause("supply"), None),
    ],
)
def test_causes_other_than_failures_are_identified_by_kind_and_actuator(event, cause, right):
    assert columns_of(events=(event,), causes=(None, cause))["right"] is right
