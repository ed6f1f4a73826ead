"""The same questions to mink: where the answers are to be the same, and where they differ.

The behaviours are those of the tests of mink and pink, and of docs/coming-from-mink.md.
"""

from typing import Any

import mink
import mujoco
import numpy as np
import pytest

from fjh.ik import Ik, Limits
from prioritized import Status
from sim import (
    MODELS,
    CenterOfMass,
    CenterOfMassTask,
    Distances,
    FrameTask,
    JointCouplingTask,
    Pose,
    PostureTask,
    assemble,
    load_model,
    pose_of,
    ranges,
)

DT = 5e-3
MOBILE = load_model(MODELS / "mobile.xml")
HUMANOID = load_model(MODELS / "humanoid.xml")
BY_DAQP: dict[str, Any] = {"dt": DT, "solver": "daqp"}
FREELY = Limits(ranges=False)


def as_se3(pose: Pose) -> mink.SE3:
    return mink.SE3.from_matrix(pose.matrix())


def asked_of_mink(frame: str, target: Pose, cost: float = 1.0, turn: float = 1.0) -> mink.FrameTask:
    task = mink.FrameTask(frame, "site", position_cost=cost, orientation_cost=turn)
    task.set_target(as_se3(target))
    return task


def above(model: mujoco.MjModel, data: mujoco.MjData, frame: str, *way: float) -> Pose:
    here = pose_of(model, data, frame)
    return Pose(here.rotation, here.translation_m + way)


def test_where_all_tasks_can_be_met_at_once_both_give_the_same_velocity():
    """Position and posture of an arm whose base is the rest: nothing conflicts, costs are idle."""
    data = mujoco.MjData(HUMANOID)
    target = above(HUMANOID, data, "right_hand", 0.02, -0.01, 0.03)
    com = pose_of(HUMANOID, data, CenterOfMass()).translation_m + 0.004
    feet = [pose_of(HUMANOID, data, foot) for foot in ("left_foot", "right_foot")]
    theirs = [asked_of_mink("right_hand", target)]
    theirs += [
        asked_of_mink(f"{side}_foot", p) for side, p in zip(("left", "right"), feet, strict=True)
    ]
    center = mink.ComTask(cost=1.0)
    center.set_target(com)
    v = mink.solve_ik(
        mink.Configuration(HUMANOID, data.qpos),
        [*theirs, center],
        limits=[],
        damping=1e-12,
        **BY_DAQP,
    )
    ours = [FrameTask("right_hand", target=target), CenterOfMassTask(target=com)]
    ours += [
        FrameTask(f"{side}_foot", target=p) for side, p in zip(("left", "right"), feet, strict=True)
    ]
    found = Ik(HUMANOID, [ours], FREELY, active=["root"]).step(data, DT)
    np.testing.assert_allclose(found, v, atol=2e-3 * np.abs(v).max())


@pytest.mark.parametrize("way", [(0.0, 0.0, 0.1), (0.05, -0.08, -0.02)])
def test_a_task_converges_and_its_error_falls_at_every_step(way):
    """Mink needs fewer than 20 steps for a tenth of a metre; so does this."""
    data = mujoco.MjData(MOBILE)
    task = FrameTask("tool", target=above(MOBILE, data, "tool", *way))
    ik, errors = Ik(MOBILE, [task], Limits(velocity=np.pi)), [np.inf]
    while errors[-1] > 1e-6:
        data = ik.advance(data, ik.step(data, DT), DT)
        errors.append(float(np.linalg.norm(task.on(MOBILE).error(MOBILE, data))))
    assert (np.diff(errors) < 0).all() and len(errors) < 20


def test_three_tasks_that_are_met_ask_for_no_motion():
    data = mujoco.MjData(HUMANOID)
    frames = "right_hand", "left_foot", "right_foot"
    tasks = [FrameTask(frame, target=pose_of(HUMANOID, data, frame)) for frame in frames]
    assert np.abs(Ik(HUMANOID, [tasks], active=["root"]).step(data, DT)).max() < 1e-9


def test_of_two_tasks_that_conflict_mink_lets_both_give_way_and_here_the_lower_one():
    data = mujoco.MjData(MOBILE)
    high, low = above(MOBILE, data, "tool", 0, 0, 0.01), above(MOBILE, data, "tool", 0, 0, -0.01)
    theirs = [asked_of_mink("tool", high), asked_of_mink("tool", low, cost=0.5)]
    configuration = mink.Configuration(MOBILE, data.qpos)
    configuration.integrate_inplace(mink.solve_ik(configuration, theirs, limits=[], **BY_DAQP), DT)
    frame = configuration.get_transform_frame_to_world("tool", "site").translation()
    assert 1e-3 < high.translation_m[2] - frame[2] < 0.019
    ik = Ik(MOBILE, [FrameTask("tool", target=high), FrameTask("tool", target=low)], FREELY)
    for _ in range(3):
        data = ik.advance(data, ik.step(data, DT), DT)
    assert abs(high.translation_m[2] - data.site("tool").xpos[2]) < 1e-8


def test_what_must_hold_and_cannot_is_missed_without_a_word_there_and_here_with_a_status():
    """A tool that no joint can lift: frozen joints and a pose as constraints."""
    data = mujoco.MjData(MOBILE)
    frozen = mink.DofFreezingTask(MOBILE, dof_indices=list(range(3, 9)))
    target = above(MOBILE, data, "tool", 0.02, 0.0, 0.03)
    pose, configuration = asked_of_mink("tool", target), mink.Configuration(MOBILE, data.qpos)
    rest = mink.DampingTask(MOBILE, cost=1e-3)
    v = mink.solve_ik(configuration, [rest], limits=[], constraints=[frozen, pose], **BY_DAQP)
    missed = pose.compute_jacobian(configuration) @ v * DT + pose.compute_error(configuration)
    np.testing.assert_allclose(np.linalg.norm(missed), 0.03, atol=1e-9)
    names = [MOBILE.joint(k).name for k in range(3, 9)]
    ik = Ik(MOBILE, [FrameTask("tool", rows=[3, 4, 5], target=target)], FREELY)
    answer = ik.with_failures(locked=names).solve(data, DT)
    assert answer.status is Status.LEAST_SQUARES
    np.testing.assert_allclose(DT * answer.residuals[0], [0, 0, 0.03], atol=1e-9)


def test_frozen_joints_stay_to_the_bit():
    data = mujoco.MjData(MOBILE)
    ik = Ik(MOBILE, [FrameTask("tool", target=above(MOBILE, data, "tool", 0, 0, 0.05))])
    ik = ik.with_failures(locked=["drive_x", "drive_y"])
    for _ in range(20):
        data = ik.advance(data, ik.step(data, DT), DT)
    assert not data.qpos[:2].any() and np.abs(data.qpos[2:]).max() > 1e-3


def test_a_target_far_away_is_no_error():
    data = mujoco.MjData(MOBILE)
    target = FrameTask("tool", rows=[3, 4, 5], target=[100.0, 0.0, 0.0])
    answer = Ik(MOBILE, [target]).solve(data, DT)
    assert answer.status is Status.EXACT and np.isfinite(answer.qvel).all()


def test_a_target_that_is_not_finite_is_refused_and_there_a_velocity():
    task = mink.FrameTask("tool", "site", position_cost=1.0, orientation_cost=1.0)
    task.set_target(mink.SE3(np.array([1.0, 0, 0, 0, np.nan, 0, 0])))
    v = mink.solve_ik(mink.Configuration(MOBILE), [task], limits=[], **BY_DAQP)
    assert np.isnan(v).all()
    with pytest.raises(ValueError, match="target"):
        FrameTask("tool", target=[np.nan, 0.0, 0.0])


def test_the_origin_takes_the_straight_line_and_there_a_screw():
    """Half a turn about z at a metre: how far off the line of sight a tenth of the way is."""
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><worldbody><body><freejoint name="root"/><geom size="0.1"/>
        <site name="a"/></body></worldbody></mujoco>"""
    )
    target = Pose(np.diag([-1.0, -1.0, 1.0]), np.array([1.0, 0.0, 0.0]))
    data = mujoco.MjData(model)
    ik = Ik(model, [FrameTask("a", target=target, gain=0.1)], FREELY, active=True)
    straight = ik.advance(data, ik.step(data, DT), DT).qpos[:3]
    np.testing.assert_allclose(straight, [0.1, 0.0, 0.0], atol=1e-12)
    configuration = mink.Configuration(model)
    task = asked_of_mink("a", target)
    task.gain = 0.1
    configuration.integrate_inplace(mink.solve_ik(configuration, [task], limits=[], **BY_DAQP), DT)
    assert abs(configuration.q[1]) > 0.05


def test_beyond_its_range_a_joint_returns_also_where_mink_finds_no_solution():
    data = mujoco.MjData(MOBILE)
    _, high = ranges(MOBILE).joint.T
    data.qpos[4] = high[4] + 0.1
    task = FrameTask("tool", target=pose_of(MOBILE, data, "tool"))
    after = data.qpos + DT * Ik(MOBILE, [task]).step(data, DT)
    np.testing.assert_allclose(after[4], high[4], atol=1e-12)
    slowly = Ik(MOBILE, [task], Limits(velocity=1.0)).step(data, DT)
    np.testing.assert_allclose(slowly[4], -1.0)
    posture = mink.PostureTask(MOBILE, cost=1.0)
    posture.set_target(data.qpos)
    limits = [mink.ConfigurationLimit(MOBILE), mink.VelocityLimit(MOBILE, {"shoulder": 1.0})]
    with pytest.raises(mink.NoSolutionFound):
        mink.solve_ik(mink.Configuration(MOBILE, data.qpos), [posture], limits=limits, **BY_DAQP)


def test_far_from_a_range_only_the_velocity_limits_and_near_it_less():
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><compiler angle="radian"/><worldbody><body><joint name="j" range="0 1.57"/>
        <geom size="0.1"/><body><joint name="free"/><geom size="0.1"/></body></body></worldbody>
        <actuator><motor joint="j"/><motor joint="free"/></actuator></mujoco>"""
    )
    data = mujoco.MjData(model)
    ik = Ik(model, [PostureTask(target=[9.0, 9.0])], Limits(velocity=3.0))
    np.testing.assert_array_equal(ik.step(data, DT), [3.0, 3.0])
    data.qpos[:] = 1.57 - 5e-4, 1.57 - 5e-4
    np.testing.assert_allclose(ik.step(data, DT), [5e-4 / DT, 3.0])


def test_a_joint_that_turns_on_and_on_is_slowed_by_its_acceleration_alone():
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><worldbody><body><joint name="j"/><geom size="0.1"/></body></worldbody>
        <actuator><motor joint="j"/></actuator></mujoco>"""
    )
    data = mujoco.MjData(model)
    data.qvel[:] = 3.0
    ik = Ik(model, [PostureTask(target=data.qpos)], Limits(acceleration=14.0))
    np.testing.assert_allclose(ik.step(data, DT), 3.0 - 14.0 * DT)


def test_tendons_that_are_coupled_come_together_and_stay():
    """Mink brings them together tick by tick; here `assemble` does, and they stay so."""
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><worldbody>
        <body><joint name="j1" type="slide" axis="1 0 0"/><geom size="0.05"/></body>
        <body pos="0 1 0"><joint name="j2" type="slide" axis="1 0 0"/><geom size="0.05"/></body>
        </worldbody><tendon><fixed name="t1"><joint joint="j1" coef="1"/></fixed>
        <fixed name="t2"><joint joint="j2" coef="1"/></fixed></tendon>
        <equality><tendon tendon1="t1" tendon2="t2"/></equality>
        <actuator><motor joint="j1"/></actuator></mujoco>"""
    )
    data = mujoco.MjData(model)
    data.qpos[:] = 0.5, -0.3
    data = assemble(model, data)
    np.testing.assert_allclose(data.qpos, 0.1, atol=1e-9)
    ik = Ik(model, [PostureTask(joints=["j1"], target=[0.7, 0.0])])
    for _ in range(3):
        data = ik.advance(data, ik.step(data, DT), DT)
    np.testing.assert_allclose(data.qpos, 0.7, atol=1e-9)


def test_coupled_joints_keep_their_ratio():
    data = mujoco.MjData(HUMANOID)
    fold = PostureTask(joints=["left_knee"], target=np.append(HUMANOID.qpos0[:-1], 0.0))
    knees = JointCouplingTask({"left_knee": 1.0, "right_knee": -2.0})
    fold.target = HUMANOID.qpos0 + 0.3 * (
        np.arange(HUMANOID.nq) == HUMANOID.joint("left_knee").qposadr[0]
    )
    ik = Ik(HUMANOID, [knees, fold], active=["root"])
    data = ik.advance(data, ik.step(data, DT), DT)
    np.testing.assert_allclose(data.joint("left_knee").qpos, 0.3, atol=1e-9)
    np.testing.assert_allclose(data.joint("right_knee").qpos, 0.15, atol=1e-9)


BEAM = """<mujoco><worldbody><geom name="floor" type="plane" size="1 1 0.1"/>
<body name="beam" pos="0 0 0.12"><joint name="y" axis="0 1 0"/><joint name="z" type="slide"/>
<geom name="beam" type="box" size="0.5 0.05 0.05"/></body></worldbody>
<actuator><motor joint="y"/><motor joint="z"/></actuator></mujoco>"""


def lowest(model: mujoco.MjModel, qpos: Any) -> float:
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)
    return mujoco.mj_geomDistance(model, data, 0, 1, 1.0, None)


def test_a_beam_that_turns_one_end_up_does_not_run_the_other_into_the_floor():
    """Mink looks at the end that is near now, and the next one goes through the floor."""
    model = mujoco.MjModel.from_xml_string(BEAM)
    data = mujoco.MjData(model)
    data.qpos[0] = 0.02  # one end is a little lower
    target = PostureTask(target=[-0.8, -0.05])
    pairs = [(["floor"], ["beam"])]
    limit = mink.CollisionAvoidanceLimit(model, pairs, collision_detection_distance=0.3)
    configuration = mink.Configuration(model, data.qpos)
    theirs = mink.PostureTask(model, cost=1.0)
    theirs.set_target(np.array([-0.8, -0.05]))
    step = {"dt": 0.1, "solver": "daqp", "limits": [limit]}
    configuration.integrate_inplace(mink.solve_ik(configuration, [theirs], **step), 0.1)
    assert lowest(model, configuration.q) < -0.01
    distances = Distances(model, pairs, detection_m=0.3)
    ik = Ik(model, [target], Limits(ranges=False, distances=distances))
    for _ in range(20):
        data = ik.advance(data, ik.step(data, 0.1), 0.1)
        assert lowest(model, data.qpos) > 0.005 - 1e-8
