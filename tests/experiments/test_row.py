"""A run of `fjh paper recover` as a row: what happened, who was named, and what it cost."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from experiments.recover import plan
from experiments.recover import row as rows
from experiments.recover.plan import Case, exact_rig
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
from fjh.rig import Rig
from fjh.rig.dither import rig_dither
from fjh.rig.events import Event
from fjh.rig.mjcf import robot_rig
from fjh.rig.options import DITHER_SIZE, RobotOptions, Sensing
from fjh.rig.run import Diagnosed
from fjh.study.errors import WrongInput
from ftc import Measurement
from ftc.fdi import Cause, Diagnosis, DitherDesign, Fault
from sim import HEXAPOD_MJCF, Failure, Pose, SimulationDiverged
from sim.plant import FailureKind

# Flights of the hexapod.


@pytest.mark.long
def test_a_case_repeats_to_the_bit_and_its_row_has_known_columns():
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
    assert tick_at(exact_rig(), case, case.happens_s) == round(1e3 * plan.BEFORE_S)
    row, _ = fly(case)
    assert row["right"] and not row["healthy_named"] and not row["alarm_before"]


@pytest.mark.long
def test_a_plant_is_learned_long_enough_to_raise_no_alarm_thereafter():
    """After 0.2 s instead of 0.8 s of learning a healthy strut would be named."""
    case = plan.hexapod_failures([], 2, 4.0, 1)[1]
    assert fly(case)[0]["alarms"] == 0


@pytest.mark.long
def test_a_command_that_an_alarm_changes_is_noticed_however_little(monkeypatch):
    """Without an alarm the supervised controller sends the commands of the unaware one."""
    [case] = plan.hexapod_failures([], 1, 0.1, 0)
    for rig in (exact_rig(), case.rig()):
        run = supervised(rig, case)
        assert run.state.watch.alarm_ticks == ()
        np.testing.assert_array_equal(run.inputs, unaware(rig, case).inputs)
    watch = replace(run.state.watch, alarm_ticks=(5,))
    for moved in (0.0, 1e-12):
        state = replace(run.state, watch=watch)
        alarmed = replace(run, inputs=run.inputs + moved, state=state)
        monkeypatch.setattr(rows, "supervised", lambda *_, alarmed=alarmed: alarmed)
        row = row_of(case)
        assert row["alarms"] == 1 and row["alarm_before"]
        assert row["commands_changed"] == (moved > 0)


def test_a_controller_that_does_nothing_holds_its_commands_on_nan():
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
    """After a bump from the lock on."""
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
    bump = (Event("bump_then_lock", 1.0, 0),)
    assert columns_of(LOCKED, events=bump)["healthy_named"]
    late = columns_of(said(0, "locked", 1500), events=bump)
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


# Flights of any robot.

MAJOR = {"arm": (0, 1), "hand": (3, 4), "platform": (3, 4), "arms": (3, 4, 5)}
FOUND: dict[str, tuple[int, FailureKind]] = {
    **{"arm": (1, "free"), "hand": (1, "locked"), "platform": (2, "free"), "arms": (1, "locked")}
}
FAILS_S = 1.2


def options(name: str, sense: Sensing) -> RobotOptions:
    return RobotOptions(major=MAJOR[name], sense=sense, crossover=0.7)


@cache
def designed(name: str, sense: Sensing) -> tuple[Rig, DitherDesign]:
    rig = exact_rig(HEXAPOD_MJCF.with_name(f"{name}.xml"), options(name, sense))
    design = rig_dither(rig, "designed")
    assert design is not None
    return rig, design


def case_of(name: str, sense: Sensing, **happens: Any) -> Case:
    """A case on a circle in the first two major rows."""
    model, own = HEXAPOD_MJCF.with_name(f"{name}.xml"), options(name, sense)
    first = Case("failure", seed=5, plant_seed=5, model=model, options=own)
    dither = designed(name, sense)[1].dither
    how = {"course": "circle", "turn_s": 4.0, "dither": dither, "transient_s": 0.8}
    return replace(first, **how, **happens)


@pytest.mark.long
@pytest.mark.parametrize(
    "sense",
    ["both", *(pytest.param(sense, marks=pytest.mark.night) for sense in ("task", "joints"))],
)
@pytest.mark.parametrize("name", MAJOR)
def test_every_mechanism_goes_on_whatever_the_diagnosis_sees(name, sense):
    """The first actuator named is the one that failed, and what follows is as an informed one."""
    actuator, kind = FOUND[name]
    happens = {"failures": (Failure(actuator, kind, FAILS_S),), "compared": ("informed",)}
    happens["recovered_s"] = plan.recovered_s(designed(name, sense)[0])
    own = row_of(case_of(name, sense, duration_s=FAILS_S + 2.4, **happens))
    assert own["right"] and not own["alarm_before"] and not own["healthy_named"], own["report"]
    assert own["task_lost"] == own["lost_rightly"]
    if "rms_informed_after" in own:
        assert own["rms_supervised_after"] < 1.5 * own["rms_informed_after"]


@pytest.mark.long
@pytest.mark.parametrize("name", MAJOR)
def test_no_healthy_actuator_is_named_while_nothing_fails(name):
    own = row_of(case_of(name, "both", sort="healthy", duration_s=FAILS_S + 2.4))
    assert not own["healthy_named"] and "rms_supervised_after" not in own
    assert own["rms_supervised_before"] > 0 and own["commands_changed"] is False


@pytest.mark.long
def test_a_row_says_who_was_named_and_what_it_cost_and_what_cannot_happen():
    lock, spring = Event("locked", 1.1, 1), Event("spring_lost", 1.1, 1)
    happens: dict[str, Any] = {"sort": "event", "compared": ("unaware",), "duration_s": 2.0}
    flown = row_of(case_of("hand", "both", events=(lock,), **happens))
    assert flown.keys() <= set(COLUMNS)
    assert (flown["status"], flown["first_actuator"], flown["right"]) == ("flown", "motor2", True)
    assert flown["rms_supervised_after"] < flown["rms_unaware_after"]
    refused = row_of(case_of("hand", "both", events=(spring,), **happens))
    assert refused["status"] == "refused" and "no spring" in refused["message"]


@pytest.mark.long
@pytest.mark.parametrize(("name", "sense"), [("arm", "task"), ("hand", "joints")])
def test_a_dither_keeps_to_its_size_and_moves_the_task_as_designed(name, sense):
    """The actuators follow it, in MuJoCo, no further than it says; the task by dynamics alone."""
    rig, design = designed(name, sense)
    time_s = np.arange(1500) * rig.period_s
    bench = rig.bench(time_s, [], 0)
    for now_s in time_s:
        bench.measure()
        bench.apply(design.dither.at(now_s))
    steady = time_s >= 1.0
    moved = np.abs(bench.displacement[steady]).max(axis=0)
    np.testing.assert_allclose(moved, design.displacement, rtol=0.05, atol=1e-3 * moved.max())
    furthest = DITHER_SIZE * rig.size * np.abs(rig.mapping(rig.goal).major_gain()).max()
    assert moved.max() < 1.05 * furthest
    task = Pose(bench.rotation, bench.translation_m).displacement()[:, list(rig.major)]
    amplitude = np.abs(task[steady]).max(axis=0)
    np.testing.assert_allclose(amplitude, design.task_motion, rtol=0.1, atol=1e-3 * rig.size)
    assert design.task_motion.max() <= DITHER_SIZE * rig.size * (1 + 1e-9)


@pytest.mark.long
def test_encoders_resolve_the_path_as_the_task_sensor_does_in_any_unit():
    """Metres of the hand's path are no radians of its joints; a noise that is given is both."""
    rig, _ = designed("hand", "joints")
    gain = rig.mapping(rig.goal).major_gain()
    assert rig.encoder_noise == pytest.approx(rig.noise * np.abs(gain).max())
    np.testing.assert_array_equal(rig.watched.noise, np.full(4, rig.encoder_noise))
    file = HEXAPOD_MJCF.with_name("hand.xml")
    given = robot_rig(file, replace(options("hand", "both"), noise=3e-6))
    np.testing.assert_array_equal(given.watched.noise, np.full(6, 3e-6))


@pytest.mark.long
def test_a_dither_has_the_frequency_asked_for_or_is_none():
    design = rig_dither(designed("platform", "both")[0], "7")
    assert design is not None and design.dither.frequency_hz == 7.0
    whole = robot_rig(
        HEXAPOD_MJCF.with_name("platform.xml"), RobotOptions(major=(2, 3, 4), crossover=0.7)
    )
    assert rig_dither(whole, "designed") is None
    assert rig_dither(whole, "none") is None
    for words in ("0.5", "1000", "nan", "often", ""):
        with pytest.raises(
            WrongInput, match=r"^dither must be none, default, designed, or a frequency from 2"
        ):
            rig_dither(designed("platform", "both")[0], words)
