"""Every mechanism loses an actuator in a run and goes on, on a plant that is not the model."""

import json
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pandas as pd
import pytest

from experiments.app.cli import main
from experiments.recover import plan
from experiments.recover.plan import Case, exact_rig
from experiments.recover.row import COLUMNS, row_of
from experiments.recover.tables import checks, notes
from fjh.rig import Rig
from fjh.rig.dither import rig_dither
from fjh.rig.events import EVENTS, Event
from fjh.rig.mjcf import robot_rig
from fjh.rig.options import DITHER_SIZE, RobotOptions, Sensing
from fjh.study.errors import WrongInput
from ftc.fdi import DitherDesign
from sim import HEXAPOD_MJCF, Failure, Pose
from sim.plant import FailureKind

MAJOR = {"arm": (0, 1), "hand": (3, 4), "platform": (3, 4), "arms": (3, 4, 5)}
FAILS_S = 1.2


def file(name: str):
    return HEXAPOD_MJCF.with_name(f"{name}.xml")


def options(name: str, sense: Sensing) -> RobotOptions:
    return RobotOptions(major=MAJOR[name], sense=sense, crossover=0.7)


@cache
def designed(name: str, sense: Sensing) -> tuple[Rig, DitherDesign]:
    rig = exact_rig(file(name), options(name, sense))
    design = rig_dither(rig, "designed")
    assert design is not None
    return rig, design


def case_of(name: str, sense: Sensing, **happens: Any) -> Case:
    """A case on a circle in the first two major rows."""
    first = Case("failure", seed=5, plant_seed=5, model=file(name), options=options(name, sense))
    dither = designed(name, sense)[1].dither
    how = {"course": "circle", "turn_s": 4.0, "dither": dither, "transient_s": 0.8}
    return replace(first, **how, **happens)


FOUND: dict[str, tuple[int, FailureKind]] = {
    **{"arm": (1, "free"), "hand": (1, "locked"), "platform": (2, "free"), "arms": (1, "locked")}
}
AT_NIGHT = (pytest.mark.long, pytest.mark.night)


@pytest.mark.long
@pytest.mark.parametrize(
    "sense", ["both", *(pytest.param(sense, marks=AT_NIGHT) for sense in ("task", "joints"))]
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


def test_encoders_resolve_the_path_as_well_as_the_task_sensor_whatever_the_units():
    """Metres of the hand's path are no radians of its joints; a noise that is given is both."""
    rig, _ = designed("hand", "joints")
    gain = rig.mapping(rig.goal).major_gain()
    assert rig.encoder_noise == pytest.approx(rig.noise * np.abs(gain).max())
    np.testing.assert_array_equal(rig.watched.noise, np.full(4, rig.encoder_noise))
    given = robot_rig(file("hand"), replace(options("hand", "both"), noise=3e-6))
    np.testing.assert_array_equal(given.watched.noise, np.full(6, 3e-6))


@pytest.mark.parametrize("words", ["0.5", "1000", "nan", "often", ""])
def test_a_dither_that_is_none_is_refused_in_a_sentence(words):
    with pytest.raises(
        WrongInput, match=r"^dither must be none, default, designed, or a frequency from 2"
    ):
        rig_dither(designed("platform", "both")[0], words)


def test_a_dither_has_the_frequency_asked_for_and_a_task_without_freedom_none():
    design = rig_dither(designed("platform", "both")[0], "7")
    assert design is not None and design.dither.frequency_hz == 7.0
    whole = robot_rig(file("platform"), RobotOptions(major=(2, 3, 4), crossover=0.7))
    assert rig_dither(whole, "designed") is None
    assert rig_dither(whole, "none") is None


# The command.


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("--model ARM --turn 0", "turn must be a number from 0.001 to"),
        ("--model ARM --major 0,9", "major must be different rows from 0 to 5"),
        ("--model ARM --noise -1", "noise must be a number from 1e-15 to 1000, got -1"),
        ("--model ARM --dither often", "dither must be none, default, designed, or a frequency"),
        ("--model ARM --joint-weight 1,2", "joint_weight must be one number or 7, got 2"),
        ("--model ARM --scheduler tcp://there:1", "--scheduler does not go with --model"),
        ("--crossover 0.7", "--crossover needs --model"),
    ],
)
def test_wrong_input_of_the_study_is_a_sentence(words, said, tmp_path, capfd):
    given = words.replace("ARM", str(file("arm"))).split()
    assert main(["recover", "--quick", *given, "--out", str(tmp_path / "out")]) == 2
    error = capfd.readouterr().err
    assert said in error and error.count("\n") == 1
    assert not (tmp_path / "out" / "recover.json").exists()


def test_every_sensing_has_the_same_cases(monkeypatch):
    monkeypatch.setattr(plan, "check_reach", lambda *_: None)
    given = (file("platform"), replace(options("platform", "both"), major=(3, 4)), 4.0)
    [locked], _ = plan.robot_cases(*given, "designed", (), seed=0, quick=True)
    assert locked.isolable and locked.sort == "failure"
    whole, dithers = plan.robot_cases(*given, "none", (), seed=0, quick=False)
    assert len(whole) == 3 * (4 * 3 + 3) and dithers == dict.fromkeys(("task", "joints", "both"))
    assert len({case.seed for case in whole}) == 15
    assert not any(case.isolable for case in whole)


# Events.


def test_cases_of_one_draw_differ_in_what_happens_and_to_which_actuator():
    first = case_of("hand", "both", sort="event")
    cases = list(plan.robot_events(first, EVENTS, plan.ROBOT_EVENTS_EACH, 3))
    assert len(cases) == plan.ROBOT_EVENTS_EACH * len(EVENTS)
    assert len({(case.seed, case.duration_s, case.plane_seed) for case in cases}) == 2
    happens = [case.events[0] for case in cases]
    assert {event.name for event in happens} == set(EVENTS)
    assert {event.actuator for event in happens} == {None, 0, 1, 2, 3}
    for case, event in zip(cases, happens, strict=True):
        assert case.sort == "event" and case.duration_s == pytest.approx(event.time_s + 1.5)


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
def test_the_command_runs_a_robot_and_checks_each_event(tmp_path, faults_of_figures):
    words = ["--model", str(file("hand")), "--major", "3,4", "--events", "--quick"]
    assert main(["recover", *words, "--workers", "1", "--out", str(tmp_path)]) in (0, 1)
    summary = json.loads((tmp_path / "recover.json").read_text())
    events, flown = pd.DataFrame(summary["by_event"]), pd.read_parquet(tmp_path / "recover.parquet")
    assert tuple(events.event) == plan.QUICK_ROBOT_EVENTS
    assert summary["path_size_m"] == summary["path_size"]
    assert faults_of_figures("recover_events") == []
    spoilt = {"by_event": events.assign(counted_worst=[1.0, 1.2, 1.0], ended=[0, 0, 1])}
    failed = [each.where for each in checks(summary, flown, spoilt) if not each.passed]
    assert failed[-2:] == ["sag", "bias"]
    refused = flown.assign(status="refused", message="motor1 has no spring")
    assert notes(refused, spoilt) == ["Not simulated: motor1 has no spring."]
