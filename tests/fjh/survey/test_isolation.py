"""Which failures can be told apart: of a matrix by its columns, of a robot by `ftc.fdi`."""

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
def test_two_inputs_are_alike_where_their_columns_have_rank_one(seed, rows, columns):
    """By brute force: the rank of [b_i b_j], of matrices with parallel and empty columns."""
    rng = np.random.default_rng(seed)
    some = rng.normal(size=(rows, 3))
    B = some[:, rng.integers(0, 3, columns)] * rng.choice([-2.0, 1.0, 0.5, 0.0], columns)
    B = rng.uniform(0.1, 10, (rows, 1)) * B
    found = isolation.indistinguishable_columns(B, range(columns), 1e-9)
    ranks = {
        (i, j): np.linalg.matrix_rank(B[:, [i, j]], tol=1e-9)
        for i, j in itertools.combinations(range(columns), 2)
    }
    assert set(found["without_effect"]) == {k for k in range(columns) if not B[:, k].any()}
    seen = set(range(columns)) - set(found["without_effect"])
    alike = {pair for group in found["alike"] for pair in itertools.combinations(group, 2)}
    assert alike == {pair for pair, rank in ranks.items() if rank == 1 and seen.issuperset(pair)}
    apart = [pair for pair, rank in ranks.items() if rank == 2]
    assert (found["nearest"] == []) == (not apart)
    if apart:
        unit = B / np.linalg.norm(B, axis=1, keepdims=True)
        angles = {
            pair: np.rad2deg(subspace_angles(*np.hsplit(unit[:, pair], 2))[0]) for pair in apart
        }
        least = pytest.approx(found["smallest_angle_deg"], rel=1e-6)
        assert min(angles.values()) == least and angles[tuple(found["nearest"])] == least
    assert found["isolable"] == len(seen - {k for pair in alike for k in pair})


def test_rotors_on_one_arm_look_alike(tmp_path):
    """Two rotors above each other, in the same sense: one column twice."""
    (tmp_path / "b.csv").write_text("top,bottom,side,idle\n1,0.5,1,0\n0.2,0.1,-0.2,0\n")
    system = matrix_system(tmp_path / "b.csv", None, None, None, None)
    [row] = isolation.isolation_of(system, "on", None)[0].to_dict("records")
    assert row["alike"] == [["top", "bottom"]] and row["without_effect"] == ["idle"]


@pytest.mark.long
def test_a_further_sensor_tells_as_much_apart_as_one_that_the_robot_has():
    """The greedy choice, each beside those before it, one by one; a sensor of the same noise."""
    hand = robot_rig(MODELS / "hand.xml", RobotOptions(major=(3, 4), sense="both"))
    design, row = isolation.isolation_row(hand, "joints")
    assert row["further_sensors"]

    def isolable(watched: Any) -> int:
        found = separations(watched, design.dither, MEASURED_S, DEFAULT_CONFIG.uncertainty)
        return len(found.isolable())

    watched, before = isolation.with_sensors(hand, "joints").watched, row["isolable"]
    assert isolable(watched) == before
    for name, with_it in zip(row["further_sensors"], row["isolable_with_further"], strict=True):
        more = {
            each: watched.measured(np.vstack([watched.plant.C, C]), [*watched.noise, noise])
            for each, (C, noise) in isolation.further_sensors(hand, "joints").items()
        }
        assert isolable(more[name]) == with_it > before
        assert max(map(isolable, more.values())) == with_it
        watched, before = more[name], with_it


@pytest.mark.parametrize(
    ("name", "task", "said"),
    [
        ("hand", {"major": (2, 3, 4)}, "leaves no motion"),
        ("humanoid", {"site": "left_hand"}, "is a torque motor"),
    ],
)
def test_where_nothing_can_be_said_of_sensors_a_sentence_says_why(name, task, said):
    """A task that leaves no motion, and torque motors."""
    system = robot_system(MODELS / f"{name}.xml", RobotOptions(**task), None, None)
    rows, settings = isolation.isolation_of(system, "on", None)
    assert rows.empty and said in settings["isolation_refused"]


def test_of_many_actuators_no_dither_is_searched(monkeypatch):
    monkeypatch.setattr(isolation, "MOST_ACTUATORS", 1)
    system = robot_system(MODELS / "hand.xml", RobotOptions(major=(3, 4)), None, None)
    rows, settings = isolation.isolation_of(system, "on", None)
    assert rows.empty and "more than 1" in settings["isolation_refused"]
