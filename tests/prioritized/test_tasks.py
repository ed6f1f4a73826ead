"""Tasks: several frames, centres of mass and relative motion, and the way to a target."""

from functools import cache
from pathlib import Path

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

TASKS = [
    "left",
    Body("rod"),
    CenterOfMass(),
    CenterOfMass("arm1"),
    Relative("left", "right"),
    Relative(Body("rod"), "left"),
]


@cache
def two_arms() -> mujoco.MjModel:
    """On a trunk that floats, a closed loop in one of them, and everything turned."""
    return mujoco.MjModel.from_xml_path(str(Path(__file__).parents[1] / "models/two_arms.xml"))


@pytest.fixture
def model() -> mujoco.MjModel:
    return two_arms()


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
    assert jac.rows["left"] == slice(0, 6)
    for task in TASKS:
        alone = jacobians(model, data, task, "room")
        np.testing.assert_array_equal(jac.J_T[jac.rows[task]], alone.J_T)
    # What two frames share, the floating trunk, does not move one relative to the other.
    between = jac.J_T[jac.rows[Relative("left", "right")]]
    assert np.abs(between[:, :6]).max() < 1e-14 < 0.1 < np.abs(between).max()


def test_momentum_is_mass_times_velocity_of_the_centre_of_mass(model):
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


@pytest.mark.parametrize(
    ("task", "said"),
    [
        ("lefd", 'no site named "lefd"'),
        (["left", Body("hand")], 'no body named "hand"'),
        (Relative("left", "up"), 'no site named "up"'),
        (CenterOfMass("leg"), 'no body named "leg"'),
        ("room", "no actuator moves 'room'"),
    ],
)
def test_a_task_that_does_not_exist_is_refused_by_name(model, task, said):
    with pytest.raises(ModelError, match=said):
        jacobians(model, mujoco.MjData(model), task)


@pytest.mark.parametrize(
    ("task", "target", "said"),
    [
        (["left", "right"], [np.zeros(3)], "list of 2"),
        (["left"], Pose(np.eye(3), np.zeros(3)), "list of 1"),
        ("left", Pose(2 * np.eye(3), np.zeros(3)), "rotation must be a rotation matrix"),
    ],
)
def test_a_target_that_is_not_of_its_task_is_refused(model, task, target, said):
    with pytest.raises(ValueError, match=f"^target.*{said}"):
        pose_error(model, mujoco.MjData(model), task, target)


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
