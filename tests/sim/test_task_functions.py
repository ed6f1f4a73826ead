"""Task functions: the Jacobian of each is the slope of its error on the manifold of positions."""

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sim import (
    MODELS,
    Body,
    CenterOfMassTask,
    DampingTask,
    FrameTask,
    JacobianReader,
    JointCouplingTask,
    LookAtTask,
    ModelError,
    Pose,
    PostureTask,
    Relative,
    RelativeFrameTask,
    jacobians,
    load_model,
    pose_error,
    pose_of,
)
from sim.kinematics.pose import way_between
from sim.mjcf import one_half_turn
from sim.mjcf.frame import rotation_vector

HUMANOID = load_model(MODELS / "humanoid.xml")
BALL = mujoco.MjModel.from_xml_string(
    """
    <mujoco>
      <worldbody>
        <body>
          <joint name="slide" type="slide" axis="1 2 0"/>
          <geom size="0.1"/>
          <body pos="0.2 0.1 0">
            <joint name="ball" type="ball" pos="0 0 0.1"/>
            <geom size="0.1" pos="0.3 0 0"/>
            <site name="tip" pos="0.4 0.1 0" euler="10 20 30"/>
            <body name="last" pos="0.5 0 0">
              <joint name="hinge" axis="0 1 1"/>
              <geom size="0.1" pos="0 0.2 0"/>
              <site name="end" pos="0 0.3 0"/>
            </body>
          </body>
        </body>
      </worldbody>
      <actuator><motor joint="slide"/><motor joint="hinge"/></actuator>
    </mujoco>
    """
)
H = 1e-6
POINT = np.array([0.7, -0.4, 1.1])
TURNED = Pose(Rotation.from_rotvec([0.3, -0.2, 0.5]).as_matrix(), POINT)


def somewhere(model, seed=0):
    """A random state, frames up to date."""
    data, rng = mujoco.MjData(model), np.random.default_rng(seed)
    mujoco.mj_integratePos(model, data.qpos, rng.normal(scale=0.4, size=model.nv), 1.0)
    mujoco.mj_fwdPosition(model, data)
    return data


def after(model, data, velocity, time):
    """The state after a velocity, frames up to date."""
    there = mujoco.MjData(model)
    there.qpos[:] = data.qpos
    mujoco.mj_integratePos(model, there.qpos, velocity, time)
    mujoco.mj_fwdPosition(model, there)
    return there


def slopes(model, data, located):
    """How fast the error falls with each velocity, (k, nv), by central differences."""
    columns = [
        (
            located.error(model, after(model, data, unit, -H))
            - located.error(model, after(model, data, unit, H))
        )
        / (2 * H)
        for unit in np.eye(model.nv)
    ]
    return np.column_stack(columns)


def here(model, data, frame, root=None):
    """Where a frame is, as the target of a task."""
    at = data.body(frame.name) if isinstance(frame, Body) else data.site(frame)
    R, p = at.xmat.reshape(3, 3).copy(), at.xpos.copy()
    if root is None:
        return Pose(R, p)
    from_root = data.site(root)
    R0 = from_root.xmat.reshape(3, 3)
    return Pose(R0.T @ R, R0.T @ (p - from_root.xpos))


FRAMES = {
    "humanoid": (HUMANOID, "right_hand", "left_foot"),
    "ball joint": (BALL, "end", "tip"),
    "a body": (BALL, Body("last"), "tip"),
}


@pytest.mark.parametrize("model, frame, root", FRAMES.values(), ids=FRAMES)
def test_a_frame_at_its_target_leaves_it_with_its_twist(model, frame, root):
    data = somewhere(model)
    tasks = [
        FrameTask(frame, target=here(model, data, frame)),
        FrameTask(frame, target=here(model, data, frame), axes=frame, rows=[1, 3, 5]),
        RelativeFrameTask(frame, root, target=here(model, data, frame, root)),
        RelativeFrameTask(frame, root, target=here(model, data, frame, root), rows=[4, 0]),
    ]
    for task in tasks:
        located = task.on(model)
        np.testing.assert_allclose(located.error(model, data), 0.0, atol=1e-12)
        found = located.jacobian(model, data)
        assert found.shape == (len(located.angular), model.nv)
        np.testing.assert_allclose(found, slopes(model, data, located), atol=1e-8)


@pytest.mark.parametrize("model, frame, root", FRAMES.values(), ids=FRAMES)
def test_linear_rows_are_slopes_of_the_way_from_anywhere(model, frame, root):
    data = somewhere(model)
    for task in (
        FrameTask(frame, target=TURNED, rows=[3, 4, 5]),
        FrameTask(frame, target=POINT, rows=[3, 4, 5]),
        RelativeFrameTask(frame, root, target=POINT, rows=[3, 4, 5]),
    ):
        located = task.on(model)
        way = located.error(model, data)
        # Seen from a root that turns, the way turns as well.
        turning = isinstance(task, RelativeFrameTask)
        expected = slopes(model, data, located)
        assert np.linalg.norm(way) > 0.1
        if not turning:
            np.testing.assert_allclose(located.jacobian(model, data), expected, atol=1e-8)
        else:
            seen = [
                here(model, after(model, data, u, s), frame, root).translation_m
                for u in np.eye(model.nv)
                for s in (H, -H)
            ]
            rate = (np.array(seen[::2]) - np.array(seen[1::2])).T / (2 * H)
            np.testing.assert_allclose(located.jacobian(model, data), rate, atol=1e-8)


@pytest.mark.parametrize("seed", range(4))
def test_a_frame_turns_to_its_target_about_one_axis_and_its_error_is_that_of_pose_error(seed):
    data = somewhere(HUMANOID, seed)
    located = FrameTask("right_hand", target=TURNED).on(HUMANOID)
    way = located.error(HUMANOID, data)
    np.testing.assert_allclose(way, pose_error(HUMANOID, data, "right_hand", TURNED), atol=1e-12)
    R = data.site("right_hand").xmat.reshape(3, 3)
    np.testing.assert_allclose(Rotation.from_rotvec(way[:3]).as_matrix() @ R, TURNED.rotation)
    np.testing.assert_allclose(data.site("right_hand").xpos + way[3:], POINT)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-4, 1.0, 3.0, np.pi - 1e-6, np.pi])
def test_a_way_turns_as_mujoco_says(angle):
    """To round-off of the matrices, and of a half turn about the same of its two axes."""
    for seed in range(200):
        rng = np.random.default_rng(seed)
        axis = np.eye(3)[seed % 3] if seed % 2 else rng.normal(size=3)
        axis *= rng.choice([-1.0, 1.0]) / np.linalg.norm(axis)
        turn, here = Rotation.from_rotvec(angle * axis), Rotation.random(random_state=seed)
        R, R_to = here.as_matrix(), (turn * here).as_matrix()
        way = way_between(R, POINT, R_to, POINT + axis)
        np.testing.assert_allclose(way[:3], rotation_vector(R_to @ R.T), rtol=0, atol=1e-14)
        np.testing.assert_array_equal(way[3:], (POINT + axis) - POINT)
        expected = one_half_turn(angle * axis)
        np.testing.assert_allclose(way[:3], expected, rtol=0, atol=3e-15)


@pytest.mark.parametrize("rows", [[5], [1, 2], [2, 0, 4], [3, 4, 5, 0, 1, 2]])
@pytest.mark.parametrize("kind", [FrameTask, RelativeFrameTask])
def test_rows_come_in_the_order_in_which_they_are_named(rows, kind):
    data = somewhere(HUMANOID)
    every, some = (
        kind("right_hand", *([] if kind is FrameTask else ["left_foot"]), target=TURNED, rows=named)
        for named in (range(6), rows)
    )
    there, found = every.on(HUMANOID), some.on(HUMANOID)
    for method in ("error", "jacobian"):
        A = getattr(there, method)(HUMANOID, data)
        np.testing.assert_array_equal(getattr(found, method)(HUMANOID, data), A[rows])
    assert found.angular == tuple(np.array(there.angular)[rows])


def test_an_error_seen_from_a_root_is_that_of_pose_error():
    data = somewhere(HUMANOID)
    task = RelativeFrameTask("right_hand", "left_foot", target=TURNED)
    relative = Relative("right_hand", "left_foot")
    expected = pose_error(HUMANOID, data, relative, TURNED)
    R = data.site("left_foot").xmat.reshape(3, 3)
    found = (R @ task.on(HUMANOID).error(HUMANOID, data).reshape(2, 3).T).T.ravel()
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_a_position_leaves_the_rotation_as_it_is():
    data = somewhere(HUMANOID)
    located = FrameTask("right_hand", target=POINT).on(HUMANOID)
    assert not located.error(HUMANOID, data)[:3].any()


@pytest.mark.parametrize("body", [None, "waist_pitch"])
def test_a_centre_of_mass_moves_as_its_rows_say(body):
    data = somewhere(HUMANOID)
    located = CenterOfMassTask(body, rows=[2, 0], target=POINT).on(HUMANOID)
    found = located.jacobian(HUMANOID, data)
    np.testing.assert_allclose(found, slopes(HUMANOID, data, located), atol=1e-8)
    top = 0 if body is None else HUMANOID.body(body).id
    carried = [k for k in range(1, HUMANOID.nbody) if top in parents(HUMANOID, k)]
    center = HUMANOID.body_mass[carried] @ data.xipos[carried] / HUMANOID.body_mass[carried].sum()
    np.testing.assert_allclose(located.error(HUMANOID, data), (POINT - center)[[2, 0]])


def parents(model, body):
    """A body and all that carry it."""
    return {0} if not body else {body} | parents(model, int(model.body_parentid[body]))


@pytest.mark.parametrize("axis", [[1.0, 0.0, 0.0], [0.0, 0.0, -2.0], [0.3, -0.5, 0.7]])
@pytest.mark.parametrize("model, frame", [(HUMANOID, "right_hand"), (BALL, "tip")])
def test_an_axis_that_looks_at_its_target_loses_it_as_its_rows_say(model, frame, axis):
    data = somewhere(model)
    at = data.site(frame)
    target = at.xpos + 0.8 * at.xmat.reshape(3, 3) @ axis / np.linalg.norm(axis)
    located = LookAtTask(frame, axis, target=target).on(model)
    np.testing.assert_allclose(located.error(model, data), 0.0, atol=1e-8)
    found = located.jacobian(model, data)
    np.testing.assert_allclose(found, slopes(model, data, located), atol=1e-7)


@pytest.mark.parametrize("seed", range(4))
def test_the_angle_to_a_target_falls_as_the_rows_along_it_say(seed):
    """From anywhere: the slope of the angle is that of the error's length."""
    data, axis = somewhere(HUMANOID, seed), np.array([0.3, -0.5, 0.7])
    located = LookAtTask("right_hand", axis, target=POINT).on(HUMANOID)
    way = located.error(HUMANOID, data)
    angles = []
    for unit in np.eye(HUMANOID.nv):
        for time in (H, -H):
            there = after(HUMANOID, data, unit, time).site("right_hand")
            sight = POINT - there.xpos
            gaze = there.xmat.reshape(3, 3) @ axis
            cosine = gaze @ sight / np.linalg.norm(sight) / np.linalg.norm(axis)
            angles.append(np.arccos(cosine))
    falling = (np.array(angles[1::2]) - np.array(angles[::2])) / (2 * H)
    along = way / np.linalg.norm(way) @ located.jacobian(HUMANOID, data)
    np.testing.assert_allclose(along, falling, atol=1e-7)


def test_turning_about_the_axis_that_looks_changes_nothing():
    data = somewhere(HUMANOID)
    located = LookAtTask("right_hand", [0, 0, 1], target=POINT).on(HUMANOID)
    twist = jacobians(HUMANOID, data, "right_hand").J_T
    along = data.site("right_hand").xmat.reshape(3, 3)[:, 2]
    roll = np.linalg.pinv(twist) @ np.concatenate([along, np.zeros(3)])
    np.testing.assert_allclose(located.jacobian(HUMANOID, data) @ roll, 0.0, atol=1e-10)


@pytest.mark.parametrize("way", [1.0, -1.0], ids=["ahead", "behind"])
def test_straight_ahead_nothing_is_missing_and_straight_behind_half_a_turn(way):
    data = mujoco.MjData(BALL)
    mujoco.mj_fwdPosition(BALL, data)
    at = data.site("end")
    target = at.xpos + way * at.xmat.reshape(3, 3)[:, 0]
    located = LookAtTask("end", [1, 0, 0], target=target).on(BALL)
    error = np.linalg.norm(located.error(BALL, data))
    np.testing.assert_allclose(error, 0.0 if way > 0 else np.pi, atol=1e-7)


def test_a_target_at_the_frame_itself_asks_for_nothing():
    data = somewhere(BALL)
    located = LookAtTask("end", [1, 0, 0], target=data.site("end").xpos).on(BALL)
    assert not located.error(BALL, data).any() and np.isfinite(located.jacobian(BALL, data)).all()


def test_a_posture_is_as_far_as_mujoco_says_and_free_joints_do_not_count():
    data = somewhere(HUMANOID)
    home = HUMANOID.qpos0
    located = PostureTask(target=home).on(HUMANOID)
    away = np.empty(HUMANOID.nv)
    mujoco.mj_differentiatePos(HUMANOID, away, 1.0, home, data.qpos)
    np.testing.assert_allclose(located.error(HUMANOID, data), -away[6:])
    np.testing.assert_array_equal(located.velocities, np.arange(6, 35))
    knees = PostureTask(joints=["right_knee", "left_knee"], target=home).on(HUMANOID)
    expected = [HUMANOID.joint(f"{side}_knee").dofadr[0] for side in ("left", "right")]
    np.testing.assert_array_equal(knees.velocities, sorted(expected))
    np.testing.assert_allclose(knees.error(HUMANOID, data), -away[sorted(expected)])


def test_a_posture_of_a_ball_joint_is_a_rotation_vector():
    data = somewhere(BALL)
    located = PostureTask(joints=["ball"], target=BALL.qpos0).on(BALL)
    there = after(BALL, data, np.eye(BALL.nv)[1:4].T @ located.error(BALL, data), 1.0)
    assert abs(np.abs(there.qpos[1:5] @ BALL.qpos0[1:5]) - 1.0) < 1e-12


def test_damping_asks_all_joints_for_rest():
    data, located = somewhere(HUMANOID), DampingTask().on(HUMANOID)
    assert len(located.velocities) == HUMANOID.nv and not located.error(HUMANOID, data).any()


def test_a_coupling_is_the_sum_of_positions():
    data = somewhere(BALL)
    located = JointCouplingTask({"slide": 2.0, "hinge": -3.0}, target=0.5).on(BALL)
    slide, hinge = data.joint("slide").qpos[0], data.joint("hinge").qpos[0]
    np.testing.assert_allclose(located.error(BALL, data), [0.5 - 2 * slide + 3 * hinge])
    found = located.jacobian(BALL, data)
    np.testing.assert_allclose(found, slopes(BALL, data, located), atol=1e-8)
    with pytest.raises(ModelError, match='"ball" is no slide and no hinge'):
        JointCouplingTask({"ball": 1.0}).on(BALL)


def test_rows_of_all_tasks_stack_and_their_accuracy_is_known():
    """The entries' accuracy is that of rounded numbers: moved by half a digit they stay within."""
    data = somewhere(HUMANOID)
    tasks = [
        FrameTask("right_hand", rows=[3, 4, 5], target=POINT),
        LookAtTask("left_hand", [0, 0, 1], target=POINT),
        JointCouplingTask({"left_knee": 1.0, "right_knee": -1.0}),
        PostureTask(target=HUMANOID.qpos0),
    ]
    jac = JacobianReader(HUMANOID, tasks, active=["root"]).at(data)
    assert jac.J_T.shape == (3 + 2 + 1 + 29, 35)
    assert [jac.rows[task].stop for task in tasks] == [3, 5, 6, 35]
    np.testing.assert_array_equal(jac.J_T[6:], np.eye(35)[6:])
    assert jac.accuracy is not None and jac.accuracy.task_units.shape == (35,)
    np.testing.assert_array_equal(jac.accuracy.task_units[3:], 1.0)
    assert np.isfinite(jac.accuracy.J_T_error).all()


@pytest.mark.parametrize(
    "make, expected",
    [
        (lambda: FrameTask("a", target=np.ones(2)), r"target must have shape \(3,\)"),
        (lambda: FrameTask("a", rows=[6]), r"rows must lie in 0\.\.5"),
        (lambda: FrameTask("a", rows=[]), "rows must have one at least"),
        (lambda: FrameTask("a", gain=1.5), r"gain must be from 0 to 1"),
        (lambda: FrameTask("a", weight=-1.0), "weight must not be negative"),
        (lambda: FrameTask("a", damping=np.nan), "damping"),
        (lambda: FrameTask("a", target=np.diag([1.0, 1.0, -1.0])), "target"),
        (lambda: LookAtTask("a", [0.0, 0.0, 0.0]), "axis must have a length"),
        (lambda: CenterOfMassTask(rows=[3]), r"rows must lie in 0\.\.2"),
        (lambda: JointCouplingTask({}), "coefficients must name a joint"),
        (lambda: PostureTask(target=[np.nan]), "target must be finite"),
        (lambda: PostureTask(target=[1.0]).on(BALL).error(BALL, mujoco.MjData(BALL)), "target of"),
        (lambda: FrameTask("tip").on(BALL).error(BALL, mujoco.MjData(BALL)), "must be set before"),
    ],
)
def test_a_wrong_argument_is_refused_by_name(make, expected):
    with pytest.raises(ValueError, match=expected):
        make()


def test_a_target_is_checked_when_it_is_set_and_is_a_copy():
    task, point = FrameTask("tip"), POINT.copy()
    task.target = point
    point[:] = 0.0
    np.testing.assert_array_equal(task.target, POINT)
    with pytest.raises(ValueError, match="target"):
        task.target = [1.0, np.nan, 0.0]
    np.testing.assert_array_equal(task.target, POINT)


def test_a_frame_that_does_not_exist_is_refused_with_the_nearest():
    with pytest.raises(ModelError, match='did you mean "tip"'):
        FrameTask("tipp").on(BALL)
    assert pose_of(BALL, somewhere(BALL), "tip").translation_m.shape == (3,)
