"""Task functions: rows are slopes of errors on the manifold; their order and names."""

from functools import partial

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sim import (
    Body,
    CenterOfMass,
    CenterOfMassTask,
    DampingTask,
    FrameTask,
    JacobianReader,
    JointCouplingTask,
    LookAtTask,
    ModelError,
    Pin,
    Pose,
    PostureTask,
    Relative,
    RelativeFrameTask,
    jacobians,
    pose_error,
    pose_of,
)
from sim.kinematics.pose import pose_difference
from sim.mjcf import one_half_turn
from sim.mjcf.frame import rotation_vector
from tests.models import model_of
from tests.motions import change, check_slope, shifted
from tests.sim.machines import closed_state, humanoid, open_state

H = 1e-6
arms = partial(model_of, "two_arms")
"""Load two arms with a ball joint and a free joint."""
POINT = np.array([0.7, -0.4, 1.1])
TURNED = Pose(Rotation.from_rotvec([0.3, -0.2, 0.5]).as_matrix(), POINT)


def slopes(model, data, function):
    """Return the central differences (k, nv) of a function of the state."""
    columns = [
        (function(shifted(model, data, H * e)) - function(shifted(model, data, -H * e))) / (2 * H)
        for e in np.eye(model.nv)
    ]
    return np.column_stack(columns)


def check_slopes(model, data, located, atol=1e-8):
    """Check that the error decreases with the Jacobian."""
    falling = -slopes(model, data, lambda there: located.error(model, there))
    np.testing.assert_allclose(located.jacobian(model, data), falling, atol=atol)


def pose_target(model, data, frame, root=None):
    """Return the present pose of a frame as a target."""
    at = data.body(frame.name) if isinstance(frame, Body) else data.site(frame)
    R, p = at.xmat.reshape(3, 3).copy(), at.xpos.copy()
    if root is None:
        return Pose(R, p)
    from_root = data.site(root)
    R0 = from_root.xmat.reshape(3, 3)
    return Pose(R0.T @ R, R0.T @ (p - from_root.xpos))


FRAMES = {
    "humanoid": (humanoid, "right_hand", "left_foot"),
    "ball joint": (arms, "left", "right"),
    "a body": (arms, Body("fore1"), "right"),
}
every_frame = pytest.mark.parametrize("make, frame, root", FRAMES.values(), ids=FRAMES)


@every_frame
def test_the_error_of_a_frame_at_its_target_changes_by_its_twist(make, frame, root):
    model = make()
    data = open_state(model, 0.4)
    at, seen = pose_target(model, data, frame), pose_target(model, data, frame, root)
    for task in (
        FrameTask(frame, target=at),
        FrameTask(frame, target=at, axes=frame, rows=[1, 3, 5]),
        RelativeFrameTask(frame, root, target=seen),
        RelativeFrameTask(frame, root, target=seen, rows=[4, 0]),
    ):
        located = task.on(model)
        np.testing.assert_allclose(located.error(model, data), 0.0, atol=1e-12)
        assert located.jacobian(model, data).shape == (len(located.angular), model.nv)
        check_slopes(model, data, located)


@every_frame
def test_linear_rows_are_slopes_of_the_displacement_at_any_distance(make, frame, root):
    """Relative to a rotating root the displacement rotates as well, so positions are checked."""
    model = make()
    data = open_state(model, 0.4)
    for target in (TURNED, POINT):
        located = FrameTask(frame, target=target, rows=[3, 4, 5]).on(model)
        assert np.linalg.norm(located.error(model, data)) > 0.1
        check_slopes(model, data, located)
    located = RelativeFrameTask(frame, root, target=POINT, rows=[3, 4, 5]).on(model)
    rate = slopes(model, data, lambda there: pose_target(model, there, frame, root).translation_m)
    np.testing.assert_allclose(located.jacobian(model, data), rate, atol=1e-8)


@pytest.mark.parametrize("seed", range(4))
def test_a_frame_turns_to_its_target_about_one_axis(seed):
    """The error is that of `pose_error`, also relative to a root in the axes of the root."""
    model, data = humanoid(), open_state(humanoid(), 0.4, seed)
    hand = data.site("right_hand")
    error = FrameTask("right_hand", target=TURNED).on(model).error(model, data)
    np.testing.assert_allclose(error, pose_error(model, data, "right_hand", TURNED), atol=1e-12)
    turned = Rotation.from_rotvec(error[:3]).as_matrix() @ hand.xmat.reshape(3, 3)
    np.testing.assert_allclose(turned, TURNED.rotation)
    np.testing.assert_allclose(hand.xpos + error[3:], POINT)
    # A position does not change the rotation.
    assert not FrameTask("right_hand", target=POINT).on(model).error(model, data)[:3].any()
    task = RelativeFrameTask("right_hand", "left_foot", target=TURNED)
    R = data.site("left_foot").xmat.reshape(3, 3)
    error = (task.on(model).error(model, data).reshape(2, 3) @ R.T).ravel()
    expected = pose_error(model, data, Relative("right_hand", "left_foot"), TURNED)
    np.testing.assert_allclose(error, expected, atol=1e-12)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-4, 1.0, 3.0, np.pi - 1e-6, np.pi])
def test_a_pose_difference_rotates_as_in_mujoco(angle):
    """Agreement is to round-off; half a turn is about the same of its two axes."""
    for seed in range(60):
        rng = np.random.default_rng(seed)
        axis = np.eye(3)[seed % 3] if seed % 2 else rng.normal(size=3)
        axis *= rng.choice([-1.0, 1.0]) / np.linalg.norm(axis)
        turn, here = Rotation.from_rotvec(angle * axis), Rotation.random(random_state=seed)
        R, R_to = here.as_matrix(), (turn * here).as_matrix()
        displacement = pose_difference(R, POINT, R_to, POINT + axis)
        np.testing.assert_allclose(
            displacement[:3], rotation_vector(R_to @ R.T), rtol=0, atol=1e-14
        )
        np.testing.assert_array_equal(displacement[3:], (POINT + axis) - POINT)
        np.testing.assert_allclose(
            displacement[:3], one_half_turn(angle * axis), rtol=0, atol=3e-15
        )


@pytest.mark.parametrize("rows", [[5], [1, 2], [2, 0, 4], [3, 4, 5, 0, 1, 2]])
@pytest.mark.parametrize("kind, more", [(FrameTask, ()), (RelativeFrameTask, ("left_foot",))])
def test_rows_are_in_the_requested_order(rows, kind, more):
    model, data = humanoid(), open_state(humanoid(), 0.4)
    every, some = (
        kind("right_hand", *more, target=TURNED, rows=chosen).on(model)
        for chosen in (range(6), rows)
    )
    for method in ("error", "jacobian"):
        A = getattr(every, method)(model, data)
        np.testing.assert_array_equal(getattr(some, method)(model, data), A[rows])
    assert some.angular == tuple(np.array(every.angular)[rows])


@pytest.mark.parametrize("body", [None, "waist_pitch"])
def test_a_centre_of_mass_moves_by_its_rows(body):
    model, data = humanoid(), open_state(humanoid(), 0.4)
    located = CenterOfMassTask(body, rows=[2, 0], target=POINT).on(model)
    check_slopes(model, data, located)
    center = data.subtree_com[0 if body is None else model.body(body).id]
    np.testing.assert_allclose(located.error(model, data), (POINT - center)[[2, 0]])


@pytest.mark.parametrize("axis", [[1.0, 0.0, 0.0], [0.0, 0.0, -2.0], [0.3, -0.5, 0.7]])
@pytest.mark.parametrize("make, frame", [(humanoid, "right_hand"), (arms, "left")])
def test_an_axis_turns_away_from_its_target_by_its_rows(make, frame, axis):
    model = make()
    data = open_state(model, 0.4)
    at = data.site(frame)
    target = at.xpos + 0.8 * at.xmat.reshape(3, 3) @ axis / np.linalg.norm(axis)
    located = LookAtTask(frame, axis, target=target).on(model)
    np.testing.assert_allclose(located.error(model, data), 0.0, atol=1e-8)
    check_slopes(model, data, located, atol=1e-7)


@pytest.mark.parametrize("seed", range(4))
def test_the_angle_to_a_target_decreases_by_its_rows(seed):
    """The slope of the angle is that of the norm of the error, from any direction."""
    model, axis = humanoid(), np.array([0.3, -0.5, 0.7])
    data = open_state(model, 0.4, seed)
    located = LookAtTask("right_hand", axis, target=POINT).on(model)

    def angle(there: mujoco.MjData) -> float:
        hand = there.site("right_hand")
        line_of_sight, pointing = POINT - hand.xpos, hand.xmat.reshape(3, 3) @ axis
        return np.arccos(
            pointing @ line_of_sight / np.linalg.norm(line_of_sight) / np.linalg.norm(axis)
        )

    error = located.error(model, data)
    along = error / np.linalg.norm(error) @ located.jacobian(model, data)
    np.testing.assert_allclose(along, -slopes(model, data, angle)[0], atol=1e-7)


@pytest.mark.parametrize("distance, missing", [(1.0, 0.0), (-1.0, np.pi), (0.0, 0.0)])
def test_the_error_is_zero_straight_ahead_and_half_a_turn_behind(distance, missing):
    model = arms()
    data = shifted(model, mujoco.MjData(model), np.zeros(model.nv))  # exactly
    at = data.site("left")
    located = LookAtTask("left", [1, 0, 0], target=at.xpos + distance * at.xmat[::3]).on(model)
    error = np.linalg.norm(located.error(model, data))
    np.testing.assert_allclose(error, missing, atol=1e-7)
    assert np.isfinite(located.jacobian(model, data)).all()


def test_a_posture_error_is_that_of_mujoco_without_free_joints():
    model, data = humanoid(), open_state(humanoid(), 0.4)
    home = model.qpos0
    located = PostureTask(target=home).on(model)
    away = change(model, home, data.qpos)
    np.testing.assert_allclose(located.error(model, data), -away[6:])
    np.testing.assert_array_equal(located.velocities, np.arange(6, 35))
    knees = PostureTask(joints=["right_knee", "left_knee"], target=home).on(model)
    expected = [model.joint(f"{side}_knee").dofadr[0] for side in ("left", "right")]
    np.testing.assert_array_equal(knees.velocities, sorted(expected))
    np.testing.assert_allclose(knees.error(model, data), -away[sorted(expected)])
    damped = DampingTask().on(model)  # commands zero velocity of all joints
    assert len(damped.velocities) == model.nv and not damped.error(model, data).any()


def test_a_posture_of_a_ball_joint_is_a_rotation_vector():
    model, data = arms(), open_state(arms(), 0.4)
    located, step = PostureTask(joints=["a3"], target=model.qpos0).on(model), np.zeros(model.nv)
    step[located.velocities] = located.error(model, data)
    turned, home = (
        shifted(model, data, step).joint("a3").qpos,
        mujoco.MjData(model).joint("a3").qpos,
    )
    assert abs(np.abs(turned @ home) - 1.0) < 1e-12


def test_a_coupling_is_the_sum_of_positions():
    model, data = arms(), open_state(arms(), 0.4)
    located = JointCouplingTask({"a1": 2.0, "a2": -3.0}, target=0.5).on(model)
    first, second = data.joint("a1").qpos[0], data.joint("a2").qpos[0]
    np.testing.assert_allclose(located.error(model, data), [0.5 - 2 * first + 3 * second])
    check_slopes(model, data, located)


def test_invalid_task_elements_are_rejected_with_the_remedy():
    model = arms()
    with pytest.raises(ModelError, match='"a3" is no slide and no hinge'):
        JointCouplingTask({"a3": 1.0}).on(model)
    with pytest.raises(ValueError, match="must name at least one joint"):
        JointCouplingTask({})
    with pytest.raises(ValueError, match="must be set before"):
        FrameTask("left").on(model).error(model, mujoco.MjData(model))


def test_a_target_is_a_copy():
    task, point = FrameTask("left"), POINT.copy()
    task.target = point
    point[:] = 0.0
    np.testing.assert_array_equal(task.target, POINT)


TASKS = [
    "left",
    Body("rod"),
    CenterOfMass(),
    CenterOfMass("arm1"),
    Relative("left", "right"),
    Relative(Body("rod"), "left"),
]


@pytest.mark.parametrize("axes", [None, "room"])
@pytest.mark.parametrize("task", TASKS, ids=str)
def test_the_rows_of_a_task_are_the_slope_of_its_displacement(task, axes):
    """Check every velocity, hence the error that rates reduce."""
    model = arms()
    data = closed_state(model)
    target = pose_of(model, data, task, axes)
    if isinstance(task, CenterOfMass):
        target = target.translation_m

    def displacement(h: float) -> np.ndarray:
        ends = [shifted(model, data, h * e) for e in np.eye(model.nv)]
        return -np.transpose([pose_error(model, end, task, target, axes) for end in ends])

    check_slope(
        jacobians(model, data, task, axes).J_T[:, : model.nv], displacement, h=4e-3, most=1e-4
    )


def test_rows_of_several_tasks_are_stacked_and_indexed_by_task():
    model = arms()
    data = closed_state(model, 1)
    looking = LookAtTask("left", [0, 0, 1], target=np.ones(3))
    functions = [looking, JointCouplingTask({"a1": 1.0}), PostureTask(target=model.qpos0)]
    tasks = [*TASKS, *functions]
    jac = JacobianReader(model, tasks, "room").at(data)
    assert [jac.rows[task].stop for task in tasks[:8]] == [6, 12, 15, 18, 24, 30, 32, 33]
    assert jac.J_T.shape == (jac.rows[tasks[8]].stop, model.nv + 3)  # three drives of the ball
    for task in tasks:
        alone = jacobians(model, data, task, "room")
        np.testing.assert_array_equal(jac.J_T[jac.rows[task]], alone.J_T)
    # The floating trunk of two frames does not move them relative to each other.
    between = jac.J_T[jac.rows[Relative("left", "right")]]
    assert np.abs(between[:, :6]).max() < 1e-14 < 0.1 < np.abs(between).max()


def test_a_name_is_that_of_a_site_or_else_of_a_body():
    model = arms()
    data = mujoco.MjData(model)
    by_name = jacobians(model, data, ["fore1", Relative("right", "fore1")], axes="fore1")
    by_body = jacobians(model, data, [Body("fore1"), Relative("right", Body("fore1"))])
    R = data.body("fore1").xmat.reshape(3, 3)
    np.testing.assert_allclose(by_name.J_T, np.kron(np.eye(4), R.T) @ by_body.J_T, atol=1e-12)
    pose = pose_of(model, data, "fore1")
    np.testing.assert_array_equal(pose.translation_m, data.body("fore1").xpos)
    for pin in ("fore1", Pin("fore1")):
        with_pin = jacobians(model, data, "left", pinned=[pin], active=True).J_C
        np.testing.assert_array_equal(with_pin[-3:], by_body.J_T[3:6])
    both = arms(('<site name="left"', '<site name="fore2"'))
    there = mujoco.MjData(both)
    place = pose_of(both, there, "fore2").translation_m
    np.testing.assert_array_equal(place, there.site("fore2").xpos)
    assert np.abs(place - there.body("fore2").xpos).max() > 0.01
