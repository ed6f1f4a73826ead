"""Inverse kinematics: strict levels of tasks, under any failure, on arms, loops and legs."""

from dataclasses import dataclass
from typing import Any

import mink
import mujoco
import numpy as np
import pytest
from scipy.linalg import null_space

from fjh.ik import Ik, Limits
from prioritized import Status
from sim import (
    Array,
    Body,
    CenterOfMass,
    CenterOfMassTask,
    DampingTask,
    FrameTask,
    JointCouplingTask,
    LookAtTask,
    ModelError,
    Pin,
    PostureTask,
    RelativeFrameTask,
    TaskFunction,
    assemble,
    jacobians,
    pose_of,
)
from tests.fjh.ik.models import DT, model_of, random_state, remaining_error, shifted, state_after

FEET = "left_foot", "right_foot"
LEGS = "front_left", "front_right", "rear_left", "rear_right"
FREELY = Limits(ranges=False)
POSITION = [3, 4, 5]


def rows(model: mujoco.MjModel, data: mujoco.MjData, task: TaskFunction) -> tuple[Array, Array]:
    """Return the Jacobian and the target velocity of a task, without a solver."""
    located = task.on(model)
    return located.jacobian(model, data), task.gain / DT * located.error(model, data)


def by_null_spaces(levels: list[tuple[Array, Array]], n: int, locked: list[int]) -> Array:
    """Return the textbook's recursion of null spaces, with ranks by numpy."""
    v, free = np.zeros(n), np.delete(np.eye(n), locked, axis=1)
    for A, b in levels:
        v = v + free @ np.linalg.pinv(A @ free, rcond=1e-9) @ (b - A @ v)
        free = free @ null_space(A @ free, rcond=1e-9)
    return v


@pytest.mark.parametrize("seed", range(8))
def test_strict_levels_are_those_of_the_recursion_of_null_spaces(seed):
    """Levels of tasks are random, without limits and damping, with a locked joint."""
    rng, model = np.random.default_rng(seed), model_of("humanoid")
    data = random_state(model, seed)
    here = pose_of(model, data, "right_hand")
    tasks = [
        FrameTask("right_hand", rows=POSITION, target=here.translation_m + rng.normal(size=3)),
        LookAtTask("left_hand", [0, 0, 1], target=[3.0, 1.0, 0.5]),
        JointCouplingTask({"left_knee": 1.0, "right_knee": 0.5}, target=0.2),
        CenterOfMassTask(rows=[0, 1], target=rng.normal(size=3)),
        RelativeFrameTask("right_foot", "left_foot", target=here),
    ]
    for task in tasks:  # targets may be far away
        task.damping = 0.0
    order = [tasks[k] for k in rng.permutation(len(tasks))]
    weight, locked = np.arange(1.0, 36.0), ["left_knee"] if seed % 2 else []
    last = DampingTask(weight=weight) if seed < 4 else PostureTask(target=model.qpos0, gain=0.3)
    A, b = rows(model, data, last)
    if seed < 4:
        A, b = weight[:, None] * A, weight * b
    levels = [*(rows(model, data, task) for task in order), (A, b)]
    expected = by_null_spaces(levels, 35, [model.joint(name).dofadr[0] for name in locked])
    ik = Ik(model, [*order, last], FREELY, active=["root"]).with_failures(locked=locked)
    np.testing.assert_allclose(ik.step(data, DT), expected, atol=1e-9 * np.abs(expected).max())


def test_a_level_of_several_tasks_weighs_them():
    """The result is the weighted mean, since one slide cannot reach two positions."""
    model = model_of("xy_table")
    to_left = FrameTask("a", rows=[3], target=[-1.0, 0, 0], weight=1.0)
    to_right = FrameTask("b", rows=[3], target=[3.0, 0, 0], weight=2.0)
    rates = Ik(model, [[to_left, to_right]], FREELY).step(mujoco.MjData(model), DT)
    np.testing.assert_allclose(rates * DT, [(1 * -1.0 + 4 * 2.0) / 5, 0.0])


def test_failures_compose_and_do_not_change_the_healthy_solver():
    model, tool = model_of("arm"), FrameTask("payload", target=np.zeros(3))
    data, healthy = random_state(model, 1), Ik(model, [tool], FREELY)
    before = healthy.step(data, DT)
    both = healthy.with_failures(locked=["joint1"]).with_failures(locked=["joint4"])
    assert not both.step(data, DT)[[0, 3]].any()
    np.testing.assert_array_equal(healthy.step(data, DT), before)
    free = healthy.with_failures(free=["joint2"])  # self-motion moves the task
    assert free.solve(data, DT).status is Status.SELF_MOTION


@pytest.mark.parametrize("joint", ["joint2", "joint5", "joint9"])
def test_two_arms_carry_their_load_while_a_joint_is_locked(joint):
    """Twelve joints in a loop control six motions; eleven only five of them."""
    model, load = model_of("arms"), Body("load")
    data = assemble(model)
    start, place = pose_of(model, data, load), FrameTask(load, rows=POSITION)
    ik = Ik(model, [place, FrameTask(load, rows=[0, 1, 2], target=start)], FREELY)
    ik = ik.with_failures(locked=[joint])
    for k in range(40):
        place.target = start.translation_m + 0.001 * k * np.array([0.5, 0.0, 1.0])
        data = state_after(ik, data, 1)
        assert np.abs(data.efc_pos[: data.ne]).max() < 1e-9
    assert remaining_error(place, model, data) < 1e-4


def walking() -> tuple[mujoco.MjData, list[FrameTask], FrameTask]:
    """Return a quadruped with three feet on the ground and one that steps, and its trunk."""
    model = model_of("quadruped")
    data = assemble(model)
    places = {leg: pose_of(model, data, leg).translation_m for leg in LEGS}
    places[LEGS[0]] = np.add(places[LEGS[0]], [0.04, 0.0, 0.05])
    feet = [FrameTask(leg, rows=POSITION, target=place) for leg, place in places.items()]
    trunk = pose_of(model, data, "trunk")
    return data, feet, FrameTask("trunk", target=shifted(trunk, 0.01, 0.01, -0.01))


@pytest.mark.parametrize("locked", [None, "rear_left_hip"])
def test_a_quadruped_steps_with_its_trunk_as_a_variable(locked):
    """The feet have priority if a hip is locked, and the trunk misses its target."""
    model, (data, feet, trunk) = model_of("quadruped"), walking()
    ik = Ik(model, [feet[1:], feet[0], trunk, PostureTask(target=data.qpos)], active=["root"])
    data = state_after(ik if locked is None else ik.with_failures(locked=[locked]), data, 60)
    for foot in feet:
        assert remaining_error(foot, model, data) < (1e-9 if locked is None else 1e-6)
    if locked is None:
        assert remaining_error(trunk, model, data) < 1e-9
    else:
        assert 1e-4 < remaining_error(trunk, model, data) < 0.05


def test_a_task_that_no_actuator_moves_needs_active_variables():
    model, (data, feet, trunk) = model_of("quadruped"), walking()
    steps = [
        Ik(model, [feet[1:], feet[0], trunk], active=active).step(data, DT)
        for active in (["root"], [model.joint("root").id], True)
    ]
    np.testing.assert_array_equal(steps[0], steps[1])
    np.testing.assert_allclose(steps[0], steps[2], atol=1e-12)
    with pytest.raises(ModelError, match=r"no actuator moves .* variables in active="):
        Ik(model, [trunk])


@pytest.mark.parametrize("stands_by", ["tasks", "pins"])
@pytest.mark.parametrize("locked", [[], ["left_knee"]])
def test_a_humanoid_follows_with_its_hand_and_both_feet_stay(stands_by, locked):
    model = model_of("humanoid")
    data = assemble(model)
    feet = [FrameTask(foot, target=pose_of(model, data, foot)) for foot in FEET]
    center = pose_of(model, data, CenterOfMass()).translation_m
    com, hand = CenterOfMassTask(rows=[0, 1], target=center), FrameTask("right_hand", rows=POSITION)
    start, posture = pose_of(model, data, "right_hand"), PostureTask(target=data.qpos, gain=0.1)
    if stands_by == "tasks":
        ik = Ik(model, [feet, com, hand, posture], active=["root"])
    else:
        ik = Ik(model, [com, hand, posture], pinned=[Pin(foot, weld=True) for foot in FEET])
    ik = ik.with_failures(locked=locked)
    stood, last = [pose_of(model, data, foot) for foot in FEET], 10 if locked else 30
    for k in range(1, last + 11):
        hand.target = start.translation_m + 0.005 * min(k, last) * np.array([1.0, 0.3, 0.6])
        data = state_after(ik, data, 1, 0.02)
    for foot, before in zip(FEET, stood, strict=True):
        now = pose_of(model, data, foot)
        assert np.abs(now.translation_m - before.translation_m).max() < 1e-7
        assert np.abs(now.rotation - before.rotation).max() < 1e-7
    assert remaining_error(hand, model, data) < (1e-8 if locked else 1e-5)
    assert remaining_error(com, model, data) < 1e-5
    assert not locked or abs(data.joint("left_knee").qpos[0]) < 1e-12


def three_links(*angles: float) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Return a planar arm with a reach of 0.9 m, stretched along x at joint angles of zero."""
    model = model_of("three_links")
    data = mujoco.MjData(model)
    data.qpos[:] = angles
    mujoco.mj_forward(model, data)
    return model, data


BENT, STRETCHED = (-0.3, 0.6, -0.3), (0.0, 0.0, 0.0)


@pytest.mark.parametrize("bend", [1e-1, 1e-2, 1e-4, 1e-7])
def test_near_a_singular_pose_damping_bounds_the_rates_at_a_stated_cost(bend):
    model, data = three_links(-bend / 2, bend, 0.0)
    target = data.site("payload").xpos - [1e-3, 0.0, 0.0]
    tip = FrameTask("payload", rows=[3, 5], target=target, weight=1.0, damping=0.02)
    answer = Ik(model, [tip], FREELY).solve(data, DT)
    A, b = rows(model, data, tip)
    expected = A.T @ np.linalg.solve(A @ A.T + 0.02**2 * np.eye(2), b)
    np.testing.assert_allclose(answer.qvel, expected, rtol=1e-6, atol=1e-9)
    assert np.abs(answer.qvel).max() <= np.linalg.norm(b) / (2 * 0.02)
    lost = np.linalg.norm(A @ expected - b)
    assert abs(answer.solution.damping_errors[0] - lost) < 1e-9
    assert answer.status is Status.DAMPED and f"level 1 by {lost:.2g}" in str(answer)


def rate_at_end(ik: Ik, data: mujoco.MjData, ticks: int) -> float:
    """Return the largest rate of the last ticks."""
    fastest = 0.0
    for k in range(ticks):
        ik.advance(data, ik.step(data, DT), DT, into=data)
        if k >= ticks - 20:
            fastest = max(fastest, float(np.abs(data.qvel).max()))
    return fastest


@pytest.mark.long
@pytest.mark.filterwarnings("ignore:the step is shortened")
@pytest.mark.parametrize(
    "limits", [FREELY, Limits(velocity=2.0), Limits(velocity=2.0, acceleration=20.0)]
)
@pytest.mark.parametrize("gain", [0.2, 1.0])
@pytest.mark.parametrize("distance", [1.0, 1.8, 9.0])
@pytest.mark.parametrize("level", ["alone", "with damping", "before a posture"])
def test_out_of_reach_an_arm_rests_at_the_nearest_point(level, distance, gain, limits):
    """The arm stretches towards the target at any distance and gain."""
    model, data = three_links(*BENT)
    target = distance * np.array([0.6, 0.0, -0.8])
    tip = FrameTask("payload", rows=[3, 5], target=target, gain=gain)
    posture = PostureTask(target=data.qpos.copy(), gain=gain)
    damping_task = DampingTask(weight=0.1)
    levels = {
        "alone": [tip],
        "with damping": [[tip, damping_task]],
        "before a posture": [tip, posture],
    }
    assert rate_at_end(Ik(model, levels[level], limits), data, 300) < 1e-3
    np.testing.assert_allclose(data.site("payload").xpos, 0.9 * target / distance, atol=1e-4)


def test_an_unreachable_task_does_not_degrade_other_levels():
    """Height has priority, then distance as far as possible, then the roll, which is free."""
    model, data = three_links(*BENT)
    height = FrameTask("payload", rows=[5], target=[0.0, 0.0, 0.5])
    far = FrameTask("payload", rows=[3], target=[4.0, 0.0, 0.0])
    assert rate_at_end(Ik(model, [height, far], Limits(velocity=2.0)), data, 100) < 1e-3
    np.testing.assert_allclose(data.site("payload").xpos, [np.sqrt(0.81 - 0.25), 0, 0.5], atol=1e-6)
    arm = model_of("arm")
    data, wrist = assemble(arm), PostureTask(joints=["joint7"], target=np.full(7, 0.4))
    hand = FrameTask("payload", rows=POSITION, target=[3.0, 0.0, 1.0])
    assert rate_at_end(Ik(arm, [hand, wrist], Limits(velocity=2.0)), data, 150) < 1e-3
    assert abs(data.qpos[6] - 0.4) < 1e-6


@pytest.mark.parametrize(
    "name, frame", [("arm", "payload"), ("mobile", "tool"), ("arms", "payload")]
)
def test_near_a_reachable_target_no_damping_is_added_to_the_bit(name, frame):
    model, steps = model_of(name), []
    data = random_state(model, 3, 0.1)
    for damping in (None, 0.0):
        goal = shifted(pose_of(model, data, frame), 0.004, -0.003, 0.005)
        task = FrameTask(frame, rows=POSITION, target=goal, damping=damping)
        steps.append(Ik(model, [task], Limits(velocity=3.0)).step(data, DT))
    np.testing.assert_array_equal(*steps)


@pytest.mark.parametrize("kind", [FrameTask, CenterOfMassTask, RelativeFrameTask])
def test_a_task_is_evaluated_at_the_present_pose(kind):
    """Rows by numpy are the reference; an unreachable row at any pose is an error."""
    model, data = three_links(*BENT)
    if kind is CenterOfMassTask:
        task = CenterOfMassTask(rows=[0], target=data.subtree_com[0] + 0.01)
    else:
        frames = ["payload", Body("world")][: 1 if kind is FrameTask else 2]
        task = kind(*frames, rows=[3], target=data.site("payload").xpos + 0.01)
    A, _ = rows(model, data, task)
    rates = Ik(model, [task], FREELY).step(data, DT)
    np.testing.assert_allclose(rates, np.linalg.pinv(A)[:, 0] * 0.01 / DT, rtol=1e-6, atol=1e-9)
    _, stretched = three_links(*STRETCHED)
    assert Ik(model, [task], FREELY).solve(stretched, DT).status is Status.LEAST_SQUARES
    assert not jacobians(model, stretched, task).J_T.any()
    with pytest.raises(ModelError, match="no actuator moves"):
        Ik(model, [FrameTask("payload", rows=[4], target=np.zeros(3))])


@pytest.mark.parametrize(
    "task, name, value",
    [
        (FrameTask("payload"), "weight", 2.0),
        (FrameTask("payload"), "frame", Body("link3")),
        (CenterOfMassTask(), "body", "link3"),
        (PostureTask(), "joints", ["joint1"]),
        (LookAtTask("payload", [0, 0, 1]), "axis", [1, 0, 0]),
        (JointCouplingTask({"joint1": 1.0}), "coefficients", {"joint2": 1.0}),
    ],
)
def test_attributes_of_a_task_are_fixed_once_an_ik_uses_it(task, name, value):
    """Attributes set before are checked; the gain can be set at any time."""
    with pytest.raises((TypeError, ValueError), match=name):
        setattr(task, name, object())
    setattr(task, name, value)
    Ik(model_of("arm"), [task])
    with pytest.raises(AttributeError, match=f"{name} of .* is fixed .* another Ik"):
        setattr(task, name, value)
    task.gain = 0.5


def test_a_solution_does_not_depend_on_earlier_steps():
    model, tool, answers = model_of("mobile"), FrameTask("tool"), []
    ik = Ik(model, [tool, PostureTask(target=model.qpos0)], Limits(velocity=1.0))
    for seed, size, shift in ((5, 0.1, 0.1), (6, 0.2, -0.2), (5, 0.1, 0.1)):
        data = random_state(model, seed, size)
        tool.target = shifted(pose_of(model, data, "tool"), shift, 0.1, -shift)
        answers.append(ik.step(data, DT))
    np.testing.assert_array_equal(answers[0], answers[2])


@pytest.mark.parametrize("locked", [[], ["joint2"]])
@pytest.mark.parametrize("name, frame", [("arm", "payload"), ("arms", Body("load"))])
def test_a_stored_solution_does_not_change_with_further_steps(name, frame, locked):
    """The compiled velocity equals that of the full solution and, to the bit, that of a step."""
    model, tool = model_of(name), FrameTask(frame)
    data = random_state(model, 4, 0.1)
    ik = Ik(model, [tool, PostureTask(target=data.qpos)], Limits(velocity=2.0))
    ik = ik.with_failures(locked=locked)
    solutions, results = [], []
    for _ in range(3):
        tool.target = shifted(pose_of(model, data, frame), 0.01, 0.0, 0.01)
        solutions.append(ik.solve(data, DT))
        solved = ik.solve(data, DT)
        rates = solved.kinematics.velocities(solved.solution.rates)[: model.nv]
        np.testing.assert_allclose(solved.qvel, rates, rtol=0, atol=1e-9 * np.abs(rates).max())
        results.append(
            (solved.qvel.copy(), solved.kinematics.J.copy(), solved.residuals, str(solved))
        )
        np.testing.assert_array_equal(ik.step(data, DT), solved.qvel)
        ik.advance(data, solved.qvel, DT, into=data)
    for solution, (qvel, J, residuals, text) in zip(solutions, results, strict=True):
        np.testing.assert_array_equal(solution.qvel, qvel)
        np.testing.assert_array_equal(solution.kinematics.J, J)
        np.testing.assert_equal(solution.residuals, residuals)
        assert str(solution) == text


@pytest.mark.parametrize(
    "tasks, active, pattern",
    [
        (2 * [FrameTask("payload")], [], "no task twice"),
        ([FrameTask("payload")], ["joint1"], "joint1"),
        ([[FrameTask("payload", weight=[1, 2])]], [], r"must be one number or 6 numbers, got 2"),
    ],
)
def test_invalid_levels_are_rejected(tasks, active, pattern):
    with pytest.raises((ValueError, ModelError), match=pattern):
        Ik(model_of("arm"), tasks, active=active)


@dataclass(eq=False)
class _UserTask(TaskFunction):
    """A user-defined task with one row whose error and Jacobian a function returns."""

    returns: Any = None
    frames: tuple = ()
    angular: tuple[bool, ...] = (False,)

    def on(self, model: mujoco.MjModel) -> "_UserTask":
        return self

    def error(self, model, data):
        return self.returns(model, data)[0]

    def jacobian(self, model, data):
        return self.returns(model, data)[1]


def hand_distance(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[Array, Array]:
    """Return 0.25 m minus the distance of the hands, and the Jacobian of the distance."""
    hands, rows = [data.site(f"{side}_hand") for side in ("left", "right")], np.zeros((2, 3, 35))
    for hand, J in zip(hands, rows, strict=True):
        mujoco.mj_jacSite(model, data, J, None, hand.id)
    distance = hands[1].xpos - hands[0].xpos
    length = np.linalg.norm(distance)
    return np.array([0.25 - length]), (distance / length @ (rows[1] - rows[0]))[None]


def test_a_user_defined_task_is_achieved():
    model = model_of("humanoid")
    data = random_state(model, 4, 0.2)
    ik = Ik(
        model,
        [_UserTask(returns=hand_distance), PostureTask(target=data.qpos, gain=0.2)],
        active=["root"],
    )
    assert abs(hand_distance(model, state_after(ik, data, 60))[0]) < 1e-9


ONES = np.ones((1, 7))
MASKED, COMPLEX = (np.ma.masked_array([1.0], [True]), ONES * 1j)


@pytest.mark.parametrize("wrong", [MASKED, COMPLEX, None, "near", [np.nan], [1.0, 2.0], [None]])
@pytest.mark.parametrize("what", ["error", "Jacobian"])
def test_invalid_errors_and_jacobians_of_user_defined_tasks_are_rejected(what, wrong):
    """A list is as valid as an array."""
    arm, returns = model_of("arm"), (wrong, ONES) if what == "error" else ([0.1], wrong)
    rates = Ik(arm, [_UserTask(returns=lambda *_: ([0.7], ONES.tolist()))], FREELY).step(
        assemble(arm), DT
    )
    np.testing.assert_allclose(rates, 0.7 / DT / 7)
    with pytest.raises(
        ValueError, match=f"the {what} of _UserTask.* must (be|hold|have)"
    ) as rejection:
        Ik(arm, [_UserTask(returns=lambda *_: returns)]).step(assemble(arm), DT)
    assert "\n" not in str(rejection.value)


def test_compatible_tasks_give_the_velocity_of_mink():
    """Tasks of the humanoid do not conflict, so that weights do not matter."""
    model = model_of("humanoid")
    data = mujoco.MjData(model)
    targets = {name: pose_of(model, data, name) for name in ("left_foot", "right_foot")}
    targets["right_hand"] = shifted(pose_of(model, data, "right_hand"), 0.02, -0.01, 0.03)
    com = pose_of(model, data, CenterOfMass()).translation_m + 0.004
    center = mink.ComTask(cost=1.0)
    center.set_target(com)
    mink_tasks: list[mink.Task] = [center]
    tasks: list[TaskFunction] = [CenterOfMassTask(target=com)]
    for name, target in targets.items():
        task = mink.FrameTask(name, "site", position_cost=1.0, orientation_cost=1.0)
        task.set_target(mink.SE3.from_matrix(target.matrix()))
        mink_tasks.append(task)
        tasks.append(FrameTask(name, target=target))
    configuration = mink.Configuration(model, data.qpos)
    v = mink.solve_ik(configuration, mink_tasks, dt=DT, solver="daqp", limits=[], damping=1e-12)
    ik = Ik(model, [tasks], Limits(ranges=False), active=["root"])
    np.testing.assert_allclose(ik.step(data, DT), v, atol=2e-3 * np.abs(v).max())
