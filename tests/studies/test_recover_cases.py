"""Cases of `fjh paper recover`: drawn from a seed and a place, each a row; and no row is lost."""

import pickle
from dataclasses import replace
from math import sqrt
from types import SimpleNamespace
from typing import Any, get_args

import numpy as np
import pandas as pd
import pytest

from experiments.recover import hexapod_basis, plan
from experiments.recover import row as rows
from experiments.recover.plan import BENCH, Case, exact_rig, healthy_for, sizes_of
from experiments.recover.row import (
    COLUMNS,
    Holding,
    fly,
    row_of,
    supervised,
    supervised_columns,
    tick_at,
    unaware,
)
from experiments.study import Where, basis_of, rows_of
from fjh.rig.draw import CORRELATION, Draw
from fjh.rig.events import EVENTS, Event
from fjh.rig.hexapod.mismatch import ALL, ALONE, DRAWN, OTHER, differing
from fjh.rig.mismatch import Mismatch
from fjh.rig.run import Diagnosed
from fjh.study.errors import Interrupted, WrongInput
from ftc import Measurement
from ftc.fdi import Cause, Diagnosis, Fault
from sim import Failure, SimulationDiverged
from sim.plant import FailureKind

WHOLE = plan.hexapod_failures(plan.WHOLE, healthy_for(2.0), BENCH.duration_s, 7)
EVENTFUL = plan.hexapod_events(EVENTS, plan.EVENTS_EACH, 3600.0, 1)


# Which cases there are.


@pytest.mark.parametrize(
    "cases",
    [
        lambda seed: plan.hexapod_failures(plan.WHOLE, 9, 16.0, seed),
        lambda seed: plan.hexapod_events(EVENTS, plan.EVENTS_EACH, 3600.0, seed),
    ],
)
def test_cases_are_a_pure_function_of_the_seed_and_small(cases):
    own, other = cases(3), cases(4)
    assert cases(3) == own and [case.number for case in own] == list(range(len(own)))
    assert all(one != two for one, two in zip(own, other, strict=True))
    assert max(len(pickle.dumps(case)) for case in own[:100]) < 2000


def test_the_failures_are_those_that_were_published():
    """As first drawn, and nothing else happens to them."""
    cases = plan.hexapod_failures(plan.WHOLE, healthy_for(0.1), BENCH.duration_s, 3)
    first = {0: (4.085, 3017326895), 400: (4.038, 1069903208), 1000: (10.592, 2805759266)}
    assert len(cases) == 1127
    for number, expected in first.items():
        case = cases[number]
        assert (round(case.begin_s, 9), case.plant_seed) == expected
        assert (case.events, case.course) == ((), "spiral")
        spiral = BENCH.spiral_rad(case.duration_s, case.begin_s)
        np.testing.assert_array_equal(case.path(exact_rig()), spiral)


def test_every_size_is_one_that_a_plant_can_have():
    """`scaled` refuses all others."""
    for _, mismatch, factor, count in plan.WHOLE:
        assert count > 0
        sizes_of(exact_rig(), mismatch).scaled(factor)
    failing = {mismatch for sort, mismatch, _, _ in plan.WHOLE if sort == "failure"}
    assert failing == {"exact", "all", *ALONE}


@pytest.mark.long
def test_a_study_goes_on_with_more_hours_or_fewer(tmp_path):
    """The cases before them are the same, and so is what the dataset depends on."""
    basis = hexapod_basis(3, False, False, None)
    short, long = (plan.hexapod_cases(basis, healthy) for healthy in (9, 12))
    assert plan.healthy_for(1.0) == 225 and plan.healthy_for(1e-3) == 1
    assert short == long[: len(short)] and len(long) == len(short) + 3
    basis, where = basis_of(**basis), Where(workers=1, resume=None)

    def done(count: int, stop_at: int = -1, **changed: Any) -> pd.DataFrame:
        def interrupt(done: int, _total: int) -> None:
            if done == stop_at:
                raise KeyboardInterrupt

        own = replace(where, resume=True) if changed else where
        how: dict[str, Any] = {"name": "recover", "folder": tmp_path, "on_progress": interrupt}
        return rows_of(short[:count], Case.parameters, basis | changed, own, **how)

    with pytest.raises(Interrupted, match="4 of 6 runs are kept; --resume continues"):
        done(6, stop_at=4)
    with pytest.raises(WrongInput, match="another seed"):
        done(6, seed=1)
    assert list(done(8).case) == list(range(8)) and len(done(3)) == 3
    expected = pd.DataFrame([case.parameters() for case in short[:8]])
    pd.testing.assert_frame_equal(done(8), expected)


def test_a_failure_is_the_same_whatever_the_plant_and_all_are_drawn():
    """So that what a mismatch costs is not the luck of the draw."""
    cases = [case for case in WHOLE if case.sort in ("failure", "size")]
    by_draw: dict[int, set[Case]] = {}
    alike = {"number": 0, "sort": "size", "mismatch": "exact", "factor": 1.0, "compared": ()}
    for case in cases:
        by_draw.setdefault(case.draw, set()).add(replace(case, **alike))
    assert {len(same) for same in by_draw.values()} == {1}
    assert len({(case.failures[0].actuator, case.failures[0].kind) for case in cases[:18]}) == 18
    for case in cases[:18]:
        assert tick_at(exact_rig(), case, case.happens_s) == round(1e3 * plan.BEFORE_S)
        assert case.begin_s > 0 and case.begin_s + case.duration_s <= 16.0


def test_second_failures_are_of_another_strut_some_time_later():
    pairs = [case for case in WHOLE if case.sort == "pair"]
    assert len(pairs) >= 20
    for case in pairs:
        first, second = case.failures
        assert first.actuator != second.actuator
        assert 0.1 <= second.time_s - first.time_s <= 2.0
        assert case.begin_s + case.duration_s == pytest.approx(second.time_s + 2.0)


def test_every_event_has_its_cases_and_those_of_one_draw_differ_in_it_alone():
    cases = EVENTFUL[1:]
    assert len(cases) == 12 * len(EVENTS) and len(EVENTS) >= 30
    assert [case.events[0].name for case in cases] == [n for n in EVENTS for _ in range(12)]
    times = {(case.draw, case.events[0].time_s) for case in cases}
    same = {replace(case, number=0, events=(), compared=()) for case in cases}
    assert len(times) == len(same) == 12
    told = {case.events[0].name for case in cases if "informed" in case.compared}
    assert told == {name for name in EVENTS if name in get_args(FailureKind)}


def test_all_courses_and_struts_are_run_with_either_family_some_before_all_is_learned():
    cases = EVENTFUL[1:13]
    after_s = [case.happens_s - case.begin_s for case in cases]
    assert sum(each < 0.8 for each in after_s) == 2 and max(after_s) > 2.0
    for mismatch in ("all", "other family"):
        own = [case for case in cases if case.mismatch == mismatch]
        assert len({(case.course, case.turn_s, case.radius) for case in own}) == plan.COURSES
        assert {case.events[0].actuator for case in own} == set(range(6))
    for case in cases:
        assert case.begin_s + case.duration_s <= 16.0
        assert case.path(exact_rig()).shape == (round(1e3 * case.duration_s), 2)


def test_a_circle_begins_at_rest_steps_are_held_and_rest_is_rest():
    circle, steps, rest = (
        Case("event", duration_s=2.0, course=course, turn_s=2.0, radius=0.5).path(exact_rig())
        for course in ("circle", "steps", "rest")
    )
    assert np.abs(circle[0]).max() == 0 and np.abs(np.diff(circle, axis=0)[0]).max() < 1e-9
    assert np.linalg.norm(circle - [0, 50e-6], axis=1) == pytest.approx(50e-6)
    assert np.unique(steps) == pytest.approx([0.0, 50e-6])
    assert np.count_nonzero(np.diff(steps, axis=0)) == 3  # out and back, then out in beta
    assert not rest.any()


def test_the_other_family_is_log_normal_correlated_and_as_wide_as_stated():
    """Twice the standard deviation of the uniform one, which is what it was."""
    draws, width = range(1500), 0.06
    logs = np.log([Draw(k, "lognormal").factors("gain", 2, width) for k in draws])
    assert logs.std() == pytest.approx(width / sqrt(3), rel=0.06)
    assert logs.mean() == pytest.approx(0, abs=4 * width / sqrt(3 * 1500))
    assert np.asarray(np.corrcoef(logs.T))[0, 1] == pytest.approx(CORRELATION, abs=0.08)
    uniform = np.array([Draw(k).factors("gain", 2, width) for k in draws])
    assert float(np.abs(uniform - 1).max()) <= width
    assert uniform.std() == pytest.approx(width / sqrt(3), rel=0.06)
    assert np.asarray(np.corrcoef(uniform.T))[0, 1] == pytest.approx(0, abs=0.08)
    for name in DRAWN:
        assert getattr(OTHER, name) == 2 * getattr(ALL, name)
    model = exact_rig().model
    own = differing(model, Mismatch(gain=0.06, family="lognormal"), 5).model
    assert own is not None
    gains = own.actuator_gainprm[:, 0] / model.actuator_gainprm[:, 0]
    np.testing.assert_allclose(gains, Draw(5, "lognormal").factors("gain", 6, 0.06), rtol=1e-12)


# A row.


def test_a_case_repeats_to_the_bit_and_its_row_has_only_columns_of_the_dataset():
    one, two = plan.hexapod_failures([], 2, 0.1, 5)
    row = row_of(one)
    assert row_of(one) == row
    assert row["status"] == "flown" and row["case"] == 0 and set(row) <= set(COLUMNS)
    assert row_of(two)["closure_residual_max_m"] != row["closure_residual_max_m"]


def test_a_run_that_ends_early_is_a_row(monkeypatch):
    def fails(*_arguments):
        raise ValueError("no such number")

    def diverges(*_arguments):
        raise SimulationDiverged(0.03, np.zeros(3))

    monkeypatch.setattr(rows, "supervised", fails)
    monkeypatch.setattr(rows, "unaware", diverges)
    row = row_of(plan.hexapod_events(["locked"], 1, 2.0, 0)[1])
    assert row["status"] == "ended" and row["message"] == "ValueError: no such number"
    assert "non-finite" in row["unaware_ended"] and set(row) <= set(COLUMNS)
    assert row["actuator"] == "strut1" and "rms_unaware_since" not in row


@pytest.mark.long
@pytest.mark.parametrize(("seed", "draw"), [(0, 3), (0, 288), (1, 27)])
def test_a_lock_is_not_taken_for_the_opposite_strut_nor_for_the_floor(seed, draw):
    """In half a period of the dither hysteresis and dampers made them alike.

    And without an autoregression of order 10 the floor would leave an alarm unexplained.
    """
    case = plan.hexapod_failures([("failure", "all", 1.0, draw + 1)], 0, 0.1, seed)[draw]
    row, _ = fly(case)
    assert row["right"] and not row["healthy_named"] and not row["alarm_before"]


@pytest.mark.long
def test_a_plant_is_learned_long_enough_to_raise_no_alarm_thereafter():
    """After 0.2 s instead of 0.8 s of learning a healthy strut would be named."""
    case = plan.hexapod_failures([], 2, 4.0, 1)[1]
    assert fly(case)[0]["alarms"] == 0


def test_without_an_alarm_the_supervised_controller_sends_the_commands_of_the_unaware_one():
    [case] = plan.hexapod_failures([], 1, 0.1, 0)
    run = supervised(exact_rig(), case)
    assert run.state.watch.alarm_ticks == ()
    np.testing.assert_array_equal(run.inputs, unaware(exact_rig(), case).inputs)


@pytest.mark.parametrize("moved", [0.0, 1e-12])
def test_a_command_that_an_alarm_changes_is_noticed_however_little(monkeypatch, moved):
    [case] = plan.hexapod_failures([], 1, 0.1, 0)
    run = supervised(rig := case.rig(), case)
    watch = replace(run.state.watch, alarm_ticks=(5,))
    alarmed = replace(run, inputs=run.inputs + moved, state=replace(run.state, watch=watch))
    monkeypatch.setattr(rows, "supervised", lambda *_: alarmed)
    row = row_of(case)
    assert row["alarms"] == 1 and row["alarm_before"]
    assert row["commands_changed"] == (moved > 0) and rig is not None


def test_a_controller_that_does_nothing_holds_its_commands_where_a_reading_is_no_number():
    controller = exact_rig().controller()
    holding = Holding(controller, controller, None)
    state = holding.step(holding.start(), np.full(2, 1e-6), Measurement(np.zeros(2), np.zeros(6)))
    held = holding.step(state, np.full(2, 1e-6), Measurement(np.array([np.nan, 0]), np.zeros(6)))
    assert held.ticks == 2 and held.controller is state.controller


# What a diagnosis is worth.


def columns_of(*diagnoses: Diagnosed, causes: tuple[Cause | None, ...] = (), **case: Any) -> dict:
    """Columns of a run of five seconds with these diagnoses; an alarm 10 ms before each."""
    number = exact_rig().number
    standing = {
        one.actuator: Diagnosis.told(Fault(number(one.actuator), one.kind))
        for one in diagnoses
        if one.withdrawn_s is None
    }
    alarms = tuple(round(1e3 * one.time_s) - 10 for one in diagnoses)
    watch = SimpleNamespace(alarm_ticks=alarms, causes=causes, unexplained=False)
    run: Any = SimpleNamespace(
        diagnoses=diagnoses,
        state=SimpleNamespace(watch=watch, standing=list(standing.values())),
        task_lost=False,
        status="",
        closure_max_m=0.0,
        error=np.zeros((5000, 2)),
    )
    own = Case(case.pop("sort", "event"), duration_s=5.0, **case)
    return supervised_columns(exact_rig(), own, run)


def said(strut: int, kind: Any, tick: int, withdrawn_s: float | None = None) -> Diagnosed:
    return Diagnosed(f"strut{strut + 1}", kind, tick / 1e3, withdrawn_s)


LOCKED = said(0, "locked", 1070)


@pytest.mark.parametrize(
    ("named", "right", "healthy_named", "all_right"),
    [
        ([(0, "locked", 2010), (4, "free", 3010)], True, False, True),
        ([(0, "locked", 2010)], True, False, False),
        ([(0, "free", 2010), (4, "free", 3010)], True, False, False),
        ([(4, "free", 2010), (0, "locked", 2020), (4, "free", 3010)], False, True, True),
        ([(3, "locked", 1999), (0, "locked", 2010), (4, "free", 3010)], True, True, False),
        ([(0, "locked", 2010), (4, "free", 3010), (5, "weak", 3500)], True, True, False),
        ([], False, False, False),
    ],
)
def test_an_actuator_is_rightly_named_only_after_it_has_failed(
    named, right, healthy_named, all_right
):
    pair = (Failure(0, "locked", 2.0), Failure(4, "free", 3.0))
    found = columns_of(*(said(*each) for each in named), sort="pair", failures=pair)
    assert (found["right"], found["healthy_named"]) == (right, healthy_named)
    assert found["all_right"] == all_right


def test_without_a_failure_every_alarm_is_false_and_every_actuator_healthy():
    found = columns_of(said(2, "weak", 40), sort="healthy")
    assert found["alarm_before"] and found["healthy_named"] and found["right"] is None
    assert not columns_of(sort="healthy")["alarm_before"]
    for name in ("sag", "push", "hum"):
        row = columns_of(LOCKED, events=(Event(name, 1.0),))
        assert row["healthy_named"] and not row["right"]


def test_after_an_event_an_actuator_is_rightly_named_and_no_other_is():
    lock: dict[str, Any] = {"events": (Event("locked", 1.0, 0),)}
    right = columns_of(LOCKED, **lock)
    assert right["right"] and right["kind_right"] and not right["healthy_named"]
    assert right["named_s"] == pytest.approx(0.07) and right["alarm_s"] == pytest.approx(0.06)
    then = columns_of(LOCKED, said(3, "locked", 1200), **lock)
    assert then["right"] and then["healthy_named"]
    early = columns_of(said(0, "locked", 900), **lock)
    assert early["healthy_named"] and not early["right"] and early["alarm_before"]
    back = columns_of(replace(LOCKED, withdrawn_s=1.5), **lock)
    assert back["withdrawn"] == 1 and not back["kind_right"]
    assert "named_s" not in columns_of(**lock) and not columns_of(**lock)["right"]


def test_after_a_bump_a_lock_is_rightly_named_from_the_lock_on():
    events = (Event("bump_then_lock", 1.0, 0),)
    assert columns_of(LOCKED, events=events)["healthy_named"]
    late = columns_of(said(0, "locked", 1500), events=events)
    assert late["right"] and late["named_s"] == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("event", "cause", "right"),
    [
        (Event("drift", 1.0, 1), Cause("offset", 1), True),
        (Event("drift", 1.0, "strut2"), Cause("offset", 1), True),
        (Event("drift", 1.0, 1), Cause("offset", 2), False),
        (Event("drift", 1.0, 1), Cause("supply"), False),
        (Event("sag", 1.0), Cause("supply"), True),
    ],
)
def test_what_is_no_failure_is_rightly_told_by_kind_and_actuator(event, cause, right):
    assert columns_of(events=(event,), causes=(None, cause))["right"] == right
    assert columns_of(events=(event,), causes=(None,))["right"] is False
    assert columns_of(events=(Event("bias", 1.0),), causes=(cause,))["right"] is None
