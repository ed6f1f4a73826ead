"""`fjh survey`: each number is what one condition has alone, and the report follows its subject."""

import csv
import shlex
from dataclasses import replace
from itertools import product
from math import comb
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linprog
from scipy.spatial import ConvexHull, QhullError

from experiments.app.cli import main
from fjh.rig.conditions import FREE, LOCKED, few_failures, in_words, with_failures
from fjh.rig.examined import LEAST_LEFT, Examined, directions_in_words, examine
from fjh.rig.options import RobotOptions
from fjh.rig.robot import robot_of
from fjh.survey.conditions import Survey, actuator_frame, checks, condition_frame, surveyed
from fjh.survey.page import headline
from fjh.survey.subject import matrix_subject, robot_subject
from prioritized import ConstrainedSystem
from sim import MODELS, assemble
from tests.pages import assert_prints, blocks
from tests.random_systems import SEEDS, systems

HERE = {"site": "payload", "axes": "base", "major": "0,1"}


def of_robot(
    file: Path, postures: int = 0, seed: int = 0, lower=None, upper=None, **options: Any
) -> Survey:
    given: dict[str, Any] = HERE | options
    subject = robot_subject(file, RobotOptions(**given), lower, upper)
    return surveyed(subject, postures, seed, lambda done, total: None)


def of_matrix(file: Path, *, lower=None, upper=None, major=None, hold=None) -> Survey:
    subject = matrix_subject(file, lower, upper, major, hold)
    return surveyed(subject, 0, 0, lambda done, total: None)


def conditions(found: Survey) -> pd.DataFrame:
    return condition_frame(found).set_index("failed")


def speeds(examined: Examined) -> np.ndarray:
    """The worst speeds, which were computed."""
    assert examined.left.worst_speed is not None
    return examined.left.worst_speed


def written(file: Path, B: np.ndarray) -> Path:
    np.savetxt(file, B, delimiter=",")
    return file


@given(systems(actives=(2, 3), tasks=(1, 3)), st.data())
def test_each_condition_is_what_it_is_alone(drawn, data):
    """By classification and attainable set of one condition, which share none of the batches.

    What is left of the speed decides, with the gains that stand for the force.
    """
    system, n, m = drawn.system, len(drawn.system.active), len(drawn.system.J_T)
    major = data.draw(st.lists(st.integers(0, m - 1), min_size=1, unique=True))
    limits = -drawn.rng.uniform(0.5, 2, n), drawn.rng.uniform(0.5, 2, n)
    codes = few_failures(n)
    examined = examine(system, major, codes, rates=limits)
    sound = precision = 0.0
    for row, code in enumerate(codes):
        locked, free = (np.flatnonzero(code == kind) for kind in (LOCKED, FREE))
        kin = system.with_failures(locked, free).kinematics()
        report = kin.manipulability(major)
        lost = report.unmanipulable or report.unstable_major
        radius = 0.0 if lost else kin.attainable(major, limits).radius
        if row == 0:
            sound, precision = radius, report.largest_gain
        share = min(radius / sound, precision / report.largest_gain) if sound and not lost else 0.0
        if abs(share - LEAST_LEFT) > 1e-9:
            assert examined.survived[row] == (share > LEAST_LEFT)
        np.testing.assert_allclose(speeds(examined)[row], radius, rtol=1e-7, atol=1e-9)
        if not lost:
            assert examined.largest_gain[row] == pytest.approx(1 / report.worst_gain, rel=1e-6)
            assert examined.error_gain[row] == pytest.approx(report.largest_gain, rel=1e-6)


@given(SEEDS, st.integers(1, 3), st.integers(0, 4), st.integers(1, 3))
def test_no_robot_exceeds_the_mean_square_over_all_sets_of_locks(seed, m, more, i):
    """Ukidve, McInroy and Jafari (2008): the mean square is C(n - i, m) / C(n, m), exactly."""
    n = m + more
    system = ConstrainedSystem(np.random.default_rng(seed).normal(size=(m, n)), None, range(n))
    codes = np.vstack([with_failures(n, 0), with_failures(n, min(i, n))])
    codes = codes[~(codes == FREE).any(axis=1)]
    examined = examine(system, range(m), codes)
    mean = (examined.relative_manipulability[1:] ** 2).mean()
    bound = comb(n - min(i, n), m) / comb(n, m)
    assert mean == pytest.approx(bound, rel=1e-9, abs=1e-12)
    np.testing.assert_allclose(examined.best_possible[1:] ** 2, bound, atol=1e-12)


B = np.random.default_rng(3).normal(size=(3, 5))


@pytest.mark.filterwarnings("error")
def test_actuators_in_another_order_have_the_same_report(tmp_path):
    order = [3, 0, 4, 1, 2]
    names = [f"a{k}" for k in range(5)]
    found = []
    for columns in (range(5), order):
        with (tmp_path / "B.csv").open("w") as stream:
            rows = csv.writer(stream)
            rows.writerow([names[k] for k in columns])
            rows.writerows(B[:, list(columns)])
        survey = of_matrix(tmp_path / "B.csv")
        of_failures = condition_frame(survey)
        of_failures.index = [
            (*sorted(locked), "|", *sorted(free))
            for locked, free in zip(of_failures.locked, of_failures.free, strict=True)
        ]
        keys = ["worst_effect", "relative_manipulability", "largest_gain", "survived"]
        found.append((of_failures[keys], actuator_frame(survey).set_index("actuator")))
    (one, of_one), (other, of_other) = found
    pd.testing.assert_frame_equal(one, other.loc[one.index], rtol=1e-9)
    pd.testing.assert_frame_equal(of_one, of_other.loc[of_one.index], rtol=1e-9)


def test_other_units_of_the_effects_change_effects_and_gains_alone(tmp_path):
    one = conditions(of_matrix(written(tmp_path / "one.csv", B)))
    ten = conditions(of_matrix(written(tmp_path / "ten.csv", 10 * B)))
    factors = {"worst_effect": 10, "error_gain": 10, "largest_gain": 0.1}
    for key in ("effect_left", "relative_manipulability", "best_possible", "survived", *factors):
        expected = factors.get(key, 1) * one[key]
        np.testing.assert_allclose(ten[key], expected, rtol=1e-9, err_msg=key)


PLACE = np.deg2rad(60 * np.arange(6))


def hexarotor(file: Path, turns: str) -> Path:
    """Lift, roll, pitch, yaw per thrust, as in examples/multirotor.py."""
    drag = 0.1 * np.array([1 if turn == "P" else -1 for turn in turns])
    rows = [np.ones(6), 0.275 * np.sin(PLACE), -0.275 * np.cos(PLACE), drag]
    return written(file, np.array(rows))


def test_a_hexarotor_hovers_without_a_rotor_only_if_some_neighbours_turn_alike(tmp_path):
    """Du, Quan, Yang and Cai, JGCD 38 (2015)."""
    hover = {"lower": "0", "upper": "6.125", "hold": f"{1.535 * 9.8},0,0,0"}
    for turns, kept in {"PNPNPN": 6 * [False], "PPNNPN": 4 * [True] + 2 * [False]}.items():
        start = of_matrix(hexarotor(tmp_path / "B.csv", turns), **hover).start
        assert start.survived[0]
        assert start.survived[start.singles[:, FREE - LOCKED]].tolist() == kept


def test_what_is_left_about_a_held_effect_is_what_a_linear_program_reaches(tmp_path):
    """A locked rotor keeps its thrust, a free one has none; the others have 0 to 6 N."""
    rng, held = np.random.default_rng(0), np.array([15.0, 0.1, 0, 0])
    file = hexarotor(tmp_path / "B.csv", "PPNNPN")
    found = of_matrix(file, lower="0", upper="6", hold="15,0.1,0,0")
    B = found.subject.system.J_T
    rest = np.linalg.pinv(B) @ held
    assert (rest > 0).all() and (rest < 6).all()
    directions = rng.normal(size=(60, 4))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    for row in (0, 1, 2, 14):
        code, reached = found.start.codes[row], []
        stuck = np.where(code == FREE, 0.0, rest)
        low, high = np.where(code, stuck, 0.0), np.where(code, stuck, 6.0)
        bounds = np.column_stack([[*low, 0.0], [*high, np.inf]])
        for direction in directions:
            A = np.column_stack([B, -direction])
            best = linprog([0] * 6 + [-1], A_eq=A, b_eq=held, bounds=bounds)
            reached.append(best.x[-1] if best.success else 0.0)
        radius = speeds(found.start)[row]
        assert min(reached) >= radius * (1 - 1e-9)
        assert radius == 0.0 or min(reached) < 2 * radius


def room(columns: np.ndarray, low: np.ndarray, high: np.ndarray, held: np.ndarray) -> float:
    """Radius of the ball about what is held, from the hull of what the ends of all limits do."""
    ends = np.array([columns @ each for each in product(*zip(low, high, strict=True))]) - held
    try:
        return max(0.0, -ConvexHull(np.unique(ends, axis=0)).equations[:, -1].max())
    except QhullError:  # they are in a plane
        return 0.0


@pytest.mark.parametrize("seed", [0, 3, 7])
def test_a_hexarotor_that_was_measured_has_lost_what_leaves_no_hundredth(tmp_path, seed):
    """On the drawing yaw goes with two rotors (Du et al.); some mm off it has rank, and no room."""
    rng, held = np.random.default_rng(seed), np.array([7.2, 0, 0, 0])
    rows = [np.ones(6), 0.45 * np.sin(PLACE), -0.45 * np.cos(PLACE), 0.05 * (-1.0) ** np.arange(6)]
    drawn = np.array(rows)
    drawn[1:3] += 0.006 * rng.normal(size=(2, 6))
    limits = {"lower": "0", "upper": "4", "hold": "7.2,0,0,0"}
    found = of_matrix(written(tmp_path / "B.csv", drawn), **limits)
    rest, zero, told = np.linalg.pinv(drawn) @ held, np.zeros(6), conditions(found)
    sound = room(drawn, zero, zero + 4, held)
    for code, each in zip(found.start.codes, told.itertuples(), strict=True):
        stuck = np.where(code == LOCKED, rest, 0.0)
        left = room(drawn, stuck, np.where(code, stuck, 4.0), held) / sound
        assert each.survived == (left > LEAST_LEFT == 0.01), each
        assert each.effect_left == pytest.approx(left, abs=1e-8)
    assert (told.major_task == "nearly lost").any()


TENDONS = """
<mujoco><option gravity="0 0 0"/><worldbody><body><joint name="x" type="slide" axis="1 0 0"/>
  <joint name="y" type="slide" axis="0 1 0"/><geom size="0.1"/><site name="tip"/></body></worldbody>
  <tendon><fixed name="a"><joint joint="x" coef="1"/></fixed><fixed name="b">
  <joint joint="x" coef="1"/><joint joint="y" coef="{near}"/></fixed>
  <fixed name="c"><joint joint="y" coef="1"/></fixed></tendon>
  <actuator><motor tendon="a"/><motor tendon="b"/><motor tendon="c"/></actuator></mujoco>
"""


@pytest.mark.parametrize("near", [0.002, 0.1])
def test_a_robot_whose_force_is_gone_has_lost_the_task_although_its_speed_is_there(tmp_path, near):
    """Tendons a and b are nearly parallel, and alone when c is limp."""
    (tmp_path / "tendons.xml").write_text(TENDONS.format(near=near))
    found = of_robot(tmp_path / "tendons.xml", site="tip", axes=None, major="3,4")
    pulls = np.array([[1, 1, 0], [0, near, 1]])
    one = np.ones(3)
    sound = room(pulls, -one, one, np.zeros(2))
    force = room(pulls[:, :2], -one[:2], one[:2], np.zeros(2)) / sound
    each = conditions(found).loc["c free"]
    assert each.force_left == pytest.approx(force, rel=1e-6) and each.speed_left >= 0.999
    assert each.survived == (force > 0.01) == (near == 0.1)


@pytest.mark.parametrize(("hold", "advice"), [(None, "(--hold)"), ("40,0,0,0", "hold less")])
def test_inputs_without_room_about_rest_are_said_to_have_none(tmp_path, hold, advice):
    """Thrusts from 0 have none about zero; six of 6 N do not carry 40 N."""
    found = of_matrix(hexarotor(tmp_path / "B.csv", "PPNNPN"), lower="0", upper="6", hold=hold)
    assert found.start.verdict(0) == "no room"
    assert headline(found.subject, found.start).endswith(f"{advice}.")


def test_a_matrix_is_the_same_with_names_and_without(tmp_path):
    texts = {
        "bare.csv": "1,2,0\n0,1,3\n",
        "header.csv": "a,b,c\n1,2,0\n0,1,3\n",
        "names.csv": "x,1,2,0\ny,0,1,3\n",
        "both.csv": ",a,b,c\nx,1,2,0\ny,0,1,3\n",
        "corner.csv": "a,b,c\nx,1,2,0\ny,0,1,3\n",
        "blanks.txt": "# from somewhere\n1 2 0\n\n0 1 3\n",
        "semicolons.csv": "a;b;c\n1;2;0\n0;1;3\n",
        "tabs.tsv": "\ufeffa\tb\tc\n1\t2\t0\n0\t1\t3\n",
    }
    for name, text in texts.items():
        (tmp_path / name).write_text(text)
        subject = of_matrix(tmp_path / name).subject
        np.testing.assert_array_equal(subject.system.J_T, [[1, 2, 0], [0, 1, 3]])
        has_header = "a" in text.splitlines()[0] and "b" in text.splitlines()[0]
        assert subject.actuators == (tuple("abc") if has_header else ("u1", "u2", "u3"))
        assert subject.rows == (tuple("xy") if "x," in text else ("row 0", "row 1"))
        assert subject.major == (0, 1)
    assert of_matrix(tmp_path / "both.csv", major="y").subject.major == (1,)


WRONG = {
    "": "has no numbers",
    "a,b,c\n": "has no numbers",
    "1,2\n3\n": "row 2, column 2 must be a number below",
    "1,2\n3,4,5\n": "cannot be read: Error tokenizing",
    "1,2\n3,x\n": "row 2, column 2 must be a number",
    "1,nan\n": "row 1, column 2 must be a number",
    "1,inf\n": "row 1, column 2 must be a number",
    "1,2,inf\n": "row 1, column 3 must be a number",
    "nan,1\nnan,2\n": "row 1, column 1 must be a number",
    "1,2\nx,3\n": "row 2, column 1 must be a number",
    "1,,2\n": "row 1, column 2 must be a number",
    "a,a\n1,2\n": "names of columns must differ",
    "x,1,2\nx,3,4\n": "names of rows must differ",
    "a,b,c,d\n1,2\n": "the first row has 4 names for 2 columns",
    "a,b\n1,2,3\n": "the first row has 2 names for 3 columns",
    f"a,b\n1,{'2' * 100_000}\n": "row 1, column 2 must be a number",
    "1," * 200 + "1\n": "1 to 200 rows",
}


@pytest.mark.parametrize("text", WRONG, ids=lambda text: repr(text)[:40])
def test_a_file_that_is_no_matrix_is_refused_in_one_sentence(tmp_path, capsys, text):
    file = tmp_path / "B.csv"
    file.write_text(text)
    assert main(["survey", "--matrix", str(file), "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert WRONG[text] in " ".join(said.split()) and "B.csv" in said
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--lower", "1", "--upper", "-1"], "--lower of u1 is above its --upper: 1 > -1"),
        (["--lower", "nan"], "--lower must be 1 or 5 numbers below"),
        (["--upper", "missing.csv"], "--upper: there is no file"),
        (["--upper", "L.csv"], "with 3"),
        (["--hold", "1"], "--hold must be 2 numbers"),
        (["--hold", "1,x"], "--hold: there is no file"),
        (["--major", "2"], "--major must be different rows from 0 to 1 or of row 0,row 1"),
        (["--major", "0,0"], "--major must be different rows"),
        (["--site", "tip"], "--site is for a robot"),
        (["--postures", "-1"], "'--postures': Input should be greater"),
    ],
)
def test_what_a_matrix_cannot_be_asked_is_refused(tmp_path, capsys, monkeypatch, words, said):
    monkeypatch.chdir(tmp_path)
    written(tmp_path / "B.csv", B[:2])
    written(tmp_path / "L.csv", np.ones((1, 3)))
    assert main(["survey", "--matrix", "B.csv", *words]) == 2
    assert said in " ".join(capsys.readouterr().err.split())


def test_limits_come_from_files_of_numbers_in_a_row_or_a_column(tmp_path):
    file = written(tmp_path / "B.csv", B)
    upper = written(tmp_path / "U.csv", np.arange(1.0, 6.0)[None])
    column = written(tmp_path / "V.csv", np.arange(1.0, 6.0)[:, None])
    found = [of_matrix(file, lower="-1", upper=str(each)).start for each in (upper, column)]
    np.testing.assert_array_equal(speeds(found[0]), speeds(found[1]))
    kin = ConstrainedSystem(B, None, range(5)).kinematics()
    radius = kin.attainable(range(3), (-1, range(1, 6))).radius
    assert speeds(found[0])[0] == pytest.approx(radius)


def test_29_actuators_get_singles_and_doubles_and_a_sentence(tmp_path):
    file = written(tmp_path / "B.csv", np.random.default_rng(0).normal(size=(3, 29)))
    found = of_matrix(file, major="0")
    assert found.counts.conditions.tolist() == [1, 2 * 29, 4 * comb(29, 2)]
    (sentence,) = found.left_out()
    assert "at most 2 failures (1,683)" in sentence


def test_a_matrix_is_the_same_in_parts(tmp_path, monkeypatch):
    file = written(tmp_path / "B.csv", np.random.default_rng(0).normal(size=(4, 12)))
    whole = of_matrix(file).start
    monkeypatch.setattr("fjh.rig.examined._AT_ONCE", 12**2 * 10)
    parts = of_matrix(file).start
    np.testing.assert_array_equal(parts.survived, whole.survived)
    np.testing.assert_array_equal(speeds(parts), speeds(whole))


def test_of_few_actuators_every_condition_is_counted():
    found = of_robot(MODELS / "hand.xml", major="3,4")
    counts = found.counts.set_index("failures")
    assert counts.conditions.tolist() == [1, 8, 24, 32, 16]
    for failures in (1, 2):
        survived = found.start.survived[found.start.failures == failures].sum()
        assert counts.survived[failures] == survived
    assert list(found.left_out()) == []


def test_conditions_come_in_the_order_of_the_actuators_locked_before_free():
    expected = [[0, 0], [1, 0], [2, 0], [0, 1], [0, 2], [1, 1], [1, 2], [2, 1], [2, 2]]
    assert few_failures(2).tolist() == expected
    assert with_failures(3, 2)[[0, 4, 8]].tolist() == [[1, 1, 0], [1, 0, 1], [0, 1, 1]]


def test_the_arm_keeps_pointing_with_any_joint_locked_and_with_none_free_but_the_last():
    """A free joint turns the camera by itself, except the last, whose axis is the line of sight."""
    start = of_robot(MODELS / "arm.xml").start
    assert start.survived[start.singles[:, 0]].all()
    assert start.survived[start.singles[:, 1]].tolist() == 6 * [False] + [True]
    assert {start.verdict(row) for row in start.singles[:6, 1]} == {"drifts"}
    assert start.speed_left[start.singles[6]] == pytest.approx(1.0, rel=1e-9)


def test_postures_are_within_the_joint_ranges_and_closed():
    found = of_robot(MODELS / "platform.xml", 8, major="3,4")
    robot = found.subject.robot
    assert robot is not None and 0 < len(found.postures) <= 8
    for qpos in found.postures.qpos:
        data = assemble(robot.scene.own)
        data.qpos[:] = qpos
        np.testing.assert_allclose(assemble(robot.scene.own, data).qpos, qpos, atol=1e-8)
    assert len(found.rows) == (1 + len(found.postures)) * len(found.start.codes)


def test_over_postures_are_the_numbers_of_surveys_that_start_there():
    """Median, worst and share of an arm's conditions, by another start for each posture."""
    found = of_robot(MODELS / "arm.xml", 3)
    robot, own = found.subject.robot, []
    assert robot is not None
    for qpos in (np.array(robot.scene.start.qpos), *found.postures.qpos):
        there = robot_of(MODELS / "arm.xml", robot.options, qpos, settle=False)
        system = ConstrainedSystem.of(there.rigid.nominal)
        own.append(examine(system, (0, 1), found.start.codes, rates=found.subject.rates))
    told = condition_frame(found)
    name = "worst_speed_rad_per_s"
    elsewhere = np.array([speeds(each) for each in own[1:]])
    survived = np.array([each.speed_left > LEAST_LEFT for each in own])
    expected = {
        f"{name}_median_over_postures": np.median(elsewhere, axis=0),
        f"{name}_least_over_postures": elsewhere.min(axis=0),
        "share_of_postures": survived.mean(axis=0),
    }
    for key, values in expected.items():
        np.testing.assert_allclose(told[key], values, rtol=1e-7, atol=1e-9, err_msg=key)


def test_a_seed_draws_the_same_postures_again_and_another_draws_others():
    one, again, other = (of_robot(MODELS / "arm.xml", 4, seed) for seed in (1, 1, 2))
    pd.testing.assert_frame_equal(one.rows, again.rows)
    assert not np.allclose(np.stack(one.postures.qpos), np.stack(other.postures.qpos))


STRETCHED = """
<mujoco model="stretched"><compiler angle="radian"/><worldbody>
  <body><joint name="a" axis="0 0 1"/><geom size="0.1"/>
    <body pos="1 0 0"><joint name="b" axis="0 0 1" range="0 2"/><geom size="0.1"/>
      <body pos="1 0 0"><joint name="c" axis="0 0 1" range="0 2"/><geom size="0.1"/>
        <site name="tip" pos="1 0 0"/></body></body></body></worldbody>
  <actuator>
    <velocity name="A" joint="a" kv="3" gear="2" ctrlrange="-1 1"/>
    <velocity name="B" joint="b" kv="3" ctrlrange="-1 3"/>
    <motor name="C" joint="c" ctrlrange="-7 7"/></actuator></mujoco>
"""


def test_at_a_singular_start_the_best_posture_stands_for_it(tmp_path):
    """A planar arm stretched out cannot move its tip along itself; bent it can."""
    file = tmp_path / "stretched.xml"
    file.write_text(STRETCHED)
    words = {"site": "tip", "axes": None, "major": "3,4"}
    alone, found = (of_robot(file, count, **words) for count in (0, 8))
    assert alone.start.verdict(0) == "one direction" and alone.subject.instead is None
    robot, sound = found.subject.robot, found.rows[found.rows.condition == 0].iloc[1:]
    assert found.start.survived[0] and robot is not None and sound.survived.all()
    best = int(np.argmin(sound.largest_gain_rad_per_m))
    np.testing.assert_allclose(robot.scene.own_start.qpos, found.postures.qpos[best])
    assert found.start.largest_gain[0] == pytest.approx(sound.largest_gain_rad_per_m.iloc[best])
    assert f"posture {best + 1} " in str(found.subject.instead)


def test_velocity_actuators_limit_rates_and_gears_count(tmp_path):
    file = tmp_path / "stretched.xml"
    file.write_text(STRETCHED)
    words = {"site": "tip", "axes": None, "major": "4"}
    found = of_robot(file, **words)
    subject, sound = found.subject, conditions(found).loc["sound"]
    assert np.isnan(sound.worst_speed_m_per_s) and sound.speed_left == 1.0
    np.testing.assert_allclose(subject.rates, [[-0.5, -1, -np.inf], [0.5, 3, np.inf]])
    assert subject.sources["rates"] is not None and subject.torques is not None
    np.testing.assert_allclose(subject.torques[1], [np.inf, np.inf, 7])
    given = of_robot(file, lower="-2", upper="2", **words).subject
    np.testing.assert_array_equal(given.rates, [[-2] * 3, [2] * 3])


def test_what_is_not_possible_without_failures_is_said_with_what_helps():
    words = {"site": "front_left", "axes": None, "major": "3,4,5"}
    found = of_robot(MODELS / "quadruped.xml", **words)
    assert "pin what stands (--pinned)" in headline(found.subject, found.start)
    assert not actuator_frame(found).costs_most.any()


def test_every_check_fails_on_spoilt_numbers(tmp_path):
    found = of_matrix(written(tmp_path / "B.csv", B))
    start, left = found.start, found.start.left
    assert [each.passed for each in checks(found.subject, start)] == [True, True]
    verdicts = replace(start, left=replace(left, possible=~left.possible))
    numbers = replace(start, left=replace(left, worst_speed=speeds(start) * (1 + 1e-5)))
    for k, spoilt in enumerate((verdicts, numbers)):
        assert [each.passed for each in checks(found.subject, spoilt)] == [k != 0, k != 1]


def test_a_robot_and_a_matrix_at_once_are_refused(tmp_path, capsys):
    file = written(tmp_path / "B.csv", B)
    assert main(["survey", str(MODELS / "arm.xml"), "--matrix", str(file)]) == 2
    assert "one of them is surveyed at a time" in " ".join(capsys.readouterr().err.split())
    assert main(["survey", "--hold", "1"]) == 2
    assert "--hold is for a matrix" in capsys.readouterr().err


def test_directions_and_conditions_in_words():
    rows = ["turn z", "x", "y", "z"]
    assert directions_in_words(np.zeros((4, 0)), rows) == "nothing"
    assert directions_in_words(np.eye(4)[:, [2]], rows) == "y"
    both = np.column_stack([np.eye(4)[1], np.array([0.6, 0, 0, -0.8])])
    assert directions_in_words(both, rows) == "x; 0.6 turn z - 0.8 z"
    assert in_words([0, 0], ["a", "b"]) == "sound"
    assert in_words([1, 2, 1], ["a", "b", "c"]) == "a and c locked, b free"


def test_the_page_prints_what_the_command_says(tmp_path, monkeypatch, capfd):
    page = (Path(__file__).parents[3] / "docs" / "survey.md").read_text()
    assert len(page.splitlines()) <= 100
    (matrix,) = (content for language, content in blocks(page) if language == "none")
    (said,) = (content for language, content in blocks(page) if language == "text")
    commands = [content for language, content in blocks(page) if language == "sh"]
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "120")
    (tmp_path / "rotors.csv").write_text(matrix)
    assert main(shlex.split(commands[1])[1:]) == 0
    *_, printed = capfd.readouterr().out.partition("What the failures")
    title, table, *_, sentences, _ = printed.strip().split("\n\n")
    assert_prints(f"What the failures {title}\n{table}\n{sentences}", said)
