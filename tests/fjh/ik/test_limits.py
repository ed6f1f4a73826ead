"""Tests that limits hold at every tick for all targets, and that violated ones are restored."""

from collections.abc import Iterable
from copy import copy
from typing import Any

import mujoco
import numpy as np
import pytest

from fjh.ik import Ik, Limits
from prioritized import Status
from sim import Array, Body, Distances, FrameTask, PostureTask, assemble, ranges
from tests.fjh.ik.models import model_of, run_ticks, state_after
from tests.robots import TEST_MODELS
from tests.scenes import arm_among, distances_of

DT = 0.02


SEEDS = pytest.mark.parametrize(
    "seed", [*range(3), *(pytest.param(seed, marks=pytest.mark.long) for seed in range(3, 6))]
)


@SEEDS
def test_limits_hold_while_the_tool_follows_unreachable_targets(seed):
    rng, model = np.random.default_rng(seed), model_of("mobile")
    (low, high), tool = ranges(model).joint.T, FrameTask("tool")
    speed, most = rng.uniform(0.5, 3.0), rng.uniform(2.0, 20.0)
    posture = PostureTask(target=model.qpos0)
    ik = Ik(model, [tool, posture], Limits(velocity=speed, acceleration=most))
    targets, at_limit = rng.normal(scale=2.0, size=(5, 3)), 0
    tool.target = targets[0]
    for k, (data, qvel, change) in enumerate(run_ticks(ik, mujoco.MjData(model), 120, DT), 1):
        tool.target = targets[k // 30]
        assert (np.abs(qvel) <= speed).all() and change <= most * DT * (1 + 1e-12)
        assert (data.qpos >= low - 1e-12).all() and (data.qpos <= high + 1e-12).all()
        at_limit += (np.abs(qvel) > 0.999 * speed).sum()
    assert at_limit > 20


@pytest.mark.parametrize(
    ("limits", "expected"),
    [
        ({"pull": 0.1}, (0.1, 1.0)),
        ({"up": 0.1, "x": 0.2, "pull": 0.3}, (0.2, 0.1)),
        ({"both": 0.5}, (0.25, 0.25)),
    ],
)
def test_limits_may_be_given_by_name_of_actuators_and_tendons(limits, expected):
    model, task = model_of("xy_table"), FrameTask("top", rows=[3, 4], target=[1.0, 1.0, 0.0])
    ik = Ik(model, [task], Limits(ranges=False, velocity=limits))
    np.testing.assert_allclose(ik.step(mujoco.MjData(model), 1.0), expected)


def task_to(target: float) -> FrameTask:
    return FrameTask("a", rows=[3], target=[target, 0.0, 0.0])


@pytest.mark.parametrize("beyond", [0.51, -0.7])
def test_a_joint_beyond_its_range_returns_within_its_velocity_limit(beyond):
    """A joint that is locked beyond its range requires no motion."""
    model = model_of("xy_table")
    data = mujoco.MjData(model)
    data.qpos[0] = beyond
    at_once = Ik(model, [task_to(2.0 * beyond)]).step(data, DT)[0]
    np.testing.assert_allclose(beyond + DT * at_once, np.sign(beyond) * 0.5)
    slow = Ik(model, [task_to(2.0 * beyond)], Limits(velocity=0.1))
    slowly = slow.step(data, DT)[0]
    np.testing.assert_allclose(slowly, -np.sign(beyond) * min(0.1, abs(at_once)))
    for locked in (["x"], ["x", "up"]):
        answer = slow.with_failures(locked=locked).solve(data, DT)
        assert answer.qvel[0] == 0.0 and answer.is_led_back


TURN_ON = PostureTask(target=[2.0, 0.0, 0.0])


def test_without_ranges_a_passive_joint_leaves_its_range():
    model = model_of("four_bar")
    ik = Ik(model, [TURN_ON], Limits(ranges=False, velocity=1.0))
    assert abs(state_after(ik, assemble(model), 60, DT).joint("rocker").qpos[0]) > 0.35


@pytest.mark.parametrize(
    ("acceleration", "dt", "off"),
    [
        (None, DT, 1e-4),  # to first order in a step
        (3.0, 0.05, 1e-6),
        pytest.param(3.0, 0.005, 1e-6, marks=pytest.mark.long),
    ],
)
def test_a_passive_joint_of_a_loop_stays_in_its_range_and_is_braked_before_it(
    acceleration, dt, off
):
    """The crank has a target beyond the limit of the rocker, which no actuator moves."""
    model, rocker = model_of("four_bar"), []
    ik = Ik(model, [TURN_ON], Limits(velocity=1.0, acceleration=acceleration))
    for data, _, change in run_ticks(ik, assemble(model), round(3.0 / dt), dt):
        assert change <= (acceleration or np.inf) * dt * (1 + 1e-6)
        rocker.append(abs(data.joint("rocker").qpos[0]))
    assert 0.29 < max(rocker) < 0.3 + off


def test_a_loop_that_cannot_return_fast_enough_does_not_exceed_further():
    """The rocker is far beyond its range, and the crank that moves it back is slow."""
    model = copy(model_of("four_bar"))
    data = state_after(Ik(model, [TURN_ON], Limits(velocity=1.0)), assemble(model), 40, DT)
    beyond = abs(data.joint("rocker").qpos[0])
    model.joint("rocker").range[:] = -0.05, 0.05
    ik = Ik(model, [TURN_ON], Limits(velocity=0.05))
    answer = ik.solve(data, DT)
    assert beyond > 0.1 and not answer.is_led_back and "cannot return" in str(answer)
    assert answer.status is not Status.INFEASIBLE
    after = ik.advance(data, answer.qvel, DT)
    assert abs(after.joint("rocker").qpos[0]) <= beyond + 1e-6


def winched() -> mujoco.MjModel:
    """Return the table with its rope as the only drive along x."""
    spec = mujoco.MjSpec.from_file(str(TEST_MODELS / "xy_table.xml"))
    for name in ("y", "pull"):
        spec.delete(spec.actuator(name))
    spec.add_actuator(name="winch", trntype=mujoco.mjtTrn.mjTRN_TENDON, target="rope")
    return spec.compile()


def travelled(model: mujoco.MjModel, limits: Limits, ticks: int) -> Array:
    """Return the positions of the block from the start on, with a distant target."""
    ticks_of = run_ticks(Ik(model, [task_to(9.0)], limits), mujoco.MjData(model), ticks, DT)
    return np.array([0.0, *(data.qpos[0] for data, _, _ in ticks_of)])


def test_an_actuated_tendon_stays_in_its_range():
    """The rope has its own velocity; the block that it moves has a target beyond its range."""
    model = winched()
    rope = model.tendon("rope").id
    model.tendon_limited[rope], model.tendon_range[rope] = True, [-0.2, 0.6]
    lengths = 2.0 * travelled(model, Limits(velocity={"rope": 0.7}), 80)
    assert max(np.diff(lengths)) < 0.7 * DT * (1 + 1e-9)
    assert max(lengths) == pytest.approx(0.6, abs=1e-9)


def test_an_actuated_tendon_respects_its_acceleration_limit():
    limits = Limits(ranges=False, velocity={"winch": 0.5}, acceleration={"rope": 2.0})
    rates = 2.0 * np.diff(travelled(winched(), limits, 40)) / DT
    np.testing.assert_allclose(rates, np.minimum(0.04 * np.arange(1, 41), 0.5))


@pytest.mark.parametrize(
    ("acceleration", "target"),
    [
        (2.0, (0.45, 0.25)),
        pytest.param(2.0, (0.0, 1.1), marks=pytest.mark.long),
        pytest.param(None, (0.45, 0.25), marks=pytest.mark.long),
        pytest.param(None, (0.0, 1.1), marks=pytest.mark.long),
    ],
)
def test_a_tendon_without_an_actuator_and_a_ball_stay_in_their_ranges(acceleration, target):
    """MuJoCo measures the ranges; the tip comes as near to its target as the tether permits."""
    model = model_of("tethered")
    data, start, turn = mujoco.MjData(model), mujoco.MjData(model), np.zeros(3)
    start.qpos[:2] = -0.6, 0.4
    tip = FrameTask("tip", rows=[3, 5], gain=0.2, target=[target[0], 0.0, target[1]])
    nose = FrameTask("nose", rows=[3, 4], gain=0.2, target=[6.0, 0.7, 0.0])
    limits = Limits(velocity=3.0, acceleration=acceleration)
    ik = Ik(model, [[tip, nose]], limits, active=["neck"])
    for data, _, _ in run_ticks(ik, start, 300, DT):
        mujoco.mj_fwdPosition(model, data)
        mujoco.mju_quat2Vel(turn, data.joint("neck").qpos, 1.0)
        assert 0.2 - 1e-6 < data.ten_length[0] < 0.95 + 1e-6 and np.linalg.norm(turn) < 0.5 + 1e-6
    assert np.linalg.norm(turn) > 0.499
    distance = np.linalg.norm(tip.target[[0, 2]] - [0.0, 1.2])
    remaining = np.linalg.norm(data.site("tip").xpos - tip.target)
    assert remaining == pytest.approx(max(distance - 0.95, 0.2 - distance), abs=1e-3)
    text = str(ik.solve(data, DT))
    assert "tendon tether" in text and "joint neck" in text


def test_torque_limits_of_the_static_map_are_those_of_the_model():
    """A variable without an actuator exerts no force: all forces come from the legs."""
    model = model_of("quadruped")
    feet = [FrameTask(model.site(k).name, rows=[3, 4, 5], target=np.zeros(3)) for k in (1, 2)]
    answer = Ik(model, feet, active=["root"]).solve(assemble(model), DT)
    assert answer.torque_limits[0].shape == (18,)
    for limit in answer.torque_limits:
        np.testing.assert_array_equal(limit[12:], 0.0)


SCENES = 5


def chased(
    rng: np.random.Generator, obstacles=12, detection_m=0.1, ticks=40, dt=DT, **limits: Any
) -> tuple[float, float]:
    """Return the motion of an arm that keeps its clearances, and its largest deceleration."""
    model = arm_among(obstacles, rng)
    data, distances = mujoco.MjData(model), Distances(model, None, 0.01, detection_m)
    mujoco.mj_forward(model, data)
    pairs = distances.geom_pairs
    allowed = np.minimum(distances_of(model, data.qpos, pairs, 0.1), 0.01)
    tip = FrameTask(Body(model.nbody - 1), rows=[3, 4, 5], target=rng.normal([0, 0, 0.5], 0.5))
    ik = Ik(model, [tip], Limits(distances=distances, **limits), active=True)
    moved_rad = braking = 0.0
    for now, qvel, change in run_ticks(ik, data, ticks, dt):
        assert (allowed - distances_of(model, now.qpos, pairs, 0.1)).max() < 1e-6
        moved_rad, braking = moved_rad + dt * np.abs(qvel).sum(), max(braking, change / dt)
    return moved_rad, braking


def part_that_moved(seeds: Iterable[int]) -> float:
    travels = [chased(np.random.default_rng(seed), velocity=3.0)[0] for seed in seeds]
    return float(np.mean(np.array(travels) > 0.05))


def test_arms_among_obstacles_keep_their_clearances():
    assert part_that_moved(range(SCENES)) >= 0.8


@pytest.mark.long
@pytest.mark.parametrize(
    "first",
    [
        pytest.param(k, marks=() if k < SCENES + 3 * 99 else pytest.mark.night)
        for k in range(SCENES, 1000, 99)
    ],
)
def test_no_arm_of_1000_random_scenes_penetrates_anything(first):
    assert part_that_moved(range(first, min(first + 99, 1000))) > 0.8


def cart(scale: float = 1.0) -> mujoco.MjModel:
    """Return a ball between a wall on the right and a post, in meters times a scale."""
    return mujoco.MjModel.from_xml_string(
        f"""<mujoco><worldbody><geom name="wall" type="plane" pos="{scale} 0 0" zaxis="-1 0 0"
        size="1 1 .1"/><geom name="post" size="{0.05 * scale}" pos="0 {0.8 * scale} 0"/><body>
        <joint name="x" type="slide" axis="1 0 0"/><joint name="y" type="slide" axis="0 1 0"/>
        <geom name="ball" size="{0.1 * scale}"/><site name="tip"/></body></worldbody>
        <actuator><motor joint="x"/><motor joint="y"/></actuator></mujoco>"""
    )


@pytest.mark.parametrize("start_m", [0.2, 0.001, -0.02])
@pytest.mark.parametrize("gain", [0.25, 1.0])
def test_the_distance_to_the_margin_shrinks_by_the_gain_in_every_tick(start_m, gain):
    """Starts above and below the margin: the distance is a geometric sequence."""
    model = cart()
    data, distances = mujoco.MjData(model), Distances(model, None, 0.01, 1.0, gain)
    data.qpos[0] = 0.9 - start_m
    ik = Ik(model, [FrameTask("tip", rows=[3], target=[9, 0, 0])], Limits(distances=distances))
    for k in range(1, 6):
        data = state_after(ik, data, 1, DT)
        expected = (1 - gain) ** k * (start_m - 0.01)
        assert 0.9 - data.qpos[0] - 0.01 == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("detection", [0.03, 0.5])
@pytest.mark.parametrize(
    ("scale", "dt"),
    [
        (1.0, 0.05),
        (1000.0, 0.05),
        pytest.param(1.0, 0.02, marks=pytest.mark.long),
        pytest.param(1000.0, 0.01, marks=pytest.mark.long),
    ],
)
def test_a_cart_brakes_within_its_limits_and_stops_at_the_margin(scale, dt, detection):
    """The cart passes a post, in any units, for any detection distance."""
    model, speed, most, margin = cart(scale), 1.0 * scale, 2.0 * scale, 0.02 * scale
    data, start = mujoco.MjData(model), mujoco.MjData(model)
    distances = Distances(model, margin_m=margin, detection_m=min(detection * scale, 100.0))
    task = FrameTask("tip", rows=[3, 4], target=[3.0 * scale, 0.9 * scale, 0.0])
    ik = Ik(model, [task], Limits(velocity=speed, acceleration=most, distances=distances))
    for data, _, change in run_ticks(ik, start, round(4.0 / dt), dt):
        assert change <= most * dt * (1 + 1e-9)
        assert distances_of(model, data.qpos, distances.geom_pairs, scale).min() > margin - 1e-6
    assert scale - data.qpos[0] - 0.1 * scale == pytest.approx(margin, rel=0.05)


@SEEDS
def test_no_joint_exceeds_its_acceleration_limit_among_obstacles(seed):
    """Arms, periods and accelerations are random; MuJoCo measures the distances."""
    rng = np.random.default_rng(seed)
    dt, most = 10.0 ** rng.uniform(-2.5, -1.3), rng.uniform(1.0, 10.0)
    moved_rad, braking = chased(rng, 8, 0.05, 60, dt, acceleration=most)
    assert braking <= most * (1 + 1e-9) and moved_rad > 0.01


def test_a_start_too_fast_to_stop_is_braked_and_reported():
    model = cart()
    data, distances = mujoco.MjData(model), Distances(model, margin_m=0.02)
    data.qpos[0], data.qvel[0] = 0.8, 1.0
    tip = FrameTask("tip", rows=[3], target=[0.0, 0.0, 0.0], gain=0.01)
    answer = Ik(model, [tip], Limits(acceleration=2.0, distances=distances)).solve(data, 0.01)
    assert answer.qvel[0] == pytest.approx(0.98)
    assert answer.exceeded == ("geoms wall and ball",) and "geoms wall and ball" in str(answer)


@pytest.mark.parametrize(
    ("limits", "text"),
    [
        ({"velocity": {"y": 1.0}}, '"y" stands for joint'),
        ({"velocity": {"pul": 1.0}}, 'tendon or .* mean "pull"'),
        ({"acceleration": {"both": 1.0}}, 'no actuator .*"both"'),
    ],
)
def test_invalid_limits_are_rejected_by_name(limits, text):
    with pytest.raises(ValueError, match=text):
        Ik(model_of("xy_table"), [task_to(1)], Limits(**limits))


def test_distances_of_another_model_are_rejected():
    """The distances would be those of the other model's geoms."""
    model, task = cart(), FrameTask("tip", rows=[3], target=np.zeros(3))
    Ik(model, [task], Limits(distances=Distances(cart())))
    with pytest.raises(ValueError, match="distances must be of this model"):
        Ik(model, [task], Limits(distances=Distances(cart(1.5))))
