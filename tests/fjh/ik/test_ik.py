"""Inverse kinematics: strict levels of tasks, whatever fails, on arms, loops and legs."""

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
from tests.fjh.ik.models import DT, bent, missed, model_of, moved, shifted

FEET = "left_foot", "right_foot"
LEGS = "front_left", "front_right", "rear_left", "rear_right"
FREELY = Limits(ranges=False)
POSITION = [3, 4, 5]


def rows(model: mujoco.MjModel, data: mujoco.MjData, task: TaskFunction) -> tuple[Array, Array]:
    """Jacobian and velocity that a task asks for, apart from any solver."""
    located = task.on(model)
    return located.jacobian(model, data), task.gain / DT * located.error(model, data)


def by_null_spaces(levels: list[tuple[Array, Array]], n: int, locked: list[int]) -> Array:
    """The textbook's recursion of null spaces, rank by numpy."""
    v, free = np.zeros(n), np.delete(np.eye(n), locked, axis=1)
    for A, b in levels:
        v = v + free @ np.linalg.pinv(A @ free, rcond=1e-9) @ (b - A @ v)
        free = free @ null_space(A @ free, rcond=1e-9)
    return v


@pytest.mark.parametrize("seed", range(8))
def test_strict_levels_are_those_of_the_recursion_of_null_spaces(seed):
    """Without limits and damping, of tasks of all kinds in any order, with a joint that locks."""
    rng, model = np.random.default_rng(seed), model_of("humanoid")
    data = bent(model, seed)
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
    """Two positions that one slide cannot reach both: the weighted mean."""
    model = model_of("xy_table")
    to_left = FrameTask("a", rows=[3], target=[-1.0, 0, 0], weight=1.0)
    to_right = FrameTask("b", rows=[3], target=[3.0, 0, 0], weight=2.0)
    found = Ik(model, [[to_left, to_right]], FREELY).step(mujoco.MjData(model), DT)
    np.testing.assert_allclose(found * DT, [(1 * -1.0 + 4 * 2.0) / 5, 0.0])


def test_failures_compose_and_leave_the_healthy_one_alone():
    model, tool = model_of("arm"), FrameTask("payload", target=np.zeros(3))
    data, healthy = bent(model, 1), Ik(model, [tool], FREELY)
    before = healthy.step(data, DT)
    both = healthy.with_failures(locked=["joint1"]).with_failures(locked=["joint4"])
    assert not both.step(data, DT)[[0, 3]].any()
    np.testing.assert_array_equal(healthy.step(data, DT), before)
    free = healthy.with_failures(free=["joint2"])  # it moves the task by itself
    assert free.solve(data, DT).status is Status.SELF_MOTION


@pytest.mark.parametrize("joint", ["joint2", "joint5", "joint9"])
def test_two_arms_carry_their_load_and_keep_hold_of_it_when_a_joint_locks(joint):
    """Six motions of twelve joints in a loop; of five, its position and two rotations."""
    model, load = model_of("arms"), Body("load")
    data = assemble(model)
    start, place = pose_of(model, data, load), FrameTask(load, rows=POSITION)
    ik = Ik(model, [place, FrameTask(load, rows=[0, 1, 2], target=start)], FREELY)
    ik = ik.with_failures(locked=[joint])
    for k in range(40):
        place.target = start.translation_m + 0.001 * k * np.array([0.5, 0.0, 1.0])
        data = moved(ik, data, 1)
        assert np.abs(data.efc_pos[: data.ne]).max() < 1e-9
    assert missed(place, model, data) < 1e-4


def walking() -> tuple[mujoco.MjData, list[FrameTask], FrameTask]:
    """A quadruped with three feet that stand and one that steps, and its trunk."""
    model = model_of("quadruped")
    data = assemble(model)
    places = {leg: pose_of(model, data, leg).translation_m for leg in LEGS}
    places[LEGS[0]] = np.add(places[LEGS[0]], [0.04, 0.0, 0.05])
    feet = [FrameTask(leg, rows=POSITION, target=place) for leg, place in places.items()]
    trunk = pose_of(model, data, "trunk")
    return data, feet, FrameTask("trunk", target=shifted(trunk, 0.01, 0.01, -0.01))


@pytest.mark.parametrize("locked", [None, "rear_left_hip"])
def test_a_quadruped_steps_with_its_trunk_as_a_variable(locked):
    """With a hip locked the feet come first, and the trunk takes what is left."""
    model, (data, feet, trunk) = model_of("quadruped"), walking()
    ik = Ik(model, [feet[1:], feet[0], trunk, PostureTask(target=data.qpos)], active=["root"])
    data = moved(ik if locked is None else ik.with_failures(locked=[locked]), data, 60)
    for foot in feet:
        assert missed(foot, model, data) < (1e-9 if locked is None else 1e-6)
    if locked is None:
        assert missed(trunk, model, data) < 1e-9
    else:
        assert 1e-4 < missed(trunk, model, data) < 0.05


def test_variables_are_named_where_no_actuator_moves_a_task():
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
    stood, reach = [pose_of(model, data, foot) for foot in FEET], 10 if locked else 30
    for k in range(1, reach + 11):
        hand.target = start.translation_m + 0.005 * min(k, reach) * np.array([1.0, 0.3, 0.6])
        data = moved(ik, data, 1, 0.02)
    for foot, before in zip(FEET, stood, strict=True):
        now = pose_of(model, data, foot)
        assert np.abs(now.translation_m - before.translation_m).max() < 1e-7
        assert np.abs(now.rotation - before.rotation).max() < 1e-7
    assert missed(hand, model, data) < (1e-8 if locked else 1e-5)
    assert missed(com, model, data) < 1e-5
    assert not locked or abs(data.joint("left_knee").qpos[0]) < 1e-12


def three_links(*angles: float) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """A planar arm with a reach of 0.9 m, stretched along x where its joints are at zero."""
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


def rested(ik: Ik, data: mujoco.MjData, ticks: int) -> float:
    """The largest rate of the last ticks."""
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
    """However far, at any gain: stretched towards the target."""
    model, data = three_links(*BENT)
    target = distance * np.array([0.6, 0.0, -0.8])
    tip = FrameTask("payload", rows=[3, 5], target=target, gain=gain)
    posture = PostureTask(target=data.qpos.copy(), gain=gain)
    rest = DampingTask(weight=0.1)
    levels = {"alone": [tip], "with damping": [[tip, rest]], "before a posture": [tip, posture]}
    assert rested(Ik(model, levels[level], limits), data, 300) < 1e-3
    np.testing.assert_allclose(data.site("payload").xpos, 0.9 * target / distance, atol=1e-4)


def test_what_is_out_of_reach_costs_the_levels_before_and_after_it_nothing():
    """The height first, exactly; the distance as far as it goes; and the roll, which both leave."""
    model, data = three_links(*BENT)
    height = FrameTask("payload", rows=[5], target=[0.0, 0.0, 0.5])
    far = FrameTask("payload", rows=[3], target=[4.0, 0.0, 0.0])
    assert rested(Ik(model, [height, far], Limits(velocity=2.0)), data, 100) < 1e-3
    np.testing.assert_allclose(data.site("payload").xpos, [np.sqrt(0.81 - 0.25), 0, 0.5], atol=1e-6)
    arm = model_of("arm")
    data, wrist = assemble(arm), PostureTask(joints=["joint7"], target=np.full(7, 0.4))
    hand = FrameTask("payload", rows=POSITION, target=[3.0, 0.0, 1.0])
    assert rested(Ik(arm, [hand, wrist], Limits(velocity=2.0)), data, 150) < 1e-3
    assert abs(data.qpos[6] - 0.4) < 1e-6


@pytest.mark.parametrize(
    "name, frame", [("arm", "payload"), ("mobile", "tool"), ("arms", "payload")]
)
def test_near_a_target_that_can_be_reached_nothing_is_damped_to_the_bit(name, frame):
    model, steps = model_of(name), []
    data = bent(model, 3, 0.1)
    for damping in (None, 0.0):
        goal = shifted(pose_of(model, data, frame), 0.004, -0.003, 0.005)
        task = FrameTask(frame, rows=POSITION, target=goal, damping=damping)
        steps.append(Ik(model, [task], Limits(velocity=3.0)).step(data, DT))
    np.testing.assert_array_equal(*steps)


@pytest.mark.parametrize("kind", [FrameTask, CenterOfMassTask, RelativeFrameTask])
def test_a_task_is_judged_where_the_robot_stands_not_at_zero(kind):
    """By numpy from rows apart; at the stretch itself a status; without a motion a refusal."""
    model, data = three_links(*BENT)
    if kind is CenterOfMassTask:
        task = CenterOfMassTask(rows=[0], target=data.subtree_com[0] + 0.01)
    else:
        frames = ["payload", Body("world")][: 1 if kind is FrameTask else 2]
        task = kind(*frames, rows=[3], target=data.site("payload").xpos + 0.01)
    A, _ = rows(model, data, task)
    found = Ik(model, [task], FREELY).step(data, DT)
    np.testing.assert_allclose(found, np.linalg.pinv(A)[:, 0] * 0.01 / DT, rtol=1e-6, atol=1e-9)
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
def test_what_an_ik_has_looked_up_of_a_task_cannot_be_set_any_more(task, name, value):
    """Before it may be, checked; the gain at any time."""
    with pytest.raises((TypeError, ValueError), match=name):
        setattr(task, name, object())
    setattr(task, name, value)
    Ik(model_of("arm"), [task])
    with pytest.raises(AttributeError, match=f"{name} of .* is fixed .* another Ik"):
        setattr(task, name, value)
    task.gain = 0.5


def test_the_same_question_has_the_same_answer_whatever_came_before():
    model, tool, answers = model_of("mobile"), FrameTask("tool"), []
    ik = Ik(model, [tool, PostureTask(target=model.qpos0)], Limits(velocity=1.0))
    for seed, size, way in ((5, 0.1, 0.1), (6, 0.2, -0.2), (5, 0.1, 0.1)):
        data = bent(model, seed, size)
        tool.target = shifted(pose_of(model, data, "tool"), way, 0.1, -way)
        answers.append(ik.step(data, DT))
    np.testing.assert_array_equal(answers[0], answers[2])


@pytest.mark.parametrize("locked", [[], ["joint2"]])
@pytest.mark.parametrize("name, frame", [("arm", "payload"), ("arms", Body("load"))])
def test_a_solution_that_is_kept_says_the_same_after_further_steps(name, frame, locked):
    """Its velocity, from one compiled call, is that of its findings and, to the bit, of a step."""
    model, tool = model_of(name), FrameTask(frame)
    data = bent(model, 4, 0.1)
    ik = Ik(model, [tool, PostureTask(target=data.qpos)], Limits(velocity=2.0))
    ik = ik.with_failures(locked=locked)
    kept, said = [], []
    for _ in range(3):
        tool.target = shifted(pose_of(model, data, frame), 0.01, 0.0, 0.01)
        kept.append(ik.solve(data, DT))
        asked = ik.solve(data, DT)
        rates = asked.kinematics.velocities(asked.solution.rates)[: model.nv]
        np.testing.assert_allclose(asked.qvel, rates, rtol=0, atol=1e-9 * np.abs(rates).max())
        said.append((asked.qvel.copy(), asked.kinematics.J.copy(), asked.residuals, str(asked)))
        np.testing.assert_array_equal(ik.step(data, DT), asked.qvel)
        ik.advance(data, asked.qvel, DT, into=data)
    for solution, (qvel, J, residuals, words) in zip(kept, said, strict=True):
        np.testing.assert_array_equal(solution.qvel, qvel)
        np.testing.assert_array_equal(solution.kinematics.J, J)
        np.testing.assert_equal(solution.residuals, residuals)
        assert str(solution) == words


@pytest.mark.parametrize(
    "tasks, active, words",
    [
        (2 * [FrameTask("payload")], [], "none twice"),
        ([FrameTask("payload")], ["joint1"], "joint1"),
        ([[FrameTask("payload", weight=[1, 2])]], [], r"must be one number or 6, got 2"),
    ],
)
def test_levels_that_are_none_are_refused(tasks, active, words):
    with pytest.raises((ValueError, ModelError), match=words):
        Ik(model_of("arm"), tasks, active=active)


@dataclass(eq=False)
class _Own(TaskFunction):
    """A task of a user's own: one row, of which a function says the error and the Jacobian."""

    says: Any = None
    frames: tuple = ()
    angular: tuple[bool, ...] = (False,)

    def on(self, model: mujoco.MjModel) -> "_Own":
        return self

    def error(self, model, data):
        return self.says(model, data)[0]

    def jacobian(self, model, data):
        return self.says(model, data)[1]


def apart(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[Array, Array]:
    """How far the two hands are from being 0.25 m apart."""
    hands, rows = [data.site(f"{side}_hand") for side in ("left", "right")], np.zeros((2, 3, 35))
    for hand, J in zip(hands, rows, strict=True):
        mujoco.mj_jacSite(model, data, J, None, hand.id)
    way = hands[1].xpos - hands[0].xpos
    length = np.linalg.norm(way)
    return np.array([0.25 - length]), (way / length @ (rows[1] - rows[0]))[None]


def test_a_task_of_a_users_own_is_met_like_any_other():
    model = model_of("humanoid")
    data = bent(model, 4, 0.2)
    ik = Ik(model, [_Own(says=apart), PostureTask(target=data.qpos, gain=0.2)], active=["root"])
    assert abs(apart(model, moved(ik, data, 60))[0]) < 1e-9


ONES = np.ones((1, 7))
MASKED, COMPLEX = (np.ma.masked_array([1.0], [True]), ONES * 1j)


@pytest.mark.parametrize("wrong", [MASKED, COMPLEX, None, "near", [np.nan], [1.0, 2.0], [None]])
@pytest.mark.parametrize("what", ["error", "Jacobian"])
def test_what_a_users_own_task_says_that_is_no_row_of_numbers_is_refused(what, wrong):
    """A list is as good as an array."""
    arm, says = model_of("arm"), (wrong, ONES) if what == "error" else ([0.1], wrong)
    found = Ik(arm, [_Own(says=lambda *_: ([0.7], ONES.tolist()))], FREELY).step(assemble(arm), DT)
    np.testing.assert_allclose(found, 0.7 / DT / 7)
    with pytest.raises(ValueError, match=f"the {what} of _Own.* must (be|hold|have)") as refused:
        Ik(arm, [_Own(says=lambda *_: says)]).step(assemble(arm), DT)
    assert "\n" not in str(refused.value)


def test_where_all_tasks_can_be_met_at_once_both_give_the_same_velocity():
    """Feet, a hand and the centre of mass of a humanoid: nothing conflicts, costs are idle."""
    model = model_of("humanoid")
    data = mujoco.MjData(model)
    targets = {name: pose_of(model, data, name) for name in ("left_foot", "right_foot")}
    targets["right_hand"] = shifted(pose_of(model, data, "right_hand"), 0.02, -0.01, 0.03)
    com = pose_of(model, data, CenterOfMass()).translation_m + 0.004
    center = mink.ComTask(cost=1.0)
    center.set_target(com)
    theirs: list[mink.Task] = [center]
    ours: list[TaskFunction] = [CenterOfMassTask(target=com)]
    for name, target in targets.items():
        task = mink.FrameTask(name, "site", position_cost=1.0, orientation_cost=1.0)
        task.set_target(mink.SE3.from_matrix(target.matrix()))
        theirs.append(task)
        ours.append(FrameTask(name, target=target))
    configuration = mink.Configuration(model, data.qpos)
    v = mink.solve_ik(configuration, theirs, dt=DT, solver="daqp", limits=[], damping=1e-12)
    ik = Ik(model, [ours], Limits(ranges=False), active=["root"])
    np.testing.assert_allclose(ik.step(data, DT), v, atol=2e-3 * np.abs(v).max())
