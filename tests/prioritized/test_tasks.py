"""Tasks: several frames, centres of mass and relative motion, and the way to a target."""

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from prioritized import ConstrainedSystem
from sim import (
    Body,
    CenterOfMass,
    ModelError,
    Pin,
    Pose,
    Relative,
    advance,
    assemble,
    jacobians,
    pose_error,
    pose_of,
)

# Two arms on a trunk that floats, a closed loop in one of them, and everything turned.
TWO_ARMS = """
<mujoco>
  <option gravity="0 0 0"><flag contact="disable"/></option>
  <default><geom type="capsule" size="0.02" mass="0.5"/></default>
  <worldbody>
    <site name="room" pos="1 2 3" euler="20 30 40"/>
    <body name="trunk"><freejoint name="float"/><geom fromto="0 0 0 0 0 0.5" mass="3"/>
      <site name="trunk"/>
      <body name="arm1" pos="0.2 0 0.5" euler="0 10 20">
        <joint name="a1" axis="0 0 1"/><joint name="a2" axis="0 1 0"/><geom fromto="0 0 0 0.3 0 0"/>
        <body name="fore1" pos="0.3 0 0"><joint name="a3" type="ball"/>
          <geom fromto="0 0 0 .2 0 .1"/>
          <site name="left" pos="0.2 0 0.1" euler="30 0 0"/></body></body>
      <body name="arm2" pos="-0.2 0 0.5">
        <joint name="b1" axis="0 1 0"/><geom fromto="0 0 0 -0.3 0 0"/>
        <body name="fore2" pos="-0.3 0 0"><joint name="b2" axis="0 1 0"/>
          <geom fromto="0 0 0 -0.1 0 -0.3"/><site name="right" pos="-0.1 0 -0.3" euler="0 0 50"/>
          <body name="rod" pos="-0.1 0 -0.3"><joint name="b3" axis="0 1 0"/>
            <geom fromto="0 0 0 0.3 0 0"/></body></body></body>
    </body>
  </worldbody>
  <equality><connect name="pin" body1="rod" body2="trunk" anchor="0.3 0 0"/></equality>
  <actuator>
    <motor name="m1" joint="a1"/><motor name="m2" joint="a2"/><motor name="m3" joint="b1"/>
    <motor name="m4" joint="a3" gear="1 0 0"/><motor name="m5" joint="a3" gear="0 1 0"/>
    <motor name="m6" joint="a3" gear="0 0 1"/>
  </actuator>
</mujoco>
"""
TASKS = [
    "left",
    Body("rod"),
    CenterOfMass(),
    CenterOfMass("arm1"),
    Relative("left", "right"),
    Relative(Body("rod"), "left"),
]


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(TWO_ARMS)


def some_pose(model: mujoco.MjModel, seed: int) -> mujoco.MjData:
    data = mujoco.MjData(model)
    step = 0.2 * np.random.default_rng(seed).normal(size=model.nv)
    mujoco.mj_integratePos(model, data.qpos, step, 1.0)
    return assemble(model, data)


def at(model: mujoco.MjModel, data: mujoco.MjData, step: np.ndarray) -> mujoco.MjData:
    there = mujoco.MjData(model)
    there.qpos[:] = data.qpos
    mujoco.mj_integratePos(model, there.qpos, step, 1.0)
    return there


@pytest.mark.parametrize("axes", [None, "room"])
@pytest.mark.parametrize("task", TASKS, ids=str)
def test_the_rows_of_a_task_are_the_slope_of_the_way_to_where_it_was(model, task, axes):
    """Central differences of pose_error along every velocity; their error falls as h^2."""
    data = some_pose(model, 0)
    jac = jacobians(model, data, task, axes)
    target = pose_of(model, data, task, axes)
    if isinstance(task, CenterOfMass):
        target = target.translation_m
    errors = []
    for h in (4e-3, 2e-3):
        ways = [
            pose_error(model, at(model, data, -e), task, target, axes)
            - pose_error(model, at(model, data, e), task, target, axes)
            for e in h * np.eye(model.nv)
        ]
        errors.append(np.abs(np.transpose(ways) / (2 * h) - jac.J_T[:, : model.nv]).max())
    assert errors[1] < 1e-4
    assert errors[1] < 0.3 * errors[0] + 1e-9


def test_rows_of_several_tasks_are_stacked_and_known_by_task(model):
    data = some_pose(model, 1)
    jac = jacobians(model, data, TASKS, "room")
    assert jac.J_T.shape == (6 + 6 + 3 + 3 + 6 + 6, model.nv + 3)  # three drives of the ball
    for task in TASKS:
        alone = jacobians(model, data, task, "room")
        np.testing.assert_array_equal(jac.J_T[jac.rows[task]], alone.J_T)
    assert jac.rows["left"] == slice(0, 6)


def test_what_two_frames_share_does_not_move_one_relative_to_the_other(model):
    """The floating trunk carries both hands."""
    data = some_pose(model, 2)
    J_T = jacobians(model, data, Relative("left", "right")).J_T
    assert np.abs(J_T[:, :6]).max() < 1e-14
    assert np.abs(J_T).max() > 0.1


def test_momentum_is_the_mass_times_the_velocity_of_the_centre_of_mass(model):
    """By MuJoCo's own kinetic quantities: the linear momentum of the bodies, summed up."""
    data = some_pose(model, 3)
    data.qvel[:] = np.random.default_rng(3).normal(size=model.nv)
    rows = jacobians(model, data, CenterOfMass()).J_T[:, : model.nv]
    mujoco.mj_fwdPosition(model, data)
    mujoco.mj_comVel(model, data)
    mujoco.mj_subtreeVel(model, data)
    np.testing.assert_allclose(rows @ data.qvel, data.subtree_linvel[0], atol=1e-12)


@pytest.mark.parametrize("task", ["left", Body("fore1"), CenterOfMass("arm1")], ids=str)
def test_rates_towards_a_target_arrive(model, task):
    """Newton on pose_error with the mapping of all task rows, the trunk held in place."""
    data = some_pose(model, 4)
    here = pose_of(model, data, task, "room")
    reach = Rotation.from_rotvec([0.05, -0.1, 0.08]).as_matrix()
    goal = Pose(reach @ here.rotation, here.translation_m)
    rows, target = [0, 1, 2], goal
    if isinstance(task, CenterOfMass):
        target, rows = here.translation_m + np.array([0.004, 0.003, 0.002]), [0, 1]
        target[2] = here.translation_m[2]
    for _ in range(8):
        jac = jacobians(model, data, task, "room", pinned=[])
        stuck = ConstrainedSystem(jac.J_T, jac.J_C, jac.active)
        kin = stuck.with_failures(locked_passive=range(6)).kinematics()
        way = pose_error(model, data, task, target, "room")
        rates = kin.velocity_mapping(rows, joint_weight=np.ones(6))(way[rows])
        data = advance(model, data, kin.velocities(rates), held=["float"])
    assert np.abs(pose_error(model, data, task, target, "room")[rows]).max() < 1e-9


def test_a_position_alone_leaves_the_rotation_as_it_is(model):
    data = some_pose(model, 5)
    way = pose_error(model, data, "left", [0.0, 0.0, 1.0])
    assert not way[:3].any()
    place = data.site("left").xpos
    np.testing.assert_allclose(way[3:], [0, 0, 1] - place, atol=1e-15)
    both = pose_error(model, data, ["left", CenterOfMass()], [[0, 0, 1], [0, 0, 0]])
    assert both.shape == (9,)


def test_a_task_that_does_not_exist_is_refused_by_name(model):
    data = mujoco.MjData(model)
    with pytest.raises(ModelError, match='the model has no site named "lefd"'):
        jacobians(model, data, "lefd")
    with pytest.raises(ModelError, match='the model has no body named "hand"'):
        jacobians(model, data, ["left", Body("hand")])
    with pytest.raises(ModelError, match='the model has no site named "up"'):
        jacobians(model, data, Relative("left", "up"))
    with pytest.raises(ModelError, match='the model has no body named "leg"'):
        jacobians(model, data, CenterOfMass("leg"))
    with pytest.raises(ModelError, match="no actuator moves 'room'"):
        jacobians(model, data, "room")
    with pytest.raises(ValueError, match="site must name a task at least"):
        jacobians(model, data, [])
    with pytest.raises(ValueError, match="site must not repeat a task"):
        jacobians(model, data, ["left", "left"])
    with pytest.raises(TypeError, match="site must be a str"):
        jacobians(model, data, 3)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="target must be a list of 2, got"):
        pose_error(model, data, ["left", "right"], [np.zeros(3)])
    with pytest.raises(ValueError, match=r"target must have shape \(3,\)"):
        pose_error(model, data, "left", np.zeros(4))
    with pytest.raises(ValueError, match="target must be a list of 1"):
        pose_error(model, data, ["left"], Pose(np.eye(3), np.zeros(3)))
    with pytest.raises(ValueError, match=r"target\.rotation must be a rotation matrix"):
        pose_error(model, data, "left", Pose(2 * np.eye(3), np.zeros(3)))
    with pytest.raises(ValueError, match=r"target\.rotation must have shape \(3, 3\)"):
        pose_error(model, data, "left", Pose(np.stack([np.eye(3)] * 2), np.zeros((2, 3))))


def test_a_name_is_that_of_a_site_or_else_of_a_body(model):
    """In tasks, pins, poses and axes."""
    data = mujoco.MjData(model)
    by_name = jacobians(model, data, ["fore1", Relative("right", "fore1")], axes="fore1")
    by_body = jacobians(model, data, [Body("fore1"), Relative("right", Body("fore1"))])
    R = data.body("fore1").xmat.reshape(3, 3)
    np.testing.assert_allclose(by_name.J_T, np.kron(np.eye(4), R.T) @ by_body.J_T, atol=1e-12)
    pose = pose_of(model, data, "fore1")
    np.testing.assert_array_equal(pose.translation_m, data.body("fore1").xpos)
    for pin in ("fore1", Pin("fore1")):
        held = jacobians(model, data, "left", pinned=[pin], active=True).J_C
        np.testing.assert_array_equal(held[-3:], by_body.J_T[3:6])
    both = mujoco.MjModel.from_xml_string("""<mujoco><worldbody><body name="tip"><joint name="j"/>
      <geom size="1"/><site name="tip" pos="1 0 0"/></body></worldbody>
      <actuator><motor joint="j"/></actuator></mujoco>""")
    there = pose_of(both, mujoco.MjData(both), "tip").translation_m
    np.testing.assert_array_equal(there, [1.0, 0.0, 0.0])


def test_a_model_without_joints_has_nothing_to_move():
    still = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><geom size="1"/><site name="s"/></worldbody></mujoco>'
    )
    with pytest.raises(ModelError, match="the model has no enabled actuator"):
        jacobians(still, mujoco.MjData(still), "s")
