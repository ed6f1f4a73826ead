"""Limits: they hold at every tick, whatever is asked for, and what is beyond one returns."""

import mujoco
import numpy as np
import pytest

from fjh.ik import Ik, Limits
from prioritized import Status
from sim import (
    MODELS,
    Body,
    Distances,
    FrameTask,
    PostureTask,
    assemble,
    load_model,
    pose_of,
    ranges,
)
from tests.scenes import arm_among, distances_of

DT = 0.02
MOBILE = load_model(MODELS / "mobile.xml")
QUADRUPED = load_model(MODELS / "quadruped.xml")
SLIDES = mujoco.MjModel.from_xml_string(
    """<mujoco><worldbody><body name="block">
    <joint name="x" type="slide" axis="1 0 0" range="-0.5 0.5"/><geom name="block" size="0.1"/>
    <site name="a"/></body></worldbody><actuator><motor joint="x"/></actuator></mujoco>"""
)
_FOUR_BAR = """<mujoco><compiler angle="radian"/><worldbody>
    <body><joint name="crank" axis="0 1 0"/><geom size="0.02"/>
      <body pos="0.2 0 0"><joint name="coupler" axis="0 1 0"/><geom size="0.02"/>
        <body pos="0 0 0.3"><joint name="rocker" axis="0 1 0" range="-0.3 0.3"/><geom size="0.02"/>
          <site name="end" pos="-0.3 0 0"/></body></body></body>
    <site name="ground" pos="-0.1 0 0.3"/></worldbody>
    <equality><connect site1="end" site2="ground"/></equality>
    <actuator><motor joint="crank"/></actuator></mujoco>"""
FOUR_BAR = mujoco.MjModel.from_xml_string(_FOUR_BAR)


def asked(target: float) -> FrameTask:
    return FrameTask("a", rows=[3], target=[target, 0.0, 0.0])


@pytest.mark.parametrize("seed", range(6))
def test_ranges_rates_and_accelerations_hold_while_the_tool_chases_what_it_cannot_reach(seed):
    rng, data = np.random.default_rng(seed), mujoco.MjData(MOBILE)
    low, high = ranges(MOBILE).joint.T
    tool = FrameTask("tool")
    speed, hard = rng.uniform(0.5, 3.0), rng.uniform(2.0, 20.0)
    ik = Ik(
        MOBILE, [tool, PostureTask(target=data.qpos)], Limits(velocity=speed, acceleration=hard)
    )
    before, at_limit = np.zeros(9), 0
    for k in range(120):
        if k % 30 == 0:
            tool.target = rng.normal(scale=2.0, size=3)
        qvel = ik.step(data, DT)
        data = ik.advance(data, qvel, DT)
        assert (np.abs(qvel) <= speed).all()
        assert (np.abs(qvel - before) <= hard * DT * (1 + 1e-12)).all()
        assert (data.qpos >= low - 1e-12).all() and (data.qpos <= high + 1e-12).all()
        at_limit, before = at_limit + (np.abs(qvel) > 0.999 * speed).sum(), qvel
    assert at_limit > 20


def test_a_limit_by_name_is_that_of_one_joint():
    data, tool = mujoco.MjData(MOBILE), FrameTask("tool", target=np.ones(3))
    qvel = Ik(MOBILE, [tool], Limits(velocity={"drive_x": 0.1, "elbow": 0.2})).step(data, DT)
    turned = {MOBILE.joint(k).name: abs(qvel[MOBILE.jnt_dofadr[k]]) for k in range(9)}
    assert turned["drive_x"] <= 0.1 and turned["elbow"] <= 0.2 and max(turned.values()) > 1.0


@pytest.mark.parametrize("beyond", [0.51, -0.7])
def test_a_joint_beyond_its_range_returns_at_once_or_as_fast_as_it_may(beyond):
    data = mujoco.MjData(SLIDES)
    data.qpos[:] = beyond
    at_once = Ik(SLIDES, [asked(2.0 * beyond)]).step(data, DT)
    np.testing.assert_allclose(beyond + DT * at_once, np.sign(beyond) * 0.5)
    slowly = Ik(SLIDES, [asked(2.0 * beyond)], Limits(velocity=0.1)).step(data, DT)
    np.testing.assert_allclose(slowly, -np.sign(beyond) * min(0.1, abs(at_once[0])))


def test_without_ranges_a_joint_goes_beyond():
    (qvel,) = Ik(SLIDES, [asked(3.0)], Limits(ranges=False)).step(mujoco.MjData(SLIDES), DT)
    np.testing.assert_allclose(qvel * DT, 3.0)
    (qvel,) = Ik(SLIDES, [asked(3.0)]).step(mujoco.MjData(SLIDES), DT)
    np.testing.assert_allclose(qvel * DT, 0.5)


def test_a_passive_joint_of_a_loop_stays_in_its_range():
    """The crank is asked to turn on; the rocker, which no actuator moves, stops it."""
    data = assemble(FOUR_BAR)
    posture = PostureTask(target=[2.0, 0.0, 0.0])
    ik, rocker = Ik(FOUR_BAR, [posture], Limits(velocity=1.0)), []
    for _ in range(150):
        data = ik.advance(data, ik.step(data, DT), DT)
        rocker.append(data.joint("rocker").qpos[0])
    assert max(map(abs, rocker)) < 0.3 + 1e-4  # to first order in a step
    assert max(map(abs, rocker)) > 0.29
    free = Ik(FOUR_BAR, [posture], Limits(ranges=False, velocity=1.0))
    for _ in range(60):
        data = free.advance(data, free.step(data, DT), DT)
    assert abs(data.joint("rocker").qpos[0]) > 0.35


def test_where_a_loop_lets_nothing_return_so_fast_it_goes_no_farther_and_stays_closed():
    """The rocker is far beyond its range, and the crank that would bring it back is slow."""
    model = mujoco.MjModel.from_xml_string(_FOUR_BAR.replace("-0.3 0.3", "-0.05 0.05"))
    data = assemble(FOUR_BAR)
    fast = Ik(FOUR_BAR, [PostureTask(target=[1.0, 0.0, 0.0])], Limits(velocity=1.0))
    for _ in range(40):
        data = fast.advance(data, fast.step(data, DT), DT)
    beyond = abs(data.joint("rocker").qpos[0])
    there = mujoco.MjData(model)
    there.qpos[:] = data.qpos
    there = assemble(model, there)
    ik = Ik(model, [PostureTask(target=[1.0, 0.0, 0.0])], Limits(velocity=0.05))
    answer = ik.solve(there, DT)
    assert beyond > 0.1 and not answer.is_led_back and "cannot return" in str(answer)
    assert answer.status is not Status.INFEASIBLE
    after = ik.advance(there, answer.qvel, DT)
    assert abs(after.joint("rocker").qpos[0]) <= beyond + 1e-6


def test_a_tendon_that_is_driven_stays_in_its_range():
    """The rope is a velocity of its own; the arm that it moves is asked to go on."""
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><worldbody><site name="hook" pos="0 0 1"/><body>
        <joint name="boom" axis="0 1 0"/><geom size="0.1"/><site name="tool" pos="0.3 0 0.2"/>
        </body></worldbody><tendon><spatial name="rope" limited="true" range="0.7 1.1">
        <site site="hook"/><site site="tool"/></spatial></tendon>
        <actuator><motor tendon="rope"/></actuator></mujoco>"""
    )
    data, tool = mujoco.MjData(model), FrameTask("tool", rows=[5], target=[0.0, 0.0, -2.0])
    ik = Ik(model, [tool], Limits(velocity={"rope": 0.3}))
    lengths = []
    for _ in range(80):
        qvel = ik.step(data, DT)
        data = ik.advance(data, qvel, DT)
        lengths.append(float(data.ten_length[0]))
    assert max(np.diff(lengths)) < 0.3 * DT * 1.01
    assert 1.09 < max(lengths) < 1.1 + 1e-4  # to first order in a step


def test_a_locked_joint_beyond_its_range_asks_for_nothing():
    data = mujoco.MjData(SLIDES)
    data.qpos[:] = 0.6
    ik = Ik(SLIDES, [asked(0.0)], Limits(velocity=1.0)).with_failures(locked=["x"])
    answer = ik.solve(data, DT)
    assert answer.qvel == 0.0 and answer.is_led_back


def test_torque_limits_of_the_static_map_are_those_of_the_model():
    """A variable without an actuator holds nothing: forces come from the legs alone."""
    data = assemble(QUADRUPED)
    feet = [FrameTask(QUADRUPED.site(k).name, rows=[3, 4, 5], target=np.zeros(3)) for k in (1, 2)]
    answer = Ik(QUADRUPED, feet, active=["root"]).solve(data, DT)
    assert answer.torque_limits[0].shape == (18,)
    np.testing.assert_array_equal(answer.torque_limits[0][12:], 0.0)
    np.testing.assert_array_equal(answer.torque_limits[1][12:], 0.0)


SCENES = 10


def chased(seed: int, *, keeps: bool = True) -> tuple[float, bool]:
    """How much nearer geoms came than they may, at worst [m], and whether the arm still moved."""
    rng = np.random.default_rng(seed)
    model = arm_among(12, rng)
    data, distances = mujoco.MjData(model), Distances(model, margin_m=0.01, detection_m=0.1)
    mujoco.mj_forward(model, data)
    pairs = distances.geom_pairs
    allowed = np.minimum(distances_of(model, data.qpos, pairs, 0.1), 0.01)
    tip = FrameTask(Body(model.nbody - 1), rows=[3, 4, 5], target=rng.normal([0, 0, 0.5], 0.5))
    limits = Limits(velocity=3.0, distances=distances if keeps else None)
    ik, nearer, way = Ik(model, [tip], limits, active=True), -np.inf, 0.0
    for _ in range(40):
        qvel = ik.step(data, DT)
        data = ik.advance(data, qvel, DT)
        way += DT * np.abs(qvel).sum()
        lacking = allowed - distances_of(model, data.qpos, pairs, 0.1)
        nearer = max(nearer, lacking.max())
    return nearer, way > 0.05


@pytest.mark.parametrize("first", range(0, SCENES, 5))
def test_arms_that_chase_a_point_among_obstacles_touch_nothing(first):
    found = [chased(seed) for seed in range(first, first + 5)]
    assert max(nearer for nearer, _ in found) < 1e-6
    assert sum(moved for _, moved in found) >= 4


@pytest.mark.long
@pytest.mark.parametrize(
    "first",
    [
        pytest.param(k, marks=() if k < SCENES + 3 * 99 else pytest.mark.night)
        for k in range(SCENES, 1000, 99)
    ],
)
def test_no_arm_of_1000_random_scenes_penetrates_anything(first):
    found = [chased(seed) for seed in range(first, min(first + 99, 1000))]
    assert max(nearer for nearer, _ in found) < 1e-6
    assert np.mean([moved for _, moved in found]) > 0.8


def test_geoms_that_begin_too_near_part_by_half_of_what_is_missing_in_each_tick():
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><worldbody><geom name="wall" type="box" size="0.1 1 1" pos="0.305 0 0"/>
        <body name="block"><joint name="x" type="slide" axis="1 0 0"/>
        <geom name="block" size="0.2"/><site name="a"/></body></worldbody>
        <actuator><motor joint="x"/></actuator></mujoco>"""
    )
    data = mujoco.MjData(model)
    distances = Distances(model, [(["wall"], ["block"])], margin_m=0.025, detection_m=0.2)
    ik = Ik(model, [asked(1.0)], Limits(distances=distances))
    for k in range(1, 8):
        data = ik.advance(data, ik.step(data, DT), DT)
        np.testing.assert_allclose(0.005 - data.qpos[0], 0.025 - 0.02 / 2**k, atol=1e-9)


def test_without_these_limits_most_arms_hit_what_is_in_their_way():
    """So that the laws above can fail."""
    found = [chased(seed, keeps=False)[0] for seed in range(6)]
    assert sum(nearer > 0.02 for nearer in found) >= 4


def test_near_geoms_of_the_mobile_base_keep_away_while_the_tool_goes_home():
    data = mujoco.MjData(MOBILE)
    distances = Distances(MOBILE, [([Body("forearm")], ["base"])], margin_m=0.05, detection_m=0.2)
    tool = FrameTask("tool", rows=[3, 4, 5], target=np.zeros(3))
    ik = Ik(MOBILE, [tool], Limits(velocity=2.0, distances=distances))
    tool.target = pose_of(MOBILE, data, Body("base")).translation_m
    for _ in range(80):
        data = ik.advance(data, ik.step(data, DT), DT)
        assert distances_of(MOBILE, data.qpos, distances.geom_pairs, 0.2).min() > 0.05 - 1e-6


def cart(scale: float = 1.0) -> mujoco.MjModel:
    """A ball before a wall on the right and a post, in metres times a scale."""
    return mujoco.MjModel.from_xml_string(
        f"""<mujoco><worldbody><geom name="wall" type="plane" pos="{scale} 0 0" zaxis="-1 0 0"
        size="1 1 .1"/><geom name="post" size="{0.05 * scale}" pos="0 {0.8 * scale} 0"/><body>
        <joint name="x" type="slide" axis="1 0 0"/><joint name="y" type="slide" axis="0 1 0"/>
        <geom name="ball" size="{0.1 * scale}"/><site name="tip"/></body></worldbody>
        <actuator><motor joint="x"/><motor joint="y"/></actuator></mujoco>"""
    )


@pytest.mark.parametrize("detection", [0.03, 0.5])
@pytest.mark.parametrize(("scale", "dt"), [(1.0, 0.02), (1.0, 0.05), (1000.0, 0.01)])
def test_before_a_wall_a_cart_brakes_as_it_may_and_stops_at_the_margin(scale, dt, detection):
    """Past a post, in any units, and from however near the wall is seen."""
    model = cart(scale)
    data, speed, hard, margin = mujoco.MjData(model), 1.0 * scale, 2.0 * scale, 0.02 * scale
    distances = Distances(model, margin_m=margin, detection_m=min(detection * scale, 100.0))
    task = FrameTask("tip", rows=[3, 4], target=[3.0 * scale, 0.9 * scale, 0.0])
    ik = Ik(model, [task], Limits(velocity=speed, acceleration=hard, distances=distances))
    before = np.zeros(2)
    for _ in range(round(4.0 / dt)):
        qvel = ik.step(data, dt)
        assert (np.abs(qvel - before) <= hard * dt * (1 + 1e-9)).all()
        before = np.array(qvel)
        data = ik.advance(data, qvel, dt, into=data)
        assert distances_of(model, data.qpos, distances.geom_pairs, scale).min() > margin - 1e-6
    assert scale - data.qpos[0] - 0.1 * scale == pytest.approx(margin, rel=0.05)


@pytest.mark.parametrize("seed", range(6))
def test_no_joint_brakes_harder_than_it_may_among_obstacles(seed):
    """Random arms, periods and accelerations; distances by MuJoCo."""
    rng = np.random.default_rng(seed)
    model, dt, hard = arm_among(8, rng), 10.0 ** rng.uniform(-2.5, -1.3), rng.uniform(1.0, 10.0)
    data, distances = mujoco.MjData(model), Distances(model, margin_m=0.01, detection_m=0.05)
    allowed = np.minimum(distances_of(model, data.qpos, distances.geom_pairs, 0.1), 0.01)
    tip = FrameTask(Body(model.nbody - 1), rows=[3, 4, 5], target=rng.normal([0, 0, 0.5], 0.5))
    ik = Ik(model, [tip], Limits(acceleration=hard, distances=distances), active=True)
    before = np.zeros(model.nv)
    for _ in range(60):
        qvel = ik.step(data, dt)
        assert np.abs(qvel - before).max() <= hard * dt * (1 + 1e-9)
        before, data = np.array(qvel), ik.advance(data, qvel, dt)
        near = distances_of(model, data.qpos, distances.geom_pairs, 0.1)
        assert (near > allowed - 1e-6).all()
    assert np.abs(data.qpos).max() > 0.01


def test_a_start_that_is_too_fast_is_braked_as_hard_as_it_may_be_and_named():
    model = cart()
    data, distances = mujoco.MjData(model), Distances(model, margin_m=0.02)
    data.qpos[0], data.qvel[0] = 0.8, 1.0
    tip = FrameTask("tip", rows=[3], target=[0.0, 0.0, 0.0], gain=0.01)
    ik = Ik(model, [tip], Limits(acceleration=2.0, distances=distances))
    answer = ik.solve(data, 0.01)
    assert answer.qvel[0] == pytest.approx(0.98)
    assert answer.exceeded == ("geoms wall and ball",) and "geoms wall and ball" in str(answer)


@pytest.mark.parametrize("dt", [0.005, 0.05])
def test_a_passive_joint_is_braked_before_its_range_with_what_all_joints_may(dt):
    data, before, rocker = assemble(FOUR_BAR), np.zeros(3), []
    ik = Ik(FOUR_BAR, [PostureTask(target=[2.0, 0.0, 0.0])], Limits(velocity=1.0, acceleration=3.0))
    for _ in range(round(3.0 / dt)):
        qvel = ik.step(data, dt)
        assert np.abs(qvel - before).max() <= 3.0 * dt * (1 + 1e-6)
        before, data = qvel, ik.advance(data, qvel, dt)
        rocker.append(abs(data.joint("rocker").qpos[0]))
    assert 0.29 < max(rocker) < 0.3 + 1e-6


TETHERED = mujoco.MjModel.from_xml_string(
    """<mujoco><worldbody><site name="anchor" pos="0 0 1.2"/><body pos="0 0 .5">
    <joint name="j1" axis="0 1 0"/><geom size=".02"/><body pos=".3 0 0">
    <joint name="j2" axis="0 1 0"/><geom size=".02"/><site name="tip" pos=".3 0 0"/></body></body>
    <body pos="5 0 0"><joint name="neck" type="ball" range="0 0.5"/><geom size=".02"/>
    <site name="nose" pos="0 0 1"/></body></worldbody><compiler angle="radian"/>
    <tendon><spatial name="tether" range="0.2 .95"><site site="anchor"/><site site="tip"/></spatial>
    </tendon><actuator><position joint="j1"/><position joint="j2"/></actuator></mujoco>"""
)


@pytest.mark.parametrize("acceleration", [None, 2.0])
@pytest.mark.parametrize("target", [(0.45, 0.25), (0.0, 1.1)])
def test_a_tendon_without_an_actuator_and_a_ball_stay_in_their_ranges(acceleration, target):
    """As MuJoCo measures them; the tip comes as near to its target as the tether lets it."""
    data = mujoco.MjData(TETHERED)
    data.qpos[:2] = -0.6, 0.4
    tip = FrameTask("tip", rows=[3, 5], gain=0.2, target=[target[0], 0.0, target[1]])
    nose = FrameTask("nose", rows=[3, 4], gain=0.2, target=[6.0, 0.7, 0.0])
    limits = Limits(velocity=3.0, acceleration=acceleration)
    ik, turn = Ik(TETHERED, [[tip, nose]], limits, active=["neck"]), np.zeros(3)
    for _ in range(300):
        data = ik.advance(data, ik.step(data, DT), DT, into=data)
        mujoco.mj_fwdPosition(TETHERED, data)
        mujoco.mju_quat2Vel(turn, data.joint("neck").qpos, 1.0)
        assert 0.2 - 1e-6 < data.ten_length[0] < 0.95 + 1e-6 and np.linalg.norm(turn) < 0.5 + 1e-6
    assert np.linalg.norm(turn) > 0.499
    way = np.linalg.norm(tip.target[[0, 2]] - [0.0, 1.2])
    missed = np.linalg.norm(data.site("tip").xpos - tip.target)
    assert missed == pytest.approx(max(way - 0.95, 0.2 - way), abs=1e-3)
    said = str(ik.solve(data, DT))
    assert "tendon tether" in said and "joint neck" in said


def test_a_driven_tendon_gathers_speed_as_its_acceleration_lets_it():
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><worldbody><body><joint name="x" type="slide" axis="1 0 0"/><geom size="0.1"/>
        <site name="a"/></body></worldbody><tendon><fixed name="rope"><joint joint="x" coef="2"/>
        </fixed></tendon><actuator><motor name="winch" tendon="rope"/></actuator></mujoco>"""
    )
    data, lengths = mujoco.MjData(model), [0.0]
    ik = Ik(model, [asked(9.0)], Limits(velocity={"winch": 0.5}, acceleration={"rope": 2.0}))
    for _ in range(40):
        data = ik.advance(data, ik.step(data, DT), DT)
        lengths.append(2.0 * data.qpos[0])
    rates = np.diff(lengths) / DT
    np.testing.assert_allclose(rates, np.minimum(0.04 * np.arange(1, 41), 0.5))


NAMED = mujoco.MjModel.from_xml_string(
    """<mujoco><worldbody><body><joint name="x" type="slide" axis="1 0 0"/><geom size="0.1"/><body>
    <joint name="y" type="slide" axis="0 1 0"/><geom size="0.1"/><site name="a"/></body></body>
    </worldbody><tendon><fixed name="both"><joint joint="x" coef="1"/><joint joint="y" coef="1"/>
    </fixed></tendon><actuator><motor name="y" joint="x"/><motor name="pull" joint="x" gear="-3"/>
    <motor name="up" joint="y"/></actuator></mujoco>"""
)


@pytest.mark.parametrize(
    ("limits", "expected"),
    [
        ({"pull": 0.1}, (0.1, 1.0)),
        ({"up": 0.1, "x": 0.2, "pull": 0.3}, (0.2, 0.1)),
        ({"both": 0.5}, (0.25, 0.25)),
    ],
)
def test_names_of_actuators_and_tendons_are_taken(limits, expected):
    task = FrameTask("a", rows=[3, 4], target=[1.0, 1.0, 0.0])
    qvel = Ik(NAMED, [task], Limits(velocity=limits)).step(mujoco.MjData(NAMED), 1.0)
    np.testing.assert_allclose(qvel, expected)


WRONG = [
    (lambda: Ik(NAMED, [asked(1)], Limits(velocity={"y": 1.0})), '"y" stands for joint'),
    (lambda: Ik(NAMED, [asked(1)], Limits(velocity={"pul": 1.0})), 'tendon or .* mean "pull"'),
    (lambda: Ik(NAMED, [asked(1)], Limits(acceleration={"both": 1.0})), 'no actuator .*"both"'),
    (lambda: Limits(velocity={"x": np.nan}), r'velocity\["x"\] must be finite'),
    (lambda: Limits(velocity={1: 2.0}), "velocity: a name must be a str"),  # type: ignore
    (lambda: Limits(acceleration=-1.0), "acceleration must be positive"),
    (lambda: Limits(acceleration=True), "acceleration must hold real numbers, got bool"),
    (lambda: Limits(velocity=[1.0, 2.0]), "velocity must be one number"),  # type: ignore
]


@pytest.mark.parametrize(("make", "said"), WRONG)
def test_limits_that_are_none_are_refused_by_the_name_as_typed(make, said):
    with pytest.raises((ValueError, TypeError), match=said):
        make()


def test_distances_of_another_model_of_the_same_size_are_refused():
    """They would keep what the other one's geoms need."""
    model, other = cart(), cart(1.5)
    task = FrameTask("tip", rows=[3], target=np.zeros(3))
    Ik(model, [task], Limits(distances=Distances(cart())))
    with pytest.raises(ValueError, match="distances must be of this model"):
        Ik(model, [task], Limits(distances=Distances(other)))


BALL = """<mujoco><worldbody>
  <geom name="floor" type="plane" size="1 1 1"/>
  <body name="ball" pos="0 0 0.1"><joint name="slide" type="slide" axis="0 0 1"/>
    <geom size="0.1"/></body>
</worldbody><actuator><motor joint="slide"/></actuator></mujoco>"""


@pytest.mark.parametrize("start_m", [0.2, 0.001, -0.02])
@pytest.mark.parametrize("gain", [0.25, 1.0])
def test_the_way_to_the_margin_shrinks_by_the_gain_of_the_distances_in_every_tick(start_m, gain):
    """From above it and from below it, as a geometric sequence."""
    model = mujoco.MjModel.from_xml_string(BALL)
    data, distances = mujoco.MjData(model), Distances(model, None, 0.01, 1.0, gain)
    down = FrameTask("ball", rows=[5], target=[0.0, 0.0, -10.0])
    ik = Ik(model, [down], Limits(distances=distances))
    data.qpos[0] = start_m
    for k in range(1, 6):
        ik.advance(data, ik.step(data, DT), DT, into=data)
        assert data.qpos[0] - 0.01 == pytest.approx((1 - gain) ** k * (start_m - 0.01), abs=1e-9)
