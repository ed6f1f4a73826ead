"""The same questions to mink: where the answers are to be the same, and where they differ.

The behaviours are those of the tests of mink and pink, and of docs/coming-from-mink.md.
"""

import mink
import mujoco
import numpy as np
import pytest

from fjh.ik import Ik, Limits
from prioritized import Status
from sim import (
    CenterOfMass,
    CenterOfMassTask,
    Distances,
    FrameTask,
    Pose,
    PostureTask,
    pose_of,
    ranges,
)
from tests.fjh.ik.models import model_of, moved
from tests.scenes import distances_of

DT = 5e-3
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


@pytest.fixture
def mobile() -> tuple[mujoco.MjModel, mujoco.MjData]:
    return model_of("mobile"), mujoco.MjData(model_of("mobile"))


def step_of_mink(model: mujoco.MjModel, data: mujoco.MjData, tasks: list, dt: float = DT, **how):
    """Its configuration after a step."""
    configuration = mink.Configuration(model, data.qpos)
    how = {"solver": "daqp", "limits": []} | how
    configuration.integrate_inplace(mink.solve_ik(configuration, tasks, dt=dt, **how), dt)
    return configuration


def test_where_all_tasks_can_be_met_at_once_both_give_the_same_velocity():
    """Position and posture of an arm whose base is the rest: nothing conflicts, costs are idle."""
    model = model_of("humanoid")
    data = mujoco.MjData(model)
    targets = {foot: pose_of(model, data, foot) for foot in ("left_foot", "right_foot")}
    targets["right_hand"] = above(model, data, "right_hand", 0.02, -0.01, 0.03)
    com = pose_of(model, data, CenterOfMass()).translation_m + 0.004
    center = mink.ComTask(cost=1.0)
    center.set_target(com)
    theirs = [asked_of_mink(frame, target) for frame, target in targets.items()]
    configuration = mink.Configuration(model, data.qpos)
    v = mink.solve_ik(
        configuration, [*theirs, center], dt=DT, solver="daqp", limits=[], damping=1e-12
    )
    ours = [FrameTask(frame, target=target) for frame, target in targets.items()]
    ik = Ik(model, [[*ours, CenterOfMassTask(target=com)]], FREELY, active=["root"])
    np.testing.assert_allclose(ik.step(data, DT), v, atol=2e-3 * np.abs(v).max())


def test_of_conflicting_tasks_the_lower_one_gives_way_in_mink_both(mobile):
    model, data = mobile
    high, low = (above(model, data, "tool", 0, 0, way) for way in (0.01, -0.01))
    theirs = [asked_of_mink("tool", high), asked_of_mink("tool", low, cost=0.5)]
    frame = step_of_mink(model, data, theirs).get_transform_frame_to_world("tool", "site")
    assert 1e-3 < high.translation_m[2] - frame.translation()[2] < 0.019
    ik = Ik(model, [FrameTask("tool", target=high), FrameTask("tool", target=low)], FREELY)
    data = moved(ik, data, 3, DT)
    assert abs(high.translation_m[2] - data.site("tool").xpos[2]) < 1e-8


def test_what_cannot_hold_has_a_status_here_and_none_in_mink(mobile):
    """A tool that no joint can lift: frozen joints and a pose as constraints."""
    model, data = mobile
    frozen = mink.DofFreezingTask(model, dof_indices=list(range(3, 9)))
    target = above(model, data, "tool", 0.02, 0.0, 0.03)
    pose, configuration = asked_of_mink("tool", target), mink.Configuration(model, data.qpos)
    rest, constraints = mink.DampingTask(model, cost=1e-3), [frozen, pose]
    v = mink.solve_ik(configuration, [rest], DT, "daqp", limits=[], constraints=constraints)
    missed = pose.compute_jacobian(configuration) @ v * DT + pose.compute_error(configuration)
    np.testing.assert_allclose(np.linalg.norm(missed), 0.03, atol=1e-9)
    ik = Ik(model, [FrameTask("tool", rows=[3, 4, 5], target=target)], FREELY)
    ik = ik.with_failures(locked=[model.joint(k).name for k in range(3, 9)])
    answer = ik.solve(data, DT)
    assert answer.status is Status.LEAST_SQUARES
    np.testing.assert_allclose(DT * answer.residuals[0], [0, 0, 0.03], atol=1e-9)


def test_the_origin_takes_the_straight_line_and_there_a_screw():
    """Half a turn about z at a metre: how far off the line of sight a tenth of the way is."""
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><worldbody><body><freejoint name="root"/><geom size="0.1"/>
        <site name="a"/></body></worldbody></mujoco>"""
    )
    target = Pose(np.diag([-1.0, -1.0, 1.0]), np.array([1.0, 0.0, 0.0]))
    data = mujoco.MjData(model)
    ik = Ik(model, [FrameTask("a", target=target, gain=0.1)], FREELY, active=True)
    np.testing.assert_allclose(moved(ik, data, 1, DT).qpos[:3], [0.1, 0.0, 0.0], atol=1e-12)
    task = asked_of_mink("a", target)
    task.gain = 0.1
    assert abs(step_of_mink(model, data, [task]).q[1]) > 0.05


def test_beyond_its_range_a_joint_returns_where_mink_finds_no_solution(mobile):
    model, data = mobile
    _, high = ranges(model).joint.T
    data.qpos[4] = high[4] + 0.1
    task = FrameTask("tool", target=pose_of(model, data, "tool"))
    after = data.qpos + DT * Ik(model, [task]).step(data, DT)
    np.testing.assert_allclose(after[4], high[4], atol=1e-12)
    slowly = Ik(model, [task], Limits(velocity=1.0)).step(data, DT)
    np.testing.assert_allclose(slowly[4], -1.0)
    posture = mink.PostureTask(model, cost=1.0)
    posture.set_target(data.qpos)
    limits = [mink.ConfigurationLimit(model), mink.VelocityLimit(model, {"shoulder": 1.0})]
    with pytest.raises(mink.NoSolutionFound):
        step_of_mink(model, data, [posture], limits=limits)


def test_a_beam_that_turns_does_not_run_its_other_end_into_the_floor():
    """Mink looks at the end that is near now, and the next one goes through the floor."""
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><worldbody><geom name="floor" type="plane" size="1 1 0.1"/><body pos="0 0 0.12">
        <joint name="y" axis="0 1 0"/><joint name="z" type="slide"/>
        <geom name="beam" type="box" size="0.5 0.05 0.05"/></body></worldbody>
        <actuator><motor joint="y"/><motor joint="z"/></actuator></mujoco>"""
    )
    data, pairs, target = mujoco.MjData(model), [(["floor"], ["beam"])], np.array([-0.8, -0.05])
    pair = np.array([[model.geom("floor").id, model.geom("beam").id]])
    data.qpos[0] = 0.02  # one end is a little lower
    limit = mink.CollisionAvoidanceLimit(model, pairs, collision_detection_distance=0.3)
    theirs = mink.PostureTask(model, cost=1.0)
    theirs.set_target(target)
    configuration = step_of_mink(model, data, [theirs], 0.1, limits=[limit])
    assert distances_of(model, configuration.q, pair, 1.0) < -0.01
    limits = Limits(ranges=False, distances=Distances(model, pairs, detection_m=0.3))
    ik = Ik(model, [PostureTask(target=target)], limits)
    for _ in range(20):
        data = moved(ik, data, 1, 0.1)
        assert distances_of(model, data.qpos, pair, 1.0) > 0.005 - 1e-8
