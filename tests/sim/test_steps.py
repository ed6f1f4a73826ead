"""Steps that are too long: shortened with a word, closed again, and the motion goes on."""

import copy
import warnings
from collections.abc import Callable

import mujoco
import numpy as np
import pytest

from prioritized import ConstrainedSystem
from sim import MODELS, advance, assemble, jacobians, load_model, pose_of
from sim.mjcf import mass_matrix
from tests.sim.test_assembly import FIVE_BAR, model_of, moved, stretched
from tests.sim.walker import FEET, feet_of, reader_of, velocity, walker

TICK_S = 0.02


def five_bar(rates: tuple[float, ...]) -> tuple[mujoco.MjModel, mujoco.MjData, np.ndarray]:
    """Its model, a closed state, and the velocity of all joints at these rates of its motors."""
    model = model_of(FIVE_BAR)
    data = assemble(model)
    kin = ConstrainedSystem.of(jacobians(model, data, "tool")).kinematics()
    return model, data, kin.velocities(rates)


def led(hand: Callable[[int], np.ndarray], ticks: int) -> tuple[mujoco.MjData, float, np.ndarray]:
    """The walker at gain 1: its last state, how far its feet ever strayed, and its ticks [s]."""
    model, start = walker()
    reader, data, strayed, times = reader_of(model), start, 0.0, [0.0]
    for tick in range(ticks):
        v = velocity(reader.at(data), model, data, start, hand(tick)) / TICK_S
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)
            data = advance(model, data, v, TICK_S, pinned=FEET)
        strayed = max(strayed, np.abs(feet_of(data) - feet_of(start)).max())
        times.append(data.time)
    return data, strayed, np.diff(times)


@pytest.mark.parametrize("way", [(-0.2, 0.1), (-0.1, -0.3), (0.2, -0.2), (-0.3, -0.4)])
def test_a_walker_reaches_from_far_away_at_gain_one_and_its_feet_stay(way):
    """Newton's method on hand, centre of mass and posture, whose first steps are too long."""
    _, start = walker()
    target = start.site("hand").xpos + np.array([way[0], 0.0, way[1]])
    end, strayed, taken = led(lambda tick: target, 30)
    assert np.linalg.norm(end.site("hand").xpos - target) < 1e-9
    assert abs(end.subtree_com[0][0] - start.subtree_com[0][0]) < 1e-9
    assert strayed < 1e-9
    assert taken.min() < 0.9 * TICK_S and taken[-1] == pytest.approx(TICK_S)


def test_a_path_that_leaves_the_reach_is_gone_on_with_to_its_end():
    """The hand is to rise by more than straight knees let it, and returns."""
    _, start = walker()
    place = start.site("hand").xpos.copy()
    end, strayed, taken = led(
        lambda tick: place + np.array([0.1, 0.0, 0.15]) * (1 - abs((tick + 1) / 30 - 1)), 60
    )
    assert np.linalg.norm(end.site("hand").xpos - place) < 1e-3
    assert strayed < 1e-9
    assert taken.min() < 0.01 * TICK_S


def test_a_step_of_several_turns_ends_at_one_radian():
    model = model_of("""<mujoco><worldbody><body><joint name="a" axis="0 0 1"/><geom size="0.1"/>
      <site name="tip" pos="0.3 0 0"/></body></worldbody></mujoco>""")
    data = mujoco.MjData(model)
    data.time = 7.0
    with pytest.warns(RuntimeWarning, match=r"shortened to 0\.04 .* \"a\" turns by 25 rad, more"):
        there = advance(model, data, np.array([50.0]), 0.5)
    assert there.qpos[0] == pytest.approx(1.0)
    assert there.time == pytest.approx(7.0 + 0.02)
    assert data.time == 7.0


def test_a_shortened_step_is_nearly_the_longest_and_lies_on_the_loops():
    """The time taken is a step by itself; a tenth more is shortened again."""
    model, data, v = five_bar((1.0, -1.0, 0.0))
    with pytest.warns(
        RuntimeWarning, match=r'to 0\.8\d* .* closing equality "pin" .* \d+% of the m'
    ):
        there = advance(model, data, v, 0.49)
    assert np.abs(there.efc_pos[: there.ne]).max() < 1e-10
    whole = advance(model, data, v, there.time)
    np.testing.assert_allclose(whole.qpos, there.qpos, atol=1e-12)
    with pytest.warns(RuntimeWarning, match="is shortened"):
        assert advance(model, data, v, 1.1 * there.time).time < 1.1 * there.time
    off = moved(model, data.qpos, there.qpos) - there.time * v
    M = mass_matrix(model, there)
    assert off @ M @ off <= (0.06 * there.time) ** 2 * v @ M @ v


def test_a_shortened_step_that_misses_its_way_says_both_of_what_was_asked():
    """Along a stretched arm: 20 mm are several turns, and one radian of them leads elsewhere."""
    model, data = stretched(1.0, 0.004)
    kin = ConstrainedSystem.of(jacobians(model, data, "tip")).kinematics()
    motion = kin.velocities(kin.velocity_mapping([3, 4])([-0.02, 0.0]))
    with warnings.catch_warnings(record=True) as given:
        warnings.simplefilter("always")
        advance(model, data, motion)
    shortened, missed = (str(each.message) for each in given)
    assert shortened.startswith("the step is shortened to 0.") and 'site "tip"' in missed
    part = float(missed.split("at most ")[1].split()[0])
    there = advance(model, data, part * motion)
    off = there.site("tip").xpos - data.site("tip").xpos - [-0.02 * part, 0.0, 0.0]
    assert 0.1 < np.linalg.norm(off) / (0.02 * part) < 0.3


def test_a_short_step_is_taken_as_it_is_without_a_word():
    model, data, v = five_bar((1.0, -1.0, 0.0))
    short = advance(model, data, v, 1e-3)
    assert short.time == pytest.approx(1e-3)
    np.testing.assert_allclose(
        moved(model, data.qpos, short.qpos), 1e-3 * v, atol=2e-6 * np.abs(v).max()
    )
    still = advance(model, data, 0.0 * v, 2.0)
    np.testing.assert_array_equal(still.qpos, data.qpos)
    assert still.time == 2.0


def test_a_step_after_which_nothing_closes_is_shortened_too():
    """Both motors must turn as commanded, until the rods between their cranks are too short."""
    model, data, v = five_bar((0.9, -0.9, 0.0))
    with pytest.warns(RuntimeWarning, match=r'equality "pin" stays open by'):
        there = advance(model, data, v, held=["left", "right"])
    assert np.abs(there.efc_pos[: there.ne]).max() < 1e-10
    assert there.joint("left").qpos[0] == pytest.approx(0.9 * there.time, abs=1e-15)


@pytest.mark.parametrize("length", [1.0, 1e-3, 1e-6, 1e-8])
def test_a_velocity_that_opens_the_loops_is_refused_however_short_the_step(length):
    model, data, v = five_bar((1.0, -1.0, 0.0))
    v[model.joint("left_elbow").dofadr[0]] *= -1.0
    with pytest.raises(ValueError, match=r'velocity must keep the loops closed: .* "pin"'):
        advance(model, data, v, length)
    with pytest.raises(ValueError, match="velocity must keep the loops closed"):
        advance(model, data, v, length, held=range(model.nv))


def test_a_velocity_that_moves_what_is_pinned_is_refused():
    model, start = walker()
    with pytest.raises(ValueError, match=r'must keep the loops closed: .* pinned "foot_[lr]"'):
        advance(model, start, np.eye(model.nv)[0], 0.1, pinned=FEET)


@pytest.mark.parametrize("number", [np.nan, np.inf, 1e300])
def test_a_velocity_that_is_no_number_is_refused(number):
    model, data, v = five_bar((1.0, 0.0, 0.0))
    v[1] = number
    with pytest.raises(ValueError, match="velocity must be"):
        advance(model, data, v)


def test_the_state_before_stays_as_it_was():
    model, data, v = five_bar((1.0, -1.0, 0.0))
    before, tool = data.qpos.copy(), pose_of(model, data, "tool").translation_m
    with pytest.warns(RuntimeWarning):
        advance(model, data, v, 3.0)
    np.testing.assert_array_equal(data.qpos, before)
    np.testing.assert_array_equal(pose_of(model, data, "tool").translation_m, tool)


@pytest.mark.parametrize("name", ["arm", "mobile", "quadruped", "humanoid"])
@pytest.mark.parametrize("held", [(), (1, 2)])
def test_where_nothing_is_to_be_closed_a_step_is_that_of_mujoco_to_the_bit(name, held):
    """Whatever is held: it moves as commanded."""
    model = load_model(MODELS / f"{name}.xml")
    rng, data = np.random.default_rng(1), mujoco.MjData(model)
    for _ in range(5):
        v, expected = rng.normal(size=model.nv), copy.copy(data)
        mujoco.mj_integratePos(model, expected.qpos, 0.1 * v, 1.0)
        mujoco.mj_fwdPosition(model, expected)
        data = advance(model, data, v, 0.1, held, warn_of_misses=False)
        for field in ("qpos", "xpos", "site_xmat", "subtree_com", "cdof", "ten_length"):
            np.testing.assert_array_equal(getattr(data, field), getattr(expected, field))
    assert data.time == pytest.approx(0.5)


def test_a_state_that_becomes_the_next_one_is_as_a_new_one():
    """Another one, or that before; with loops and without."""
    arm = load_model(MODELS / "arm.xml")
    moving = arm, mujoco.MjData(arm), 0.5 * np.ones(arm.nv)
    for model, data, v in (five_bar((0.3, -0.3, 0.0)), moving):
        new, other = advance(model, data, v, 0.1), mujoco.MjData(model)
        other.qpos[:] = np.nan
        before = data.qpos.copy()
        assert advance(model, data, v, 0.1, into=other) is other
        np.testing.assert_array_equal(data.qpos, before)
        assert advance(model, data, v, 0.1, into=data) is data
        for state in (other, data):
            np.testing.assert_array_equal(state.qpos, new.qpos)
            np.testing.assert_array_equal(state.site_xpos, new.site_xpos)
            assert state.time == new.time


def test_a_state_that_cannot_become_the_next_one_stays_or_is_refused():
    model, data, v = five_bar((1.0, -1.0, 0.0))
    v[model.joint("left_elbow").dofadr[0]] *= -1.0
    data.qpos += 1e-12
    before = data.qpos.copy()
    with pytest.raises(ValueError, match="velocity must keep the loops closed"):
        advance(model, data, v, into=data)
    np.testing.assert_array_equal(data.qpos, before)
    other = mujoco.MjData(load_model(MODELS / "arm.xml"))
    with pytest.raises(ValueError, match=r"^into must be of this model"):
        advance(model, data, v, into=other)
    with pytest.raises(TypeError, match=r"^into must be a MjData"):
        advance(model, data, v, into=model)  # pyright: ignore[reportArgumentType]
