"""Numbers of `fjh survey` equal those of conditions analyzed one by one."""

from dataclasses import replace
from math import comb

import numpy as np
import pandas as pd
import pytest

from fjh.rig.condition_analysis import LEAST_LEFT, analyze_conditions
from fjh.rig.conditions import FREE, LOCKED
from fjh.rig.robot import robot_of
from fjh.survey.conditions import actuator_frame, checks, condition_frame
from fjh.survey.page import headline
from prioritized import ConstrainedSystem
from sim import MODELS, assemble
from tests.fjh.survey.surveys import conditions, matrix_file, of_matrix, of_robot, speeds
from tests.published.faces import distances, effectiveness
from tests.robots import TEST_MODELS

B = np.random.default_rng(3).normal(size=(3, 5))
ARM = MODELS / "arm.xml"
STRETCHED = {"site": "tip", "axes": None, "major": "3,4"}


def test_hexarotor_hovers_without_a_rotor_if_neighbours_turn_in_the_same_sense(tmp_path):
    """Compare with Du, Quan, Yang and Cai, JGCD 38 (2015)."""
    hover = {"lower": "0", "upper": "6.125", "hold": f"{1.535 * 9.8},0,0,0"}
    for turns, survives in {"PNPNPN": 6 * [False], "PPNNPN": 4 * [True] + 2 * [False]}.items():
        start = of_matrix(matrix_file(tmp_path / "B.csv", effectiveness(turns)), **hover).start
        assert start.survived[0]
        assert start.survived[start.singles[:, FREE - LOCKED]].tolist() == survives


def test_rows_list_failed_actuators_and_actuators_list_remaining_effects(tmp_path):
    names, file = [f"rotor{k}" for k in range(6)], tmp_path / "B.csv"
    pd.DataFrame(effectiveness("PPNNPN"), columns=names).to_csv(file, index=False)
    survey = of_matrix(file, lower="0", upper="6.125", hold=f"{1.535 * 9.8},0,0,0")
    actuators = actuator_frame(survey).set_index("actuator")
    for code, row in zip(survey.start.codes, condition_frame(survey).itertuples(), strict=True):
        for kind, failed in ((LOCKED, row.locked), (FREE, row.free)):
            assert failed == [
                name for name, state in zip(names, code, strict=True) if state == kind
            ]
        if row.failures == 1:
            [name] = row.locked + row.free
            left = actuators.loc[name, "left_locked" if row.locked else "left_free"]
            assert left == pytest.approx(row.effect_left * row.survived)
    assert (actuators.left_locked > actuators.left_free).all()


def radius(columns: np.ndarray, low: np.ndarray, high: np.ndarray, effect: np.ndarray) -> float:
    """Return the radius of the largest ball of attainable effects about the effect at rest."""
    return max(0.0, distances(columns, effect, low, high).min())


@pytest.mark.parametrize("seed", [0, 3, 7])
def test_measured_hexarotor_loses_directions_with_less_than_one_percent(tmp_path, seed):
    """Yaw is lost with two rotors (Du et al.); errors of some mm give it rank, but no slack."""
    rng, hover = np.random.default_rng(seed), np.array([7.2, 0, 0, 0])
    B_measured = effectiveness("PNPNPN", 0.45)
    B_measured[3] /= 2
    B_measured[1:3] += 0.006 * rng.normal(size=(2, 6))
    limits = {"lower": "0", "upper": "4", "hold": "7.2,0,0,0"}
    survey = of_matrix(matrix_file(tmp_path / "B.csv", B_measured), **limits)
    at_rest, zero, frame = np.linalg.pinv(B_measured) @ hover, np.zeros(6), conditions(survey)
    healthy = radius(B_measured, zero, zero + 4, hover)
    for code, row in zip(survey.start.codes, frame.itertuples(), strict=True):
        stuck = np.where(code == LOCKED, at_rest, 0.0)  # a free one has no thrust
        left = radius(B_measured, stuck, np.where(code, stuck, 4.0), hover)
        assert row.survived == (left / healthy > LEAST_LEFT == 0.01), row
        assert row.worst_effect == pytest.approx(left, abs=1e-8)
        assert row.effect_left == pytest.approx(left / healthy, abs=1e-8)
    assert (frame.major_task == "nearly lost").any()


TENDONS = """
<mujoco><option gravity="0 0 0"/><worldbody><body><joint name="x" type="slide" axis="1 0 0"/>
  <joint name="y" type="slide" axis="0 1 0"/><geom size="0.1"/><site name="tip"/></body></worldbody>
  <tendon><fixed name="a"><joint joint="x" coef="1"/></fixed><fixed name="b">
  <joint joint="x" coef="1"/><joint joint="y" coef="{near}"/></fixed>
  <fixed name="c"><joint joint="y" coef="1"/></fixed></tendon>
  <actuator><motor tendon="a"/><motor tendon="b"/><motor tendon="c"/></actuator></mujoco>
"""


@pytest.mark.parametrize("near", [0.002, 0.1])
def test_robot_without_force_loses_the_task(tmp_path, near):
    """Tendons a and b are nearly parallel; they remain when c is free."""
    (tmp_path / "tendons.xml").write_text(TENDONS.format(near=near))
    survey = of_robot(tmp_path / "tendons.xml", site="tip", axes=None, major="3,4")
    pulls, one, nothing = np.array([[1, 1, 0], [0, near, 1]]), np.ones(3), np.zeros(2)
    force = radius(pulls[:, :2], -one[:2], one[:2], nothing) / radius(pulls, -one, one, nothing)
    row = conditions(survey).loc["c free"]
    assert row.force_left == pytest.approx(force, rel=1e-6) and row.speed_left >= 0.999
    assert row.survived == (force > 0.01) == (near == 0.1)


@pytest.mark.parametrize(("hold", "advice"), [(None, "(--hold)"), ("40,0,0,0", "hold less")])
def test_inputs_without_slack_at_rest_are_reported(tmp_path, hold, advice):
    """Thrusts from 0 on have no slack about zero; six thrusts of 6 N do not carry 40 N."""
    file = matrix_file(tmp_path / "B.csv", effectiveness("PPNNPN"))
    survey = of_matrix(file, lower="0", upper="6", hold=hold)
    assert survey.start.classification(0) == "no margin"
    assert headline(survey.system, survey.start).endswith(f"{advice}.")


def test_matrix_analysis_is_the_same_in_parts(tmp_path, monkeypatch):
    file = matrix_file(tmp_path / "B.csv", np.random.default_rng(0).normal(size=(4, 8)))
    complete = of_matrix(file).start
    monkeypatch.setattr("fjh.rig.condition_analysis._AT_ONCE", 8**2 * 10)
    parts = of_matrix(file).start
    np.testing.assert_array_equal(parts.survived, complete.survived)
    np.testing.assert_array_equal(speeds(parts), speeds(complete))


def test_omitted_conditions_with_many_failures_are_reported(tmp_path):
    B = np.random.default_rng(0).normal(size=(2, 12))
    survey = of_matrix(matrix_file(tmp_path / "B.csv", B))
    count = sum(comb(12, k) * 2**k for k in range(5))
    [sentence] = survey.omissions()
    assert f"3^12 conditions those with at most 4 failures ({count:,})" in sentence


def test_arm_points_with_any_joint_locked_and_only_the_last_free():
    """A free joint turns the camera by itself, except the last, whose axis is the line of sight."""
    start = of_robot(ARM, 3).start
    assert start.survived[start.singles[:, 0]].all()
    assert start.survived[start.singles[:, 1]].tolist() == 6 * [False] + [True]
    assert {start.classification(row) for row in start.singles[:6, 1]} == {"drifts"}
    assert start.speed_left[start.singles[6]] == pytest.approx(1.0, rel=1e-9)


def test_postures_are_within_the_joint_ranges_and_closed():
    survey = of_robot(MODELS / "platform.xml", 8, major="3,4")
    robot = survey.system.robot
    assert robot is not None and 0 < len(survey.postures) <= 8
    for qpos in survey.postures.qpos:
        data = assemble(robot.scene.task_model)
        data.qpos[:] = qpos
        np.testing.assert_allclose(assemble(robot.scene.task_model, data).qpos, qpos, atol=1e-8)
    assert len(survey.rows) == (1 + len(survey.postures)) * len(survey.start.codes)


def test_statistics_over_postures_equal_surveys_started_there():
    """Compare median, worst and share with surveys that start at each posture."""
    survey, single = of_robot(ARM, 3), []
    robot = survey.system.robot
    assert robot is not None
    for qpos in (np.array(robot.scene.start.qpos), *survey.postures.qpos):
        there = robot_of(ARM, robot.options, qpos, settle=False)
        system = ConstrainedSystem.of(there.rigid.nominal)
        single.append(
            analyze_conditions(system, (0, 1), survey.start.codes, rates=survey.system.rates)
        )
    frame, name = condition_frame(survey), "worst_speed_rad_per_s"
    at_postures = np.array([speeds(one) for one in single[1:]])
    survived = np.array([one.speed_left > LEAST_LEFT for one in single])
    expected = {
        f"{name}_median_over_postures": np.median(at_postures, axis=0),
        f"{name}_least_over_postures": at_postures.min(axis=0),
        "share_of_postures": survived.mean(axis=0),
    }
    for key, values in expected.items():
        np.testing.assert_allclose(frame[key], values, rtol=1e-7, atol=1e-9, err_msg=key)


def test_seed_determines_the_sampled_postures():
    one, again, other = (
        of_robot.__wrapped__(TEST_MODELS / "stretched.xml", 4, seed, **STRETCHED)
        for seed in (1, 1, 2)
    )
    pd.testing.assert_frame_equal(one.rows, again.rows)
    assert not np.allclose(np.stack(one.postures.qpos), np.stack(other.postures.qpos))


def test_best_posture_replaces_a_singular_start():
    """A stretched planar arm cannot move its tip along the arm; a bent one can."""
    file = TEST_MODELS / "stretched.xml"
    alone, survey = (of_robot(file, count, **STRETCHED) for count in (0, 8))
    assert alone.start.classification(0) == "one direction" and alone.system.instead is None
    robot, healthy = survey.system.robot, survey.rows[survey.rows.condition == 0].iloc[1:]
    assert survey.start.survived[0] and robot is not None and healthy.survived.all()
    best = int(np.argmin(healthy.largest_gain_rad_per_m))
    np.testing.assert_allclose(robot.scene.task_start.qpos, survey.postures.qpos[best])
    assert survey.start.largest_gain[0] == pytest.approx(healthy.largest_gain_rad_per_m.iloc[best])
    assert f"posture {best + 1} " in str(survey.system.instead)


def test_every_check_fails_on_wrong_numbers(tmp_path):
    survey = of_matrix(matrix_file(tmp_path / "B.csv", B))
    start, left = survey.start, survey.start.classes
    assert [outcome.passed for outcome in checks(survey.system, start)] == [True, True]
    verdicts = replace(start, classes=replace(left, possible=~left.possible))
    numbers = replace(start, classes=replace(left, worst_speed=speeds(start) * (1 + 1e-5)))
    for k, wrong in enumerate((verdicts, numbers)):
        assert [outcome.passed for outcome in checks(survey.system, wrong)] == [k != 0, k != 1]
