"""Fractions of a step after which no geoms are nearer than allowed, in a state of their own."""

import mujoco
import numpy as np
import pytest

from sim import Distances
from tests.scenes import arm_among, distances_of, moved

MARGIN_M, DT = 0.01, 0.05


def check_scene(seed: int) -> float:
    """The fraction of a fast step in a random scene; it is safe, and twice as much is not."""
    rng = np.random.default_rng([seed, 2003])
    model = arm_among(int(rng.integers(1, 12)), rng)
    data, distances = mujoco.MjData(model), Distances(model, margin_m=MARGIN_M)
    data.qpos[:] = start = rng.uniform(-2, 2, size=model.nq)
    qvel = rng.normal(scale=10.0, size=model.nv)
    before = distances_of(model, start, distances.geom_pairs, 1.0)

    def kept(fraction: float) -> np.ndarray:
        there = moved(model, start, fraction * DT * qvel)
        after = distances_of(model, there, distances.geom_pairs, 1.0)
        return after >= np.minimum(before, MARGIN_M) - 2e-9

    fraction = distances.safe_fraction(data, qvel, DT)
    assert kept(fraction).all()
    if fraction < 1.0:
        assert not kept(2 * fraction if fraction else 2.0**-10).all()
    np.testing.assert_array_equal(data.qpos, start)
    return fraction


def test_after_the_safe_fraction_of_a_step_no_pair_is_nearer_than_allowed():
    fractions = [check_scene(seed) for seed in range(100)]
    assert len(set(fractions)) > 4


@pytest.mark.long
def test_in_a_thousand_scenes_no_pair_is_nearer_than_allowed():
    fractions = [check_scene(seed) for seed in range(1000)]
    assert len(set(fractions)) > 6


BEAM = """<mujoco><worldbody>
  <geom name="floor" type="plane" size="1 1 1"/>
  <body pos="0 0 0.1"><joint type="slide" axis="0 0 1"/><joint axis="0 1 0"/>
    <geom name="beam" type="box" size="0.5 0.1 0.05"/></body>
</worldbody></mujoco>"""


def test_a_turn_about_the_nearest_corner_brings_the_other_one_down():
    """The row sees the nearest corner alone, and lets a step pass that goes through the floor."""
    model = mujoco.MjModel.from_xml_string(BEAM)
    data, distances = mujoco.MjData(model), Distances(model, margin_m=MARGIN_M, detection_m=0.1)
    data.qpos[1] = 0.01  # one end is 1 cm lower
    near, qvel = distances.at(data), np.array([0.0, -2.0])
    lower = -distances.gain / DT * (near.distance_m - MARGIN_M)
    assert (near.rows @ qvel >= lower).all()
    assert distances_of(model, data.qpos + DT * qvel, distances.geom_pairs, 1.0) < MARGIN_M
    assert 0.0 < distances.safe_fraction(data, qvel, DT) < 1.0


def test_a_step_of_nothing_and_a_step_away_are_safe_wherever_they_begin():
    model = mujoco.MjModel.from_xml_string(BEAM)
    data, distances = mujoco.MjData(model), Distances(model, margin_m=MARGIN_M)
    for depth in (0.0, 0.045, 0.05, 0.12):
        data.qpos[:] = -depth, 0.2
        assert distances.safe_fraction(data, np.zeros(2), DT) == 1.0
        assert distances.safe_fraction(data, [1.0, 0.0], DT) == 1.0


def test_the_state_is_up_to_date_where_it_was():
    model = mujoco.MjModel.from_xml_string(BEAM)
    data, fresh = mujoco.MjData(model), mujoco.MjData(model)
    data.qpos[:] = fresh.qpos[:] = 0.01, 0.05
    mujoco.mj_kinematics(model, fresh)
    Distances(model).safe_fraction(data, [-3.0, 1.0], DT)
    for name in ("qpos", "qvel", "geom_xpos", "geom_xmat", "xpos"):
        np.testing.assert_array_equal(getattr(data, name), getattr(fresh, name))
