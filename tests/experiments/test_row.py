"""A run of `fjh paper recover` as a row: what happened, who was named, and what it cost."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from experiments.recover import plan
from experiments.recover import row as rows
from experiments.recover.plan import Case, exact_rig
from fjh.rig.events import Event
from fjh.rig.run import Diagnosed
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
@pytest.mark.parametrize(("seed", "draw"), [(0, 3), (0, 288), (1, 27)])
def test_a_lock_is_not_taken_for_the_opposite_strut_nor_for_the_floor(seed, draw):
    """In half a period of the dither hysteresis, dampers and the floor made them alike."""
    case = plan.hexapod_failures([("failure", "all", 1.0, draw + 1)], 0, 0.1, seed)[draw]
    assert rows.tick_at(exact_rig(), case, case.onset_s) == round(1e3 * plan.BEFORE_S)
    row, _ = rows.simulate(case)
    assert row["right"] and not row["healthy_named"] and not row["alarm_before"]


@pytest.mark.long
def test_a_command_that_an_alarm_changes_is_noticed_however_little(monkeypatch):
    """Without an alarm the supervised controller sends the commands of the unaware one."""
    [case] = plan.hexapod_failures([], 1, 0.1, 0)
    run = rows.simulate_supervised(case.rig(), case)
    assert run.state.watch.alarm_ticks == ()
    np.testing.assert_array_equal(run.inputs, rows.simulate_undiagnosed(case.rig(), case).inputs)
    watch = replace(run.state.watch, alarm_ticks=(5,))
    state = replace(run.state, watch=watch)
    alarmed = replace(run, inputs=run.inputs + 1e-12, state=state)
    monkeypatch.setattr(rows, "simulate_supervised", lambda *_: alarmed)
    assert rows.row_of(case)["commands_changed"]


def test_a_controller_that_does_nothing_holds_its_commands_on_nan():
    controller = exact_rig().controller()
    holding = rows.HoldingController(controller, controller, None)
    state = holding.step(holding.start(), np.full(2, 1e-6), Measurement(np.zeros(2), np.zeros(6)))
    held = holding.step(state, np.full(2, 1e-6), Measurement(np.array([np.nan, 0]), np.zeros(6)))
    assert held.ticks == 2 and held.controller is state.controller


def columns_of(
    *named: tuple[int, Any, int],
    withdrawn_s: float | None = None,
    causes: tuple[Cause | None, ...] = (),
    **case: Any,
) -> dict:
    """Columns of a run of 5 s; strut, kind and tick of each diagnosis, 10 ms after its alarm."""
    faults = {strut: Fault(strut, kind) for strut, kind, _ in named if withdrawn_s is None}
    alarms = tuple(tick - 10 for _, _, tick in named)
    watch = SimpleNamespace(alarm_ticks=alarms, causes=causes, unexplained=False)
    run: Any = SimpleNamespace(
        diagnoses=[Diagnosed(f"strut{k + 1}", kind, t / 1e3, withdrawn_s) for k, kind, t in named],
        state=SimpleNamespace(watch=watch, standing=list(map(Diagnosis.told, faults.values()))),
        task_lost=False,
        status="",
        closure_max_m=0.0,
        error=np.zeros((5000, 2)),
    )
    own = Case(case.pop("sort", "event"), duration_s=5.0, **case)
    return rows.supervised_columns(exact_rig(), own, run)


@pytest.mark.parametrize(
    ("named", "right", "healthy_named", "all_right"),
    [
        ([(0, "locked", 2010), (4, "free", 3010)], True, False, True),
        ([(0, "free", 2010), (4, "free", 3010)], True, False, False),
        ([(4, "free", 2010), (0, "locked", 2020), (4, "free", 3010)], False, True, True),
        ([(3, "locked", 1999), (0, "locked", 2010), (4, "free", 3010)], True, True, False),
        ([], False, False, False),
    ],
)
def test_an_actuator_is_rightly_named_only_after_it_has_failed(
    named, right, healthy_named, all_right
):
    pair = (Failure(0, "locked", 2.0), Failure(4, "free", 3.0))
    found = columns_of(*named, sort="pair", failures=pair)
    assert (found["right"], found["healthy_named"]) == (right, healthy_named)
    assert found["all_right"] == all_right


@pytest.mark.parametrize(
    ("event", "named", "right", "healthy_named"),
    [
        (Event("locked", 1.0, 0), (0, "locked", 1070), True, False),
        (Event("locked", 1.0, 0), (0, "locked", 900), False, True),
        (Event("bump_then_lock", 1.0, 0), (0, "locked", 1070), False, True),  # before the lock
        (Event("bump_then_lock", 1.0, 0), (0, "locked", 1500), True, False),
        (Event("push", 1.0), (0, "locked", 1070), False, True),
    ],
)
def test_after_an_event_what_failed_is_rightly_named_and_nothing_else(
    event, named, right, healthy_named
):
    found = columns_of(named, events=(event,))
    assert (bool(found["right"]), found["healthy_named"]) == (right, healthy_named)
    assert not columns_of(named, withdrawn_s=1.9, events=(event,)).get("kind_right")


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
def test_what_is_no_failure_is_rightly_told_by_kind_and_actuator(event, cause, right):
    assert columns_of(events=(event,), causes=(None, cause))["right"] is right
