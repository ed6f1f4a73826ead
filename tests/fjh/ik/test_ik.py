"""Inverse kinematics: strict levels of tasks, whatever fails, on arms, loops and legs."""

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
import pytest
from scipy.linalg import null_space

from fjh.ik import Ik, Limits
from prioritized import Status
from sim import (
    MODELS,
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
    Pose,
    PostureTask,
    RelativeFrameTask,
    TaskFunction,
    assemble,
    jacobians,
    load_model,
    pose_of,
)

DT = 0.01
ARM = load_model(MODELS / "arm.xml")
ARMS = load_model(MODELS / "arms.xml")
HUMANOID = load_model(MODELS / "humanoid.xml")
QUADRUPED = load_model(MODELS / "quadruped.xml")
MOBILE = load_model(MODELS / "mobile.xml")
FEET = "left_foot", "right_foot"
LEGS = "front_left", "front_right", "rear_left", "rear_right"
FREELY = Limits(ranges=False)
WRONG: Any = "payload"


def bent(model: mujoco.MjModel, seed: int, size: float = 0.3) -> mujoco.MjData:
    """A random state near that of the model, loops closed."""
    data, rng = mujoco.MjData(model), np.random.default_rng(seed)
    mujoco.mj_integratePos(model, data.qpos, rng.normal(scale=size, size=model.nv), 1.0)
    return assemble(model, data)


def shifted(pose: Pose, *way: float) -> Pose:
    return Pose(pose.rotation, pose.translation_m + way)


def rows(model: mujoco.MjModel, data: mujoco.MjData, task) -> tuple[Array, Array]:
    """Jacobian and velocity that a task asks for, apart from any solver."""
    located = task.on(model)
    return located.jacobian(model, data), task.gain / DT * located.error(model, data)


def by_null_spaces(levels: list[tuple[Array, Array]], n: int) -> Array:
    """The textbook's recursion of null spaces, rank by numpy."""
    v, free = np.zeros(n), np.eye(n)
    for A, b in levels:
        v = v + free @ np.linalg.pinv(A @ free, rcond=1e-9) @ (b - A @ v)
        free = free @ null_space(A @ free, rcond=1e-9)
    return v


@pytest.mark.parametrize("seed", range(8))
def test_strict_levels_are_those_of_the_recursion_of_null_spaces(seed):
    """Without limits and damping, of tasks of all kinds in any order."""
    rng, data = np.random.default_rng(seed), bent(HUMANOID, seed)
    here = pose_of(HUMANOID, data, "right_hand")
    tasks = [
        FrameTask("right_hand", rows=[3, 4, 5], target=here.translation_m + rng.normal(size=3)),
        LookAtTask("left_hand", [0, 0, 1], target=[3.0, 1.0, 0.5]),
        JointCouplingTask({"left_knee": 1.0, "right_knee": 0.5}, target=0.2),
        CenterOfMassTask(rows=[0, 1], target=rng.normal(size=3)),
        RelativeFrameTask("right_foot", "left_foot", target=here),
    ]
    for task in tasks:  # targets may be far away
        task.damping = 0.0
    order = [tasks[k] for k in rng.permutation(len(tasks))]
    posture = PostureTask(target=HUMANOID.qpos0, gain=0.3)
    levels = [rows(HUMANOID, data, task) for task in order]
    joints = np.eye(35)[6:]
    levels.append((joints, rows(HUMANOID, data, posture)[1]))
    expected = by_null_spaces(levels, 35)
    found = Ik(HUMANOID, [*order, posture], FREELY, active=["root"]).step(data, DT)
    np.testing.assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max())


def test_a_level_of_several_tasks_weighs_them():
    """Two positions that one hinge cannot reach both: the weighted mean."""
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><worldbody><body><joint name="x" type="slide" axis="1 0 0"/>
        <geom size="0.1"/><site name="a"/><site name="b" pos="1 0 0"/></body></worldbody>
        <actuator><motor joint="x"/></actuator></mujoco>"""
    )
    data = mujoco.MjData(model)
    to_left = FrameTask("a", rows=[3], target=[-1.0, 0, 0], weight=1.0)
    to_right = FrameTask("b", rows=[3], target=[3.0, 0, 0], weight=2.0)
    (found,) = Ik(model, [[to_left, to_right]], FREELY).step(data, DT)
    np.testing.assert_allclose(found * DT, (1 * -1.0 + 4 * 2.0) / 5)


@pytest.mark.parametrize("joint", [f"joint{k}" for k in range(1, 8)])
def test_a_locked_joint_rests_and_the_tool_goes_on(joint):
    data = bent(ARM, 1)
    here = pose_of(ARM, data, "payload").translation_m
    tool = FrameTask("payload", rows=[3, 4, 5], target=np.add(here, [0.01, -0.02, 0.01]))
    ik = Ik(ARM, [tool, PostureTask(target=ARM.qpos0)], FREELY).with_failures(locked=[joint])
    for _ in range(12):
        qvel = ik.step(data, DT)
        assert qvel[ARM.joint(joint).dofadr[0]] == 0.0
        data = ik.advance(data, qvel, DT)
    assert np.abs(tool.on(ARM).error(ARM, data)).max() < 1e-9


def test_failures_compose_and_leave_the_sound_one_alone():
    data, tool = bent(ARM, 1), FrameTask("payload", target=np.zeros(3))
    sound = Ik(ARM, [tool], FREELY)
    before = sound.step(data, DT)
    both = sound.with_failures(locked=["joint1"]).with_failures(locked=["joint4"])
    assert not both.step(data, DT)[[0, 3]].any()
    np.testing.assert_array_equal(sound.step(data, DT), before)
    with pytest.raises(ValueError, match="nearest is 'joint7'"):
        sound.with_failures(locked=["joint77"])


def test_a_limp_joint_that_moves_the_task_is_reported():
    tool = FrameTask("payload", target=np.zeros(3))
    failed = Ik(ARM, [tool], FREELY).with_failures(free=["joint2"])
    assert failed.solve(bent(ARM, 1), DT).status is Status.SELF_MOTION


@pytest.mark.parametrize("joint", ["joint2", "joint5", "joint9"])
def test_two_arms_carry_their_load_and_keep_hold_of_it_when_a_joint_locks(joint):
    """Six motions of twelve joints in a loop; of five, its position and two rotations."""
    data = assemble(ARMS)
    start, load = pose_of(ARMS, data, Body("load")), Body("load")
    place = FrameTask(load, rows=[3, 4, 5])
    ik = Ik(ARMS, [place, FrameTask(load, rows=[0, 1, 2], target=start)], FREELY)
    ik = ik.with_failures(locked=[joint])
    for k in range(40):
        place.target = start.translation_m + 0.001 * k * np.array([0.5, 0.0, 1.0])
        qvel = ik.step(data, DT)
        data = ik.advance(data, qvel, DT)
        assert np.abs(data.efc_pos[: data.ne]).max() < 1e-9
    assert np.abs(place.on(ARMS).error(ARMS, data)).max() < 1e-4


def walking(data: mujoco.MjData) -> tuple[list[FrameTask], FrameTask, FrameTask]:
    """Three feet that stand, one that steps, and the trunk."""
    first, *others = (pose_of(QUADRUPED, data, leg).translation_m for leg in LEGS)
    standing = [
        FrameTask(leg, rows=[3, 4, 5], target=p) for leg, p in zip(LEGS[1:], others, strict=True)
    ]
    step = FrameTask(LEGS[0], rows=[3, 4, 5], target=np.add(first, [0.04, 0.0, 0.05]))
    trunk = pose_of(QUADRUPED, data, "trunk")
    return standing, step, FrameTask("trunk", target=shifted(trunk, 0.01, 0.01, -0.01))


def test_a_quadruped_steps_with_its_trunk_as_a_variable():
    data = assemble(QUADRUPED)
    standing, step, trunk = walking(data)
    ik = Ik(QUADRUPED, [standing, step, trunk, PostureTask(target=data.qpos)], active=["root"])
    for _ in range(40):
        data = ik.advance(data, ik.step(data, DT), DT)
    for task in (*standing, step, trunk):
        assert np.abs(task.on(QUADRUPED).error(QUADRUPED, data)).max() < 1e-9


def test_with_a_hip_locked_the_feet_come_first_and_the_trunk_takes_what_is_left():
    data = assemble(QUADRUPED)
    standing, step, trunk = walking(data)
    ik = Ik(QUADRUPED, [standing, step, trunk], active=["root"])
    ik = ik.with_failures(locked=["rear_left_hip"])
    for _ in range(60):
        data = ik.advance(data, ik.step(data, DT), DT)
    error = {t: np.abs(t.on(QUADRUPED).error(QUADRUPED, data)).max() for t in [*standing, step]}
    assert max(error.values()) < 1e-6
    assert 1e-4 < np.abs(trunk.on(QUADRUPED).error(QUADRUPED, data)).max() < 0.05


def test_without_actuators_all_joints_are_variables_where_the_user_says_so():
    bare = mujoco.MjSpec.from_file(str(MODELS / "quadruped.xml"))
    for actuator in list(bare.actuators):
        bare.delete(actuator)
    model, data = bare.compile(), assemble(QUADRUPED)
    standing, step, trunk = walking(data)
    other = mujoco.MjData(model)
    tasks = [standing, step, trunk]
    found = Ik(model, tasks, active=True).step(other, DT)
    expected = Ik(QUADRUPED, tasks, active=["root"]).step(data, DT)
    np.testing.assert_allclose(found, expected, atol=1e-12)
    with pytest.raises(ModelError, match="no enabled actuator"):
        Ik(model, tasks)


def test_a_task_that_nothing_moves_is_refused_and_one_that_a_variable_moves_is_not():
    trunk = FrameTask("trunk", target=np.ones(3))
    with pytest.raises(ModelError, match=r"no actuator moves .* variables in active="):
        Ik(QUADRUPED, [trunk])
    assert Ik(QUADRUPED, [trunk], active=["root"]).step(assemble(QUADRUPED), DT).any()


@pytest.mark.parametrize("stands_by", ["tasks", "pins"])
def test_a_humanoid_follows_with_its_hand_and_both_feet_stay(stands_by):
    data = assemble(HUMANOID)
    feet = [FrameTask(foot, target=pose_of(HUMANOID, data, foot)) for foot in FEET]
    com = CenterOfMassTask(
        rows=[0, 1], target=pose_of(HUMANOID, data, CenterOfMass()).translation_m
    )
    hand = FrameTask("right_hand", rows=[3, 4, 5])
    start, posture = pose_of(HUMANOID, data, "right_hand"), PostureTask(target=data.qpos, gain=0.1)
    if stands_by == "tasks":
        ik = Ik(HUMANOID, [feet, com, hand, posture], active=["root"])
    else:
        pins = [Pin(foot, weld=True) for foot in FEET]
        ik = Ik(HUMANOID, [com, hand, posture], pinned=pins)
    stood = [pose_of(HUMANOID, data, foot) for foot in FEET]
    for k in range(1, 41):
        hand.target = start.translation_m + 0.005 * min(k, 30) * np.array([1.0, 0.3, 0.6])
        data = ik.advance(data, ik.step(data, 0.02), 0.02)
    for foot, before in zip(FEET, stood, strict=True):
        now = pose_of(HUMANOID, data, foot)
        assert np.abs(now.translation_m - before.translation_m).max() < 1e-7
        assert np.abs(now.rotation - before.rotation).max() < 1e-7
    assert np.abs(hand.on(HUMANOID).error(HUMANOID, data)).max() < 1e-5
    assert np.abs(com.on(HUMANOID).error(HUMANOID, data)).max() < 1e-5


def test_a_standing_humanoid_whose_knee_locks_goes_on_with_its_hand():
    data = assemble(HUMANOID)
    hand = FrameTask("right_hand", rows=[3, 4, 5])
    here = pose_of(HUMANOID, data, "right_hand").translation_m
    hand.target = np.add(here, [0.05, 0.02, 0.05])
    pins = [Pin(foot, weld=True) for foot in FEET]
    ik = Ik(HUMANOID, [hand, PostureTask(target=data.qpos, gain=0.1)], pinned=pins)
    ik = ik.with_failures(locked=["left_knee"])
    for _ in range(20):
        data = ik.advance(data, ik.step(data, DT), DT)
    assert np.abs(hand.on(HUMANOID).error(HUMANOID, data)).max() < 1e-8
    assert abs(data.joint("left_knee").qpos[0]) < 1e-12


def test_at_the_target_nothing_moves():
    for model, active, frame in (
        (ARM, (), "payload"),
        (HUMANOID, ["root"], "left_hand"),
        (MOBILE, (), "tool"),
    ):
        data = bent(model, 2, 0.1)
        task = FrameTask(frame, target=pose_of(model, data, frame))
        qvel = Ik(model, [task, PostureTask(target=data.qpos)], active=active).step(data, DT)
        assert np.abs(qvel).max() < 1e-9


def test_half_a_gain_goes_half_the_way():
    data = bent(MOBILE, 3, 0.1)
    target = shifted(pose_of(MOBILE, data, "tool"), 0.01, 0.0, 0.0)
    whole, half = (
        Ik(MOBILE, [FrameTask("tool", target=target, gain=gain)], FREELY).step(data, DT)
        for gain in (1.0, 0.5)
    )
    np.testing.assert_allclose(half, whole / 2, atol=1e-12)


def test_damping_as_the_last_level_takes_the_least_motion():
    data = bent(MOBILE, 3, 0.1)
    tool = FrameTask(
        "tool", rows=[3, 4, 5], target=pose_of(MOBILE, data, "tool").translation_m + 0.1
    )
    weight = np.arange(1.0, 10.0)
    found = Ik(MOBILE, [tool, DampingTask(weight=weight)], FREELY).step(data, DT)
    A, b = rows(MOBILE, data, tool)
    np.testing.assert_allclose(found, np.linalg.pinv(A / weight) @ b / weight, atol=1e-9)


@pytest.mark.parametrize("bend", [1e-1, 1e-2, 1e-4, 1e-7])
def test_near_a_singular_pose_damping_bounds_the_rates_and_says_what_it_costs(bend):
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><worldbody><body><joint name="s" axis="0 0 1"/><geom size="0.03"/>
        <body pos="0.3 0 0"><joint name="e" axis="0 0 1"/><geom size="0.03"/>
        <site name="tip" pos="0.3 0 0"/></body></body></worldbody>
        <actuator><motor joint="s"/><motor joint="e"/></actuator></mujoco>"""
    )
    data = mujoco.MjData(model)
    data.qpos[:] = -bend / 2, bend
    mujoco.mj_kinematics(model, data)
    target = data.site("tip").xpos - [1e-3, 0.0, 0.0]
    tip = FrameTask("tip", rows=[3, 4], target=target, weight=1.0, damping=0.02)
    answer = Ik(model, [tip], FREELY).solve(data, DT)
    A, b = rows(model, data, tip)
    expected = A.T @ np.linalg.solve(A @ A.T + 0.02**2 * np.eye(2), b)
    np.testing.assert_allclose(answer.qvel, expected, rtol=1e-6, atol=1e-9)
    assert np.abs(answer.qvel).max() <= np.linalg.norm(b) / (2 * 0.02)
    lost = np.linalg.norm(A @ expected - b)
    assert abs(answer.solution.damping_errors[0] - lost) < 1e-9
    assert answer.status is Status.DAMPED and f"level 1 {lost:.2g}" in str(answer)


@pytest.mark.long
def test_before_a_target_out_of_reach_a_hand_comes_to_rest_unless_its_damping_is_none_at_all():
    """Without damping the arm, at its stretch, swings at the limit of its joints."""
    speeds = {}
    for damping in (None, 0.0):
        data, hand = assemble(HUMANOID), FrameTask("right_hand", rows=[3, 4, 5], weight=1.0)
        hand.gain = 0.3
        hand.target = np.add(pose_of(HUMANOID, data, "right_hand").translation_m, [0.6, 0.0, 0.3])
        hand.damping = damping
        pins = [Pin(foot, weld=True) for foot in FEET]
        com = CenterOfMassTask(rows=[0, 1], target=data.subtree_com[0])
        ik = Ik(HUMANOID, [com, hand], Limits(velocity=3.0), pinned=pins)
        for _ in range(150):
            data = ik.advance(data, ik.step(data, 0.02), 0.02)
        speeds[damping] = np.abs(data.qvel).max()
    assert speeds[None] < 0.3 < 1.0 < speeds[0.0]


def three_links(*, bent: bool = True) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """A planar arm with a reach of 0.9 m, stretched along x where its joints are at zero."""
    link = """<body pos="{} 0 0"><joint name="{}" axis="0 1 0"/>
        <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.02"/>"""
    links = "".join(map(link.format, (0, 0.3, 0.3), "abc"))
    motors = "".join(f'<position joint="{joint}"/>' for joint in "abc")
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><worldbody>{links}<site name="tip" pos="0.3 0 0"/></body></body></body>
        </worldbody><actuator>{motors}</actuator></mujoco>"""
    )
    data = mujoco.MjData(model)
    data.qpos[:] = (-0.3, 0.6, -0.3) if bent else 0.0
    mujoco.mj_forward(model, data)
    return model, data


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
    model, data = three_links()
    target = distance * np.array([0.6, 0.0, -0.8])
    tip = FrameTask("tip", rows=[3, 5], target=target, gain=gain)
    posture = PostureTask(target=data.qpos.copy(), gain=gain)
    rest = DampingTask(weight=0.1)
    levels = {"alone": [tip], "with damping": [[tip, rest]], "before a posture": [tip, posture]}
    assert rested(Ik(model, levels[level], limits), data, 300) < 1e-3
    np.testing.assert_allclose(data.site("tip").xpos, 0.9 * target / distance, atol=1e-4)


def test_what_is_out_of_reach_costs_the_levels_before_and_after_it_nothing():
    """The height first, exactly; the distance as far as it goes; and the roll, which both leave."""
    model, data = three_links()
    height = FrameTask("tip", rows=[5], target=[0.0, 0.0, 0.5])
    far = FrameTask("tip", rows=[3], target=[4.0, 0.0, 0.0])
    assert rested(Ik(model, [height, far], Limits(velocity=2.0)), data, 100) < 1e-3
    np.testing.assert_allclose(data.site("tip").xpos, [np.sqrt(0.81 - 0.25), 0, 0.5], atol=1e-6)
    data, wrist = assemble(ARM), PostureTask(joints=["joint7"], target=np.full(7, 0.4))
    hand = FrameTask("payload", rows=[3, 4, 5], target=[3.0, 0.0, 1.0])
    assert rested(Ik(ARM, [hand, wrist], Limits(velocity=2.0)), data, 150) < 1e-3
    assert abs(data.qpos[6] - 0.4) < 1e-6


@pytest.mark.parametrize("model, frame", [(ARM, "payload"), (MOBILE, "tool"), (ARMS, "payload")])
def test_near_a_target_that_can_be_reached_nothing_is_damped_to_the_bit(model, frame):
    data, steps = bent(model, 3, 0.1), []
    for damping in (None, 0.0):
        goal = shifted(pose_of(model, data, frame), 0.004, -0.003, 0.005)
        task = FrameTask(frame, rows=[3, 4, 5], target=goal, damping=damping)
        steps.append(Ik(model, [task], Limits(velocity=3.0)).step(data, DT))
    np.testing.assert_array_equal(*steps)


@pytest.mark.parametrize(
    "make, way",
    [
        (lambda data: FrameTask("tip", rows=[3], target=data.site("tip").xpos + 0.01), 0.01),
        (lambda data: CenterOfMassTask(rows=[0], target=data.subtree_com[0] + 0.01), 0.01),
        (
            lambda data: RelativeFrameTask(
                "tip", Body("world"), rows=[3], target=data.site("tip").xpos + 0.01
            ),
            0.01,
        ),
    ],
)
def test_a_task_whose_rows_vanish_where_all_joints_are_zero_is_judged_where_the_robot_stands(
    make, way
):
    """By numpy from rows apart; at the stretch itself a status; without a motion a refusal."""
    model, data = three_links()
    task = make(data)
    A, _ = rows(model, data, task)
    found = Ik(model, [task], FREELY).step(data, DT)
    np.testing.assert_allclose(found, np.linalg.pinv(A)[:, 0] * way / DT, rtol=1e-6, atol=1e-9)
    stretched = three_links(bent=False)[1]
    assert Ik(model, [task], FREELY).solve(stretched, DT).status is Status.LEAST_SQUARES
    assert not jacobians(model, stretched, task).J_T.any()
    with pytest.raises(ModelError, match="no actuator moves"):
        Ik(model, [FrameTask("tip", rows=[4], target=np.zeros(3))])


@pytest.mark.parametrize(
    "task, name, value",
    [
        (FrameTask("payload"), "weight", 2.0),
        (FrameTask("payload"), "damping", 0.1),
        (FrameTask("payload"), "rows", [3]),
        (FrameTask("payload"), "frame", Body("link3")),
        (FrameTask("payload"), "axes", "base"),
        (RelativeFrameTask("payload", "base"), "root", Body("link3")),
        (CenterOfMassTask(), "body", "link3"),
        (PostureTask(), "joints", ["joint1"]),
        (DampingTask(), "joints", ["joint1"]),
        (LookAtTask("payload", [0, 0, 1]), "axis", [1, 0, 0]),
        (JointCouplingTask({"joint1": 1.0}), "coefficients", {"joint2": 1.0}),
    ],
)
def test_what_an_ik_has_looked_up_of_a_task_cannot_be_set_any_more(task, name, value):
    """Before it may be, checked; the gain at any time."""
    with pytest.raises((TypeError, ValueError), match=name):
        setattr(task, name, WRONG if name in ("weight", "damping", "coefficients") else 3.5)
    setattr(task, name, value)
    Ik(ARM, [task])
    with pytest.raises(AttributeError, match=f"{name} of .* is fixed .* another Ik"):
        setattr(task, name, value)
    task.gain = 0.5


def test_the_same_question_has_the_same_answer_to_the_bit_whatever_came_before():
    tool, data = FrameTask("tool"), bent(MOBILE, 5, 0.1)
    ik = Ik(MOBILE, [tool, PostureTask(target=MOBILE.qpos0)], Limits(velocity=1.0))
    tool.target = shifted(pose_of(MOBILE, data, "tool"), 0.1, 0.1, -0.1)
    first = ik.step(data, DT)
    other = bent(MOBILE, 6, 0.2)
    tool.target = shifted(pose_of(MOBILE, other, "tool"), -0.1, 0.0, 0.2)
    ik.step(other, DT)
    tool.target = shifted(pose_of(MOBILE, data, "tool"), 0.1, 0.1, -0.1)
    np.testing.assert_array_equal(ik.step(data, DT), first)


@pytest.mark.parametrize("size", [0.001, 0.01, 0.3])
@pytest.mark.parametrize("model, frame", [(ARM, "payload"), (MOBILE, "tool"), (ARMS, Body("load"))])
def test_what_a_solution_says_of_itself_is_of_its_velocity(model, frame, size):
    """Found apart: the velocity in one compiled call, its findings when they are asked for."""
    data = bent(model, 4, 0.1)
    tool = FrameTask(frame, target=shifted(pose_of(model, data, frame), size, size, -size))
    ik = Ik(model, [tool, PostureTask(target=data.qpos)], Limits(velocity=2.0))
    for each in (ik, ik.with_failures(locked=["joint2"] if model is not MOBILE else ["shoulder"])):
        answer = each.solve(data, DT)
        data.qpos[:] += 0.1
        expected = answer.kinematics.velocities(answer.solution.rates)[: model.nv]
        data.qpos[:] -= 0.1
        close = 1e-9 * np.abs(expected).max()
        np.testing.assert_allclose(answer.qvel, expected, rtol=0, atol=close)


@pytest.mark.parametrize("model, frame", [(ARM, "payload"), (ARMS, Body("load"))])
def test_a_solution_that_is_kept_says_the_same_after_further_steps(model, frame):
    """Whether it was asked before or not; and its velocity is that of a step, to the bit."""
    data, tool = bent(model, 4, 0.1), FrameTask(frame)
    ik = Ik(model, [tool, PostureTask(target=data.qpos)], Limits(velocity=2.0))
    kept, said = [], []
    for _ in range(3):
        tool.target = shifted(pose_of(model, data, frame), 0.01, 0.0, 0.01)
        kept.append(ik.solve(data, DT))
        asked = ik.solve(data, DT)
        said.append((asked.qvel.copy(), asked.kinematics.J.copy(), asked.residuals, str(asked)))
        np.testing.assert_array_equal(ik.step(data, DT), asked.qvel)
        ik.advance(data, asked.qvel, DT, into=data)
    for solution, (qvel, J, residuals, words) in zip(kept, said, strict=True):
        np.testing.assert_array_equal(solution.qvel, qvel)
        np.testing.assert_array_equal(solution.kinematics.J, J)
        np.testing.assert_equal(solution.residuals, residuals)
        assert str(solution) == words


def test_time_and_velocity_of_the_state_after_say_how_it_got_there():
    data, tool = bent(MOBILE, 5, 0.1), FrameTask("tool", target=np.ones(3))
    ik = Ik(MOBILE, [tool], Limits(velocity=1.0))
    qvel = ik.step(data, DT)
    there = ik.advance(data, qvel, DT)
    np.testing.assert_array_equal(there.qvel, qvel)
    assert there.time == data.time + DT


def test_a_state_in_which_the_loop_goes_on_is_the_same_as_one_after_another():
    """With and without feet that are pinned, and a joint that is stuck."""
    feet = {"pinned": ["rear_left", "front_right", "rear_right"], "active": ["root"]}
    for model, frame, given in ((ARM, "payload", {}), (QUADRUPED, "front_left", feet)):
        here = assemble(model, bent(model, 3, 0.1))
        goal = shifted(pose_of(model, here, frame), 0.01, 0.0, 0.01).translation_m
        ik = Ik(model, [FrameTask(frame, rows=[3, 4, 5], target=goal)], FREELY, **given)
        ik, new = ik.with_failures(locked=[0]), here
        for _ in range(4):
            new = ik.advance(new, ik.step(new, DT), DT)
            assert ik.advance(here, ik.step(here, DT), DT, into=here) is here
        np.testing.assert_array_equal(here.qpos, new.qpos)
        assert here.time == new.time


@pytest.mark.parametrize(
    "call, error, words",
    [
        (lambda: Ik(None, []), TypeError, "model must be a MjModel"),
        (lambda: Ik(ARM, []), ValueError, "tasks must be a list of tasks"),
        (lambda: Ik(ARM, WRONG), ValueError, "tasks must be a list of tasks"),
        (lambda: Ik(ARM, [WRONG]), TypeError, r"tasks\[0\] must be a list of TaskFunction"),
        (lambda: Ik(ARM, [[]]), ValueError, "one at least in each level"),
        (lambda: Ik(ARM, [FrameTask("payloads")]), ModelError, 'did you mean "payload"'),
        (lambda: Ik(ARM, [FrameTask("payload")], WRONG), TypeError, "limits must be a Limits"),
        (lambda: Ik(ARM, [FrameTask("payload")], active=["joint1"]), ModelError, "joint1"),
        (
            lambda: Ik(ARM, [FrameTask("payload")]).step(assemble(ARM), DT),
            ValueError,
            "must be set",
        ),
        (
            lambda: Ik(ARM, [PostureTask(target=ARM.qpos0)]).step(assemble(ARM), 0.0),
            ValueError,
            "dt",
        ),
        (
            lambda: Ik(ARM, [PostureTask(target=ARM.qpos0)]).step(assemble(ARMS), DT),
            ValueError,
            "data",
        ),
        (
            lambda: Ik(ARM, [[FrameTask("payload", weight=[1, 2]), PostureTask()]]),
            ValueError,
            r"weight of FrameTask\(.* must be one number or 6, got 2",
        ),
        (
            lambda: Ik(ARM, [PostureTask(weight=[1, 2])]),
            ValueError,
            r"weight of PostureTask\(.* must be one number or 7, got 2",
        ),
        (
            lambda: Ik(ARM, [PostureTask()]).advance(assemble(ARM), np.zeros(7), -1.0),
            ValueError,
            "^dt must be positive",
        ),
        (
            lambda: Ik(ARM, [PostureTask()]).advance(assemble(ARM), np.full(7, 1e99), 1e99),
            ValueError,
            "^qvel times dt must be smaller",
        ),
        (
            lambda: FrameTask("payload", target=np.eye(3)),
            ValueError,
            r"target must be a position .* got shape \(3, 3\): a rotation R alone is Pose",
        ),
        (
            lambda: Ik(QUADRUPED, [FrameTask("trunk")], active=[QUADRUPED.njnt]),
            ValueError,
            "active must have numbers of joints below",
        ),
        (lambda: Limits(velocity=-1.0), ValueError, "velocity must be positive"),
        (lambda: Limits(velocity={"joint1": np.nan}), ValueError, "velocity"),
        (lambda: Limits(ranges=WRONG), TypeError, "ranges must be True or False"),
        (
            lambda: Ik(ARM, [FrameTask("payload")], Limits(velocity={"joint11": 1.0})),
            ValueError,
            'did you mean "joint1"',
        ),
    ],
)
def test_a_wrong_argument_is_refused_in_one_sentence(call, error, words):
    with pytest.raises(error, match=words) as refused:
        call()
    assert "\n" not in str(refused.value)


def test_a_velocity_of_another_length_leaves_the_state_as_it_was():
    data = bent(ARM, 1)
    before = data.qpos.copy()
    with pytest.raises(ValueError, match=r"qvel must have shape \(7,\), got \(8,\)"):
        Ik(ARM, [PostureTask()]).advance(data, np.ones(8), DT, into=data)
    np.testing.assert_array_equal(data.qpos, before)
    assert not data.time


def test_numbers_in_active_are_those_of_joints():
    tasks, data = [FrameTask("trunk", target=np.ones(3))], assemble(QUADRUPED)
    by_name, by_number = (
        Ik(QUADRUPED, tasks, active=[root]).step(data, DT)
        for root in ("root", QUADRUPED.joint("root").id)
    )
    np.testing.assert_array_equal(by_name, by_number)


def test_one_task_twice_is_refused():
    task = FrameTask("payload", target=np.zeros(3))
    with pytest.raises(ValueError, match="none twice"):
        Ik(ARM, [task, task])


@dataclass(eq=False)
class Apart(TaskFunction):
    """The distance between two sites is to have a length: a task of a user's own."""

    ends: tuple[str, str] = ("", "")
    rows: int = 1

    def on(self, model: mujoco.MjModel) -> "ApartIn":
        """As :meth:`TaskFunction.on`."""
        first, second = (model.site(end).id for end in self.ends)
        return ApartIn(self, first, second)


@dataclass
class ApartIn:
    """The same in one model."""

    task: Apart
    first: int
    second: int
    frames: tuple = ()
    angular: tuple[bool, ...] = (False,)

    def jacobian(self, model, data):
        """Rate of the distance."""
        rows = np.zeros((2, 3, model.nv))
        for J, site in zip(rows, (self.first, self.second), strict=True):
            mujoco.mj_jacSite(model, data, J, None, site)
        way = data.site_xpos[self.second] - data.site_xpos[self.first]
        return np.tile(way / np.linalg.norm(way) @ (rows[1] - rows[0]), (self.task.rows, 1))

    def error(self, model, data):
        """What it lacks."""
        way = data.site_xpos[self.second] - data.site_xpos[self.first]
        return np.array([self.task.needed() - np.linalg.norm(way)])


def test_a_task_of_a_users_own_is_met_like_any_other():
    data = bent(HUMANOID, 4, 0.2)
    apart = Apart(ends=("left_hand", "right_hand"), target=0.25)
    ik = Ik(HUMANOID, [apart, PostureTask(target=data.qpos, gain=0.2)], active=["root"])
    for _ in range(60):
        data = ik.advance(data, ik.step(data, DT), DT)
    way = data.site("left_hand").xpos - data.site("right_hand").xpos
    assert abs(np.linalg.norm(way) - 0.25) < 1e-9


@dataclass(eq=False)
class Said(TaskFunction):
    """Of an arm, whatever error and Jacobian it is given."""

    says: Any = None
    frames: tuple = ()
    angular: tuple[bool, ...] = (False,)

    def on(self, model: mujoco.MjModel) -> "Said":
        """As :meth:`TaskFunction.on`."""
        return self

    def error(self, model, data):
        """As it is given."""
        return self.says[0]

    def jacobian(self, model, data):
        """As it is given."""
        return self.says[1]


ONES = np.ones((1, 7))
MASKED, COMPLEX = (np.ma.masked_array([1.0], [True]), ONES * 1j)


def test_a_list_is_as_good_as_an_array_from_a_task_of_a_users_own():
    found = Ik(ARM, [Said(says=([0.7], ONES.tolist()))], FREELY).step(assemble(ARM), DT)
    np.testing.assert_allclose(found, 0.7 / DT / 7)


@pytest.mark.parametrize("wrong", [MASKED, COMPLEX, None, "near", [np.nan], [1.0, 2.0], [None]])
@pytest.mark.parametrize("what", ["error", "Jacobian"])
def test_what_a_users_own_task_says_that_is_no_row_of_numbers_is_refused(what, wrong):
    says = (wrong, ONES) if what == "error" else ([0.1], wrong)
    with pytest.raises(ValueError, match=f"the {what} of Said.* must (be|hold|have)") as refused:
        Ik(ARM, [Said(says=says)]).step(assemble(ARM), DT)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("wrong", [{"rows": 2}, {"target": np.nan}, {"target": "near"}])
def test_a_task_of_a_users_own_that_is_wrong_is_refused(wrong):
    given = {"ends": ("left_hand", "right_hand"), "target": 0.25} | wrong
    with pytest.raises((ValueError, TypeError)) as refused:
        Ik(HUMANOID, [Apart(**given)], active=["root"]).step(assemble(HUMANOID), DT)
    assert "\n" not in str(refused.value)
