"""`fjh recover --events`: whatever happens, against a controller that does nothing."""

import json
import pickle
import re
from copy import deepcopy
from dataclasses import replace
from math import sqrt
from types import SimpleNamespace
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from experiments.app.cli import main
from experiments.recover import row as rows
from experiments.recover.campaign import event_flights_of
from experiments.recover.course import SPIRAL, Course
from experiments.recover.event_plan import AFTER_S, COURSES, QUICK, WHOLE, EventPlan
from experiments.recover.event_results import NOISE_URAD, WORST, checks, counted, described
from experiments.recover.event_row import Holding, named
from experiments.recover.event_tables import headline
from experiments.recover.flight import exact_rig
from experiments.recover.plan import FlightPlan, for_hours
from experiments.recover.row import SCHEMA
from experiments.rig.events import EVENTS, Event
from experiments.rig.hexapod.mismatch import ALL, DRAWN, OTHER, mismatched
from experiments.rig.hexapod.testbed import TestbedConfig
from experiments.rig.mismatch import Mismatch
from experiments.rig.run import Named
from experiments.study.draw import CORRELATION, Draw
from experiments.study.results import Results
from ftc.controller import Measurement
from ftc.fdi.isolation.causes import Cause
from ftc.oracle import NEVER
from sim import HEXAPOD_MJCF, Failure, SimulationDiverged
from tests.conftest import fjh

# The plan.


def test_the_flights_of_the_other_study_are_what_they_were():
    """Numbers, draws and paths of a plan without events, as drawn before there were any."""
    plan = FlightPlan(for_hours(0.1), 3)
    drawn = {0: (4.085, 3017326895), 400: (4.038, 1069903208), 1000: (10.592, 2805759266)}
    assert len(plan) == 1127
    for number, expected in drawn.items():
        flight, bench = plan[number], TestbedConfig()
        assert (flight.begin_s, flight.plant_seed) == expected
        assert (flight.events, flight.course) == ((), SPIRAL)
        spiral = bench.desired_rad(flight.begin_s + bench.time_s(flight.duration_s))
        np.testing.assert_array_equal(flight.path(exact_rig()), spiral)


def test_a_flight_is_a_pure_function_of_counts_seed_and_number_and_small():
    plan, again, other = EventPlan(WHOLE, 3), EventPlan(WHOLE, 3), EventPlan(WHOLE, 4)
    numbers = np.random.default_rng(0).permutation(len(plan))[:100].tolist()
    flights = [plan[k] for k in numbers]
    assert [again[k] for k in reversed(numbers)] == flights[::-1]
    assert all(other[k] != flight for k, flight in zip(numbers, flights, strict=True))
    assert [flight.number for flight in flights] == numbers
    assert len(pickle.dumps(flights[0])) < 2000
    assert event_flights_of(plan).basis != event_flights_of(EventPlan(QUICK, 3)).basis


def test_every_event_has_its_flights_and_those_of_one_draw_differ_in_it_alone():
    plan = EventPlan(WHOLE, 1)
    assert len(plan) == 1 + 12 * len(EVENTS) and len(EVENTS) >= 30
    flights = [plan[k] for k in range(1, len(plan))]
    assert [flight.events[0].name for flight in flights] == [n for n in EVENTS for _ in range(12)]
    times = {(flight.draw, flight.events[0].time_s) for flight in flights}
    same = {replace(flight, number=0, events=()) for flight in flights}
    assert len(times) == len(same) == 12


def test_all_courses_and_struts_are_flown_with_either_family_some_before_all_is_learned():
    plan = EventPlan(WHOLE, 1)
    flights = [plan[k] for k in range(1, 13)]
    after_s = [flight.events[0].time_s - flight.begin_s for flight in flights]
    assert sum(each < 0.8 for each in after_s) == 2 and max(after_s) > 2.0
    for mismatch in ("all", "other family"):
        own = [flight for flight in flights if flight.mismatch == mismatch]
        assert len({flight.course for flight in own}) == COURSES
        assert {flight.events[0].actuator for flight in own} == set(range(6))
    for flight, since_s in zip(flights, after_s, strict=True):
        assert flight.duration_s == pytest.approx(since_s + AFTER_S)
        assert flight.begin_s + flight.duration_s <= 16.0
        assert flight.path(exact_rig()).shape == (round(1e3 * flight.duration_s), 2)


def test_a_circle_begins_at_rest_steps_are_held_and_rest_is_rest():
    circle, steps, rest = (
        Course(shape, 2.0, 0.5).desired_rad(0.0, 2.0) for shape in ("circle", "steps", "rest")
    )
    assert np.abs(circle[0]).max() == 0 and np.abs(np.diff(circle, axis=0)[0]).max() < 1e-9
    assert np.linalg.norm(circle - [0, 50e-6], axis=1) == pytest.approx(50e-6)
    assert np.unique(steps) == pytest.approx([0.0, 50e-6])
    assert np.count_nonzero(np.diff(steps, axis=0)) == 3  # out and back, then out in beta
    assert not rest.any()


# Plants of another family.


def test_the_other_family_is_log_normal_correlated_and_as_wide_as_stated():
    """Twice the standard deviation of the uniform one, which is what it was."""
    draws = range(1500)
    width = 0.06
    logs = np.log([Draw(k, "lognormal").factors("gain", 2, width) for k in draws])
    assert logs.std() == pytest.approx(width / sqrt(3), rel=0.06)
    assert logs.mean() == pytest.approx(0, abs=4 * width / sqrt(3 * 1500))
    assert np.corrcoef(logs.T)[0, 1] == pytest.approx(CORRELATION, abs=0.08)
    uniform = np.array([Draw(k).factors("gain", 2, width) for k in draws])
    assert np.abs(uniform - 1).max() <= width
    assert uniform.std() == pytest.approx(width / sqrt(3), rel=0.06)
    assert np.corrcoef(uniform.T)[0, 1] == pytest.approx(0, abs=0.08)
    assert {name: getattr(OTHER, name) for name in DRAWN} == {
        name: 2 * getattr(ALL, name) for name in DRAWN
    }


def test_a_plant_of_the_other_family_has_its_gains():
    rig = exact_rig()
    drawn = mismatched(rig.testbed, Mismatch(gain=0.06, family="lognormal"), 5)
    gains = drawn.machine.model.actuator_gainprm[:, 0] / rig.model.actuator_gainprm[:, 0]
    np.testing.assert_allclose(gains, Draw(5, "lognormal").factors("gain", 6, 0.06), rtol=1e-12)


# A row.


def flown(
    *diagnoses: Named,
    event: Event,
    failures: tuple[Failure, ...] = (),
    causes: tuple[Cause | None, ...] = (),
) -> dict[str, Any]:
    """What is made of a flight of two seconds with these diagnoses; an alarm before each."""
    alarms = tuple(round(1e3 * one.time_s) - 10 for one in diagnoses)
    found = SimpleNamespace(
        alarm_ticks=alarms,
        causes=causes,
        unexplained=False,
        task_lost=False,
        closure_residual_max_m=0.0,
    )
    run, flight = SimpleNamespace(diagnoses=diagnoses), SimpleNamespace(events=(event,))
    made: tuple[Any, Any, Any] = flight, run, found
    return named(exact_rig(), made[0], [*failures], *made[1:], 1000)


LOCKED = Named("strut1", "locked", 1.07, None)


def test_an_actuator_is_rightly_named_once_it_has_failed_and_no_other_is():
    lock = {"event": Event("locked", 1.0, 0), "failures": (Failure(0, "locked", 1.0),)}
    right = flown(LOCKED, **lock)
    assert right["strut_right"] and right["kind_right"] and not right["sound_named"]
    assert right["named_ms"] == pytest.approx(70) and right["alarm_ms"] == pytest.approx(60)
    then = flown(LOCKED, replace(LOCKED, actuator="strut4", time_s=1.2), **lock)
    assert then["strut_right"] and then["sound_named"]
    early = flown(replace(LOCKED, time_s=0.9), **lock)
    assert early["sound_named"] and not early["strut_right"] and early["alarm_before"]
    back = flown(replace(LOCKED, withdrawn_s=1.5), **lock)
    assert back["withdrawn"] == 1 and not back["kind_right"]
    nothing = flown(**lock)
    assert nothing["named_ms"] is None and not nothing["strut_right"]


def test_after_a_bump_a_lock_is_rightly_named_from_the_lock_on():
    event, failures = Event("bump_then_lock", 1.0, 0), (Failure(0, "locked", 1.4),)
    assert flown(LOCKED, event=event, failures=failures)["sound_named"]
    late = flown(replace(LOCKED, time_s=1.5), event=event, failures=failures)
    assert late["strut_right"] and late["named_ms"] == pytest.approx(100)


@pytest.mark.parametrize(
    ("event", "cause", "right"),
    [
        (Event("drift", 1.0, 1), Cause("offset", 1), True),
        (Event("drift", 1.0, "strut2"), Cause("offset", 1), True),
        (Event("drift", 1.0, 1), Cause("offset", 2), False),
        (Event("drift", 1.0, 1), Cause("supply"), False),
        (Event("sag", 1.0), Cause("supply"), True),
        (Event("bias", 1.0), Cause("scale"), False),
    ],
)
def test_what_is_no_failure_is_rightly_told_by_kind_and_actuator(event, cause, right):
    assert flown(event=event, causes=(None, cause))["cause_right"] == right
    assert not flown(event=event, causes=(None,))["cause_right"]


@pytest.mark.parametrize("name", ["sag", "push", "hum"])
def test_where_no_actuator_fails_every_name_is_of_a_sound_one(name):
    row = flown(LOCKED, event=Event(name, 1.0))
    assert row["sound_named"] and not row["strut_right"]


def test_a_controller_that_does_nothing_holds_its_commands_where_a_reading_is_no_number():
    pilot = exact_rig().controller()
    holding = Holding(pilot, pilot, NEVER)
    state = holding.step(holding.start(), np.full(2, 1e-6), Measurement(np.zeros(2), np.zeros(6)))
    held = holding.step(state, np.full(2, 1e-6), Measurement(np.array([np.nan, 0]), np.zeros(6)))
    assert held.ticks == 2 and held.controller is state.controller


def test_a_flight_that_ends_in_an_error_is_a_row_and_its_check_fails(monkeypatch):
    def fails(*_arguments):
        raise ValueError("no such number")

    def diverges(*_arguments):
        raise SimulationDiverged(0.03, np.zeros(3))

    monkeypatch.setattr("experiments.recover.event_row.supervised", fails)
    monkeypatch.setattr("experiments.recover.event_row.doing_nothing", diverges)
    row = rows.row_of(EventPlan(QUICK, 0)[1])
    assert row["status"] == "ended" and row["message"] == "ValueError: no such number"
    assert "non-finite" in row["unaware_ended"] and set(row) <= set(SCHEMA.names)
    entry = counted("locked", [dict.fromkeys(SCHEMA.names) | row])
    assert entry["ended"] == entry["unaware_ended"] == 1


# What is made of rows.


def made(name: str, supervised: float, unaware: float, after: float = 1.0) -> dict[str, Any]:
    """A row of errors from the event on, and from half a second later on, both unaware alike."""
    row = dict.fromkeys(SCHEMA.names) | {"status": "flown", "event": name}
    row |= {"rms_supervised_since_urad": supervised, "rms_unaware_since_urad": unaware}
    return row | {"rms_supervised_after_urad": after, "rms_unaware_after_urad": 1.0}


@pytest.mark.parametrize(
    ("errors", "harmed", "worst"),
    [
        ((5.0, 5.0), 0, 1.0),
        ((6.0, 5.0), 1, 1.2),
        ((0.6, 0.5), 0, 1.0),  # 1.2 times, but within the noise
        ((100.0, 100.0, 7.0), 1, 7.0),  # which a large transient would hide
        ((2.5, 5.0), 0, 1.0),
    ],
)
def test_harm_is_more_than_a_tenth_and_more_than_the_noise_in_either_span(errors, harmed, worst):
    assert pytest.approx(0.3 * sqrt(2)) == NOISE_URAD
    entry = counted("sag", [made("sag", *errors)])
    assert entry["harmed"] == harmed and entry["counted_worst"] == pytest.approx(worst)


@pytest.fixture(scope="module")
def events_folder(made_once):
    """A few events, made by the command; harm is found, not hidden."""

    def command(folder) -> int:
        return fjh("recover", "--events", "--quick")(folder) not in (0, 1)

    return made_once("recover_events", command)


@pytest.mark.long
def test_the_command_leaves_rows_table_figure_and_checks(events_folder, faults_of_figures):
    summary = json.loads((events_folder / "recover.json").read_text())
    table = pq.read_table(events_folder / "recover.parquet")
    assert table.schema.names == SCHEMA.names
    found = table.to_pylist()
    assert [row["case"] for row in found] == list(range(summary["runs"])) == list(range(5))
    assert [entry["event"] for entry in summary["events"]] == list(QUICK.names)
    assert set(summary["files"]) == {path.name for path in events_folder.iterdir()}
    assert (events_folder / "recover.md").read_text() == described(summary).markdown()
    assert faults_of_figures("recover_events") == []
    by_name = {row["event"]: row for row in found}
    lock = by_name["locked"]
    assert lock["strut_right"] and lock["kind_right"] and not lock["sound_named"]
    # Told at once, a controller is better than one that does nothing; the diagnosis comes near it.
    errors = [lock[f"rms_{who}_since_urad"] for who in ("informed", "supervised", "unaware")]
    assert errors == sorted(errors)
    assert by_name[None]["alarms"] == 0
    spoils = [
        (lambda s: s["events"][0].update(counted_worst=1.2), "locked: largest RMS error over"),
        (lambda s: s["events"][1].update(ended=1), "hard_over: largest RMS error .* is inf"),
        (lambda s: s["sound"].update(sound_named=1), "without events: number of struts named"),
        (lambda s: s["sound"].update(changed=1), "whose commands an alarm changed"),
        (lambda s: s.update(diverged=1), "diverged"),
        (lambda s: s["closure_m"].update(near=2e-8), "within 1000 urad: closure residual"),
        (lambda s: s["closure_m"].update(thrown=2e-7), "beyond 1000 urad: closure residual"),
    ]
    good = deepcopy(summary)
    for entry in good["events"]:
        entry.update(counted_worst=1.0, ended=0, harmed=0)
    assert Results(good, checks=checks(good)).failed_check is None
    assert f"At most {WORST:g} times" in headline(good) and "worst" not in headline(good)
    for spoil, words in spoils:
        spoilt = deepcopy(good)
        spoil(spoilt)
        assert re.search(words, str(Results(spoilt, checks=checks(spoilt)).failed_check))


ARM = str(HEXAPOD_MJCF.with_name("arm.xml"))


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--hours", "3"), "--hours does not go with --events"),
        (("--controller", "ftc.oracle:OracleController"), "--controller does not go with --events"),
    ],
)
def test_an_option_of_other_flights_is_refused_in_a_sentence(words, said, tmp_path, capfd):
    assert main(["recover", "--events", "--quick", *words, "--out", str(tmp_path / "out")]) == 2
    assert said in capfd.readouterr().err
