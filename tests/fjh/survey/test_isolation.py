"""Isolability of failures: of a matrix by its columns, of a robot by `ftc.fdi`."""

import itertools
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import subspace_angles

from fjh.rig.dither import MEASURED_S
from fjh.rig.mjcf import robot_rig
from fjh.rig.options import RobotOptions
from fjh.survey import isolation
from fjh.survey.system import matrix_system, robot_system
from ftc.fdi import DEFAULT_CONFIG, separations
from sim import MODELS
from tests.random_systems import SEEDS


@given(SEEDS, st.integers(1, 4), st.integers(1, 7))
def test_inputs_are_indistinguishable_if_their_columns_have_rank_one(seed, rows, columns):
    """Compare with the ranks of all [b_i b_j], for matrices with parallel and zero columns."""
    rng = np.random.default_rng(seed)
    some = rng.normal(size=(rows, 3))
    B = some[:, rng.integers(0, 3, columns)] * rng.choice([-2.0, 1.0, 0.5, 0.0], columns)
    B = rng.uniform(0.1, 10, (rows, 1)) * B
    row = isolation.indistinguishable_columns(B, range(columns), 1e-9)
    ranks = {
        (i, j): np.linalg.matrix_rank(B[:, [i, j]], tol=1e-9)
        for i, j in itertools.combinations(range(columns), 2)
    }
    assert set(row["without_effect"]) == {k for k in range(columns) if not B[:, k].any()}
    seen = set(range(columns)) - set(row["without_effect"])
    indistinguishable = {
        pair for group in row["alike"] for pair in itertools.combinations(group, 2)
    }
    assert indistinguishable == {
        pair for pair, rank in ranks.items() if rank == 1 and seen.issuperset(pair)
    }
    separated = [pair for pair, rank in ranks.items() if rank == 2]
    assert (row["nearest"] == []) == (not separated)
    if separated:
        unit = B / np.linalg.norm(B, axis=1, keepdims=True)
        angles = {
            pair: np.rad2deg(subspace_angles(*np.hsplit(unit[:, pair], 2))[0]) for pair in separated
        }
        least = pytest.approx(row["smallest_angle_deg"], rel=1e-6)
        assert min(angles.values()) == least and angles[tuple(row["nearest"])] == least
    assert row["isolable"] == len(seen - {k for pair in indistinguishable for k in pair})


def test_rotors_on_one_arm_are_indistinguishable(tmp_path):
    """Two rotors above each other, turning in the same sense, have parallel columns."""
    (tmp_path / "b.csv").write_text("top,bottom,side,idle\n1,0.5,1,0\n0.2,0.1,-0.2,0\n")
    system = matrix_system(tmp_path / "b.csv", None, None, None, None)
    [row] = isolation.isolation_of(system, "on", None)[0].to_dict("records")
    assert row["alike"] == [["top", "bottom"]] and row["without_effect"] == ["idle"]


@pytest.mark.long
def test_further_sensor_isolates_as_much_as_an_existing_one():
    """Compare the greedy choice with all candidates in each step, at equal noise."""
    hand = robot_rig(MODELS / "hand.xml", RobotOptions(major=(3, 4), sense="both"))
    design, row = isolation.isolation_row(hand, "joints")
    assert row["further_sensors"]

    def isolable(watched: Any) -> int:
        result = separations(watched, design.dither, MEASURED_S, DEFAULT_CONFIG.uncertainty)
        return len(result.isolable())

    watched, former = isolation.with_sensors(hand, "joints").diagnosis_model, row["isolable"]
    assert isolable(watched) == former
    for name, count in zip(row["further_sensors"], row["isolable_with_further"], strict=True):
        more = {
            sensor: watched.measured(np.vstack([watched.plant.C, C]), [*watched.noise, noise])
            for sensor, (C, noise) in isolation.further_sensors(hand, "joints").items()
        }
        assert isolable(more[name]) == count > former
        assert max(map(isolable, more.values())) == count
        watched, former = more[name], count


@pytest.mark.parametrize(
    ("name", "task", "message"),
    [
        ("hand", {"major": (2, 3, 4)}, "leaves no motion"),
        ("humanoid", {"site": "left_hand"}, "is a torque motor"),
    ],
)
def test_reason_is_reported_if_isolation_cannot_be_computed(name, task, message):
    """Isolation needs a task with a null space, and position servos."""
    system = robot_system(MODELS / f"{name}.xml", RobotOptions(**task), None, None)
    rows, settings = isolation.isolation_of(system, "on", None)
    assert rows.empty and message in settings["isolation_refused"]


def test_no_dither_is_searched_for_many_actuators(monkeypatch):
    monkeypatch.setattr(isolation, "MOST_ACTUATORS", 1)
    system = robot_system(MODELS / "hand.xml", RobotOptions(major=(3, 4)), None, None)
    rows, settings = isolation.isolation_of(system, "on", None)
    assert rows.empty and "more than 1" in settings["isolation_refused"]
