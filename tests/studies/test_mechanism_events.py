"""`fjh recover --model --events`: any robot in every event, against one that does nothing."""

import json
from dataclasses import replace
from types import SimpleNamespace

import pytest

from experiments.app.cli import main
from experiments.recover.mechanism_event_results import checks, counted, described, summarize
from experiments.recover.mechanism_event_row import SCHEMA, row_of
from experiments.recover.mechanism_events import AFTER_S, EACH, drawn
from experiments.recover.mechanism_flight import MechanismFlight
from experiments.rig import Rig
from experiments.rig.events import EVENTS, Event
from experiments.rig.mjcf import robot_rig
from experiments.rig.options import RobotOptions
from sim import HEXAPOD_MJCF

HAND = HEXAPOD_MJCF.with_name("hand.xml")
OPTIONS = RobotOptions(major=(3, 4), crossover=0.7)
FIRST = MechanismFlight(0, HAND, OPTIONS, None, None, False, 4.0, 0.0, 3)


@pytest.fixture(scope="module")
def hand() -> Rig:
    return robot_rig(HAND, OPTIONS)


def row(event: str, ours: float, theirs: float, **others) -> dict:
    """Of a flight with these errors, whose event was not named."""
    rms = {
        f"rms_{who}_{when}": error
        for who, error in (("supervised", ours), ("unaware", theirs))
        for when in ("since", "after")
    }
    known = {"event": event, "status": "flown", "closure_residual_max_m": 0.0}
    return dict.fromkeys(SCHEMA.names) | known | rms | others


def test_flights_of_one_draw_differ_in_what_happens_and_to_which_actuator(hand):
    flights = drawn(FIRST, tuple(EVENTS), EACH, hand)
    assert [flight.number for flight in flights] == list(range(EACH * len(EVENTS)))
    assert len({(flight.seed, flight.duration_s) for flight in flights}) == EACH
    struck = [flight.events[0] for flight in flights]
    assert {event.name for event in struck} == set(EVENTS)
    assert {event.actuator for event in struck} == {None, 0, 1, 2, 3}
    for flight, event in zip(flights, struck, strict=True):
        assert flight.duration_s == pytest.approx(event.time_s + AFTER_S)


def test_harm_is_more_than_a_tenth_and_more_than_the_noise():
    """Twice the error of doing nothing is none where both are below what the sensors read."""
    assert counted("sag", [row("sag", 0.12, 0.1)], 0.01)["harmed"] == 1
    assert counted("sag", [row("sag", 0.105, 0.1)], 0.001)["harmed"] == 0
    below = counted("sag", [row("sag", 0.002, 0.001)], 0.01)
    assert below["harmed"] == 0 and below["over_median"] == pytest.approx(2.0)


def test_a_flight_that_ends_or_does_harm_fails_its_check_and_one_that_cannot_be_is_said(hand):
    rows = [
        row("sag", 0.3, 0.1),
        row("bias", 0.1, 0.1),
        row("nan", 0.1, 0.1) | {"status": "ended"},
        row("spring_lost", 0.1, 0.1) | {"status": "refused", "message": "motor1 has no spring"},
    ]
    outcome = SimpleNamespace(rig=hand, dither=None, model_sha256="")
    summary = summarize(outcome, rows)  # pyright: ignore[reportArgumentType]
    assert [each.passed for each in checks(summary)] == [True, False, True, False]
    assert "Not flown: motor1 has no spring." in described(summary).markdown()


@pytest.mark.long
def test_a_row_says_who_was_named_and_what_it_cost_and_what_cannot_happen():
    lock = Event("locked", 1.1, 1)
    flown = row_of(replace(FIRST, events=(lock,), duration_s=2.0))
    assert flown.keys() <= set(SCHEMA.names)
    assert (flown["status"], flown["first_named"], flown["strut_right"]) == (
        "flown",
        "motor2",
        True,
    )
    assert flown["rms_supervised_after"] < flown["rms_unaware_after"]
    spring = Event("spring_lost", 1.1, 1)
    refused = row_of(replace(FIRST, events=(spring,), duration_s=2.0))
    assert refused["status"] == "refused" and "no spring" in refused["message"]


@pytest.mark.long
def test_the_command_flies_a_robot_and_checks_each_event(tmp_path):
    words = ["--model", str(HAND), "--major", "3,4", "--events", "--quick", "--workers", "1"]
    assert main(["recover", *words, "--out", str(tmp_path)]) in (0, 1)
    summary = json.loads((tmp_path / "recover.json").read_text())
    assert [each["event"] for each in summary["events"]] == ["locked", "sag", "bias"]
    assert (tmp_path / "recover.md").read_text() == described(summary).markdown()
