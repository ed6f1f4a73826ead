"""Every mechanism loses an actuator in a run and goes on, on a plant that is not the model."""

import json
from contextlib import nullcontext
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from experiments.app.cli import main
from experiments.recover import STUDY, plan
from experiments.recover.command import Outcome, run
from experiments.recover.plan import Case, exact_rig
from experiments.recover.results import checks, described
from experiments.recover.row import SCHEMA, row_of
from experiments.rig import Rig
from experiments.rig.dither import rig_dither
from experiments.rig.events import EVENTS, Event
from experiments.rig.mjcf import robot_rig
from experiments.rig.options import DITHER_SIZE, RobotOptions, Sensing
from experiments.study.campaign import Row
from experiments.study.study import Interrupted, WrongInput
from ftc.fdi.dither_design import DitherDesign
from sim import HEXAPOD_MJCF, Failure, FailureKind, Pose

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
    return replace(plan.on_circle(first, 4.0, designed(name, sense)[1]), **happens)


@cache
def row(name: str, sense: Sensing, actuator: int, kind: FailureKind, left_s: float = 2.4) -> Row:
    happens = {"failures": (Failure(actuator, kind, FAILS_S),), "compared": ("informed",)}
    happens["recovered_s"] = plan.recovered_s(designed(name, sense)[0])
    return row_of(case_of(name, sense, duration_s=FAILS_S + left_s, **happens))


def check_goes_on(own: Row) -> None:
    """The first actuator named is the one that failed, and what follows is as an informed one."""
    assert own["right"] and not own["alarm_before"] and not own["healthy_named"], own["report"]
    assert own["task_lost"] == own["lost_rightly"]
    if "rms_informed_after" in own:
        assert own["rms_supervised_after"] < 1.5 * own["rms_informed_after"]


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "sense", "actuator"), [("arm", "task", 3), ("platform", "both", 0)]
)
def test_a_lock_in_a_run_is_named_and_the_run_goes_on(name, sense, actuator):
    check_goes_on(row(name, sense, actuator, "locked", left_s=0.7))


FOUND: dict[str, dict[str, Any]] = {
    "arm": {"actuator": 1, "kind": "free"},
    "hand": {"actuator": 1, "kind": "locked"},
    "platform": {"actuator": 2, "kind": "free"},
    "arms": {"actuator": 1, "kind": "locked"},
}


AT_NIGHT = (pytest.mark.long, pytest.mark.night)


@pytest.mark.long
@pytest.mark.parametrize(
    "sense", ["both", *(pytest.param(sense, marks=AT_NIGHT) for sense in ("task", "joints"))]
)
@pytest.mark.parametrize("name", MAJOR)
def test_every_mechanism_goes_on_whatever_the_diagnosis_sees(name, sense):
    check_goes_on(row(name, sense, **FOUND[name]))


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


def study(folder: Path, stop_at: int = 99, **words: Any) -> list[Row]:
    """Rows of the study of a robot; `words` are those of its options that are not the usual."""

    def interrupt(done: int, _total: int) -> None:
        if done == stop_at:
            raise KeyboardInterrupt

    words = {"crossover": 0.7, "resume": False} | words
    given: dict[str, Any] = {
        option.name: option.checked(words.pop(option.name, option.default), option.flag)
        for option in STUDY.options
    }
    given |= {"seed": 0, "quick": True, "workers": None, **words}
    given |= {"folder": folder, "on_progress": interrupt}
    with run(**given) as outcome:
        assert isinstance(outcome, Outcome)
        files = outcome.done.dataset.files()
        return [row for part in files for row in pq.read_table(part).to_pylist()]


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"turn": 0.0}, "--turn must be from 0.001 to"),
        ({"major": "0,9"}, "--major must be different rows from 0 to 5"),
        ({"noise": -1.0}, "--noise must be from 1e-15 to 1000, got -1"),
        ({"dither": "often"}, "dither must be none, default, designed, or a frequency"),
        ({"joint_weight": "1,2"}, "joint_weight must be one number or 7, got 2"),
        ({"scheduler": "tcp://there:1"}, "--scheduler does not go with --model"),
        ({"model": None}, "--crossover needs --model"),
    ],
)
def test_wrong_input_of_the_study_is_a_sentence(wrong, said, tmp_path):
    with pytest.raises(WrongInput, match=said) as refused:
        study(tmp_path, **{"model": file("arm"), **wrong})
    assert "\n" not in str(refused.value)
    assert not (tmp_path / "recover.json").exists()


def test_a_robot_s_study_goes_on_where_it_was_interrupted(tmp_path, monkeypatch):
    """The rows are those of an uninterrupted one; those of another robot are refused."""
    done: list[int] = []

    def in_this_process(campaign, numbers, _where):
        for number in numbers:
            done.append(number)
            yield campaign.runs[number].parameters()

    monkeypatch.setattr("experiments.recover.command.check_reach", lambda *_: None)
    monkeypatch.setattr(
        "experiments.study.resumable.rows_of", lambda *of: nullcontext(in_this_process(*of))
    )
    platform: dict[str, Any] = {"model": file("platform"), "major": "3,4"}
    [locked] = study(tmp_path / "quick", **platform)
    assert locked["isolable"] and (locked["sense"], locked["sort"]) == ("both", "failure")
    platform |= {"quick": False, "dither": "none"}
    whole = study(tmp_path / "whole", **platform)
    assert len(whole) == 3 * (4 * 3 + 3)
    assert len({row["seed"] for row in whole}) == 15  # those of every sensing are the same
    assert not any(row["isolable"] for row in whole)
    folder = tmp_path / "resumed"
    with pytest.raises(Interrupted, match="7 of 45 runs are kept; --resume continues"):
        study(folder, stop_at=7, **platform)
    with pytest.raises(WrongInput, match=r"another robot, robot_sha256$"):
        study(folder, resume=True, **platform | {"model": file("hand"), "size": 1e-3})
    done.clear()
    assert study(folder, resume=True, **platform) == whole
    assert done == list(range(7, 45))


# Events.


def test_cases_of_one_draw_differ_in_what_happens_and_to_which_actuator():
    first = case_of("hand", "both", sort="event")
    cases = list(plan.robot_events(first, EVENTS, plan.ROBOT_EVENTS_EACH, 3))
    assert len(cases) == plan.ROBOT_EVENTS_EACH * len(EVENTS)
    assert len({(case.seed, case.duration_s, case.course) for case in cases}) == 2
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
    assert flown.keys() <= set(SCHEMA.names)
    assert (flown["status"], flown["first_actuator"], flown["right"]) == ("flown", "motor2", True)
    assert flown["rms_supervised_after"] < flown["rms_unaware_after"]
    refused = row_of(case_of("hand", "both", events=(spring,), **happens))
    assert refused["status"] == "refused" and "no spring" in refused["message"]


@pytest.mark.long
def test_the_command_runs_a_robot_and_checks_each_event(tmp_path, faults_of_figures):
    words = ["--model", str(file("hand")), "--major", "3,4", "--events", "--quick"]
    assert main(["recover", *words, "--workers", "1", "--out", str(tmp_path)]) in (0, 1)
    summary = json.loads((tmp_path / "recover.json").read_text())
    assert tuple(each["event"] for each in summary["by_event"]) == plan.QUICK_ROBOT_EVENTS
    assert (tmp_path / "recover.md").read_text() == described(summary).markdown()
    assert (
        summary["path_size_m"] == summary["path_size"] and "in um" in described(summary).markdown()
    )
    assert faults_of_figures("recover_events") == []
    spoilt = json.loads(json.dumps(summary))
    spoilt["by_event"][1]["counted_worst"], spoilt["by_event"][2]["ended"] = 1.2, 1
    spoilt |= {"refused": ["motor1 has no spring"]}
    failed = [each.where for each in checks(spoilt) if not each.passed]
    assert failed[-2:] == ["sag", "bias"]
    assert "Not simulated: motor1 has no spring." in described(spoilt).markdown()
