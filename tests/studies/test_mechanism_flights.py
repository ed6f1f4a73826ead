"""Every mechanism loses an actuator in flight and goes on, on a plant that is not the model."""

import json
from contextlib import nullcontext
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, cast

import numpy as np
import pyarrow.parquet as pq
import pytest

from experiments.recover.mechanism_flight import MechanismFlight, MechanismFlown, fly
from experiments.recover.mechanism_results import described, summarize
from experiments.recover.mechanism_row import SCHEMA, flown_row
from experiments.recover.mechanisms import Mechanisms, run_mechanisms
from experiments.rig import Rig
from experiments.rig.dither import rig_dither
from experiments.rig.mjcf import robot_rig
from experiments.rig.options import DITHER_SIZE, RobotOptions, Sensing
from experiments.study.campaign import Row, table_of
from experiments.study.files import json_text
from experiments.study.study import Interrupted, WrongInput
from ftc.fdi.dither_design import DitherDesign
from sim import HEXAPOD_MJCF, Failure, FailureKind, Pose

MAJOR = {"arm": (0, 1), "hand": (3, 4), "platform": (3, 4), "arms": (3, 4, 5)}
STRUCK_S = 1.2


def file(name: str):
    return HEXAPOD_MJCF.with_name(f"{name}.xml")


def options(name: str, sense: Sensing) -> RobotOptions:
    return RobotOptions(major=MAJOR[name], sense=sense, crossover=0.7)


@cache
def designed(name: str, sense: Sensing) -> tuple[Rig, DitherDesign]:
    rig = robot_rig(file(name), options(name, sense)).drawn("all", 5)
    design = rig_dither(rig, "designed")
    assert design is not None
    return rig, design


@cache
def flown(
    name: str, sense: Sensing, actuator: int, kind: FailureKind | None, left_s: float = 2.4
) -> MechanismFlown:
    failure = None if kind is None else Failure(actuator, kind, STRUCK_S)
    dither = designed(name, sense)[1].dither
    how = options(name, sense)
    seen = how, dither, failure, kind is not None, 4.0, STRUCK_S + left_s
    return fly(MechanismFlight(0, file(name), *seen, seed=5))


def check_goes_on(one: MechanismFlown) -> None:
    """The first actuator named is the one that failed, and what follows is as an informed one."""
    found = one.found
    assert found.strut_right, [each.fault for each in found.diagnoses]
    assert not found.alarm_before
    assert not found.sound_named
    assert found.task_lost == found.lost_rightly
    after = one.rms[1]
    if one.rms_informed is not None:
        assert after is not None
        assert after < 1.5 * one.rms_informed


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "sense", "actuator"), [("arm", "task", 3), ("platform", "both", 0)]
)
def test_a_lock_in_flight_is_named_and_the_flight_goes_on(name, sense, actuator):
    check_goes_on(flown(name, sense, actuator, "locked", left_s=0.7))


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
    check_goes_on(flown(name, sense, **FOUND[name]))


@pytest.mark.long
@pytest.mark.parametrize("name", MAJOR)
def test_no_sound_actuator_is_named_while_nothing_fails(name):
    one = flown(name, "both", 0, None)
    assert not one.found.diagnoses
    assert one.rms[1] is None and one.rms_informed is None


@pytest.mark.parametrize(("name", "sense"), [("arm", "task"), ("hand", "joints")])
def test_a_dither_keeps_to_its_size_and_moves_the_task_as_designed(name, sense):
    """The actuators follow it, in MuJoCo, no further than it says; the task by dynamics alone."""
    rig, design = designed(name, sense)
    exact = robot_rig(file(name), options(name, sense))
    time_s = np.arange(1500) * rig.period_s
    bench = exact.bench(time_s, [], 0)
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


def study(folder: Path, stop_at: int = 99, **words: Any) -> list[Row]:
    """Rows of the study of a robot; `words` are those of its options that are not the usual."""

    def interrupt(done: int, _total: int) -> None:
        if done == stop_at:
            raise KeyboardInterrupt

    usual = {"seed": 0, "quick": True, "turn": 4.0, "dither": "designed", "crossover": 0.7}
    usual |= {"folder": folder, "workers": None, "resume": False, "on_progress": interrupt}
    with run_mechanisms(**usual | words) as outcome:
        assert isinstance(outcome, Mechanisms)
        return [row for part in outcome.done.dataset.files() for row in rows_of(part)]


def rows_of(part: Path) -> list[Row]:
    return pq.read_table(part).to_pylist()


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"turn": 0.0}, "--turn must be from 0.001 to"),
        ({"major": "0,9"}, "--major must be different rows from 0 to 5"),
        ({"noise": -1.0}, "--noise must be from 1e-15 to 1000, got -1"),
        ({"dither": "often"}, "--dither must be none, default, designed, or a frequency"),
        ({"joint_weight": "1,2"}, "--joint-weight must be one number or 7, got 2"),
    ],
)
def test_wrong_input_of_the_study_is_a_sentence(wrong, said, tmp_path):
    words: dict[str, Any] = {"turn": 4.0, "dither": "designed", "crossover": 0.7} | wrong
    with pytest.raises(WrongInput, match=said) as refused:
        study(tmp_path, model=file("arm"), **words)
    assert "\n" not in str(refused.value)
    assert not (tmp_path / "recover.json").exists()


@pytest.mark.long
def test_the_tables_count_what_the_flights_say():
    """A flight that was found, one taken for another and one without failure, each in its row."""
    right = flown("platform", "both", 0, "locked", left_s=1.6)  # 1.4 s are recovery
    rig, design = designed("platform", "both")
    other = replace(right.found.diagnoses[0].fault, actuator=1)
    mistaken = replace(right.found.diagnoses[0], fault=other)
    wrong = replace(right, found=replace(right.found, diagnoses=(mistaken,), standing=(mistaken,)))
    none = replace(
        right,
        flight=replace(right.flight, failure=None),
        found=replace(right.found, failures=(), struck=(), diagnoses=(), standing=()),
        rms=(0.02, None),
        rms_informed=None,
    )
    outcome = Mechanisms(cast(Any, None), "sha", {"both": rig}, {"both": design})
    counted = [flown_row(each) for each in (right, wrong, none)]
    lost = counted[0] | {"status": "diverged"}
    found = described(summarize(outcome, read_back(counted)))
    rows = {each["kind"]: each for each in found.summary["sensed"]}
    locked = rows["locked"]
    assert (locked["flights"], locked["right"], locked["sound_named"]) == (2, 1, 1)
    assert (locked["isolable"], locked["isolable_right"], locked["named"]) == (2, 1, 2)
    assert rows["none"]["flights"] == 1 and rows["free"]["flights"] == 0
    assert locked["rms_over_informed"]["flights"] == 2
    assert any("was taken for motor2" in note for note in found.notes)
    assert json.loads(json_text(found.summary))["robot"] == "planar platform on four legs"
    assert found.failed_check is None
    assert "task sensor" not in found.markdown()
    more = described(summarize(outcome, read_back([*counted, lost])))
    assert more.summary["sensed"] == found.summary["sensed"]
    assert more.failed_check is not None
    assert more.failed_check.endswith("number of flights that diverged is 1, expected below 1")


def read_back(rows: list[Row]) -> list[Row]:
    """As from the dataset: what a row lacks is null."""
    return table_of(rows, SCHEMA).to_pylist()


def test_a_robot_s_study_goes_on_where_it_was_interrupted(tmp_path, monkeypatch):
    """The rows are those of an uninterrupted one; those of another robot are refused."""
    done: list[int] = []

    def in_this_process(campaign, numbers, _where):
        for number in numbers:
            done.append(number)
            flight = campaign.runs[number]
            yield {"case": number, "seed": flight.seed, "isolable": flight.isolable}

    monkeypatch.setattr("experiments.recover.mechanisms.SENSINGS", ("task", "both"))
    monkeypatch.setattr("experiments.recover.mechanisms.check_reach", lambda *_: None)
    monkeypatch.setattr(
        "experiments.study.resumable.rows_of", lambda *of: nullcontext(in_this_process(*of))
    )
    platform: dict[str, Any] = {"model": file("platform"), "major": "3,4"}
    [locked] = study(tmp_path / "quick", **platform)
    assert locked["isolable"]
    platform |= {"quick": False, "dither": "none"}
    whole = study(tmp_path / "whole", **platform)
    assert len(whole) == 2 * (4 * 3 + 3)
    assert len({row["seed"] for row in whole}) == 15  # those of every sensing are the same
    assert not any(row["isolable"] for row in whole)
    folder = tmp_path / "resumed"
    with pytest.raises(Interrupted, match="7 of 30 runs are kept; --resume continues"):
        study(folder, stop_at=7, **platform)
    with pytest.raises(WrongInput, match=r"another robot, robot_sha256$"):
        study(folder, resume=True, **platform | {"model": file("hand"), "size": 1e-3})
    done.clear()
    assert study(folder, resume=True, **platform) == whole
    assert done == list(range(7, 30))
