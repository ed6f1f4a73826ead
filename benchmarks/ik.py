"""One tick of inverse kinematics as its users write it: tasks and limits by `Ik`, and by mink.

A frame goes to a pose near by and the posture is kept; feet stand, and the centre of mass stays
above them, where there are feet. Joints have ranges and a velocity limit. Both solve anew what was
made once; mink's update of the kinematics counts. mink weighs the tasks, `Ik` ranks them, so that
only what the first of them ask for is compared.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import mink
import mujoco
import numpy as np

from benchmarks.contender import Contender, Question
from fjh.ik import Ik, Limits
from sim import (
    MODELS,
    Array,
    CenterOfMass,
    CenterOfMassTask,
    FrameTask,
    Pose,
    PostureTask,
    TaskFunction,
    assemble,
    load_model,
    pose_of,
)

PERIOD_S = 0.01
RATE_LIMIT = 3.0  # of every slide and hinge
TOLERANCE = 0.1  # of what is achieved of the first tasks: the costs of mink are a hundred to one
_WAY_M = 0.002
_AWAY_RAD = 0.05


@dataclass(frozen=True)
class Robot:
    """A model, the frame that goes somewhere, and what stands meanwhile."""

    name: str
    frame: str
    feet: tuple[str, ...] = ()
    balances: bool = False
    active: tuple[str, ...] = ()

    @cached_property
    def model(self) -> mujoco.MjModel:
        """The file of that name."""
        return load_model(MODELS / f"{self.name}.xml")


ROBOTS = (
    Robot("arm", "payload"),
    Robot("mobile", "tool"),
    Robot(
        "quadruped",
        "trunk",
        ("front_left", "front_right", "rear_left", "rear_right"),
        active=("root",),
    ),
    Robot("humanoid", "right_hand", ("left_foot", "right_foot"), balances=True, active=("root",)),
)


@dataclass(frozen=True)
class Case:
    """Positions, where the frame is to go, where feet and centre of mass are, and the posture."""

    qpos: Array
    goal: Pose
    feet: tuple[Pose, ...]
    center: Array
    posture: Array


def random_cases(robot: Robot, count: int, rng: np.random.Generator) -> list[Case]:
    """Postures around that of the model."""
    cases = []
    for _ in range(count):
        data = mujoco.MjData(robot.model)
        step = rng.uniform(-_AWAY_RAD, _AWAY_RAD, size=robot.model.nv)
        step[: 6 if robot.active else 0] = 0.0
        mujoco.mj_integratePos(robot.model, data.qpos, step, 1.0)
        data = assemble(robot.model, data)
        here = pose_of(robot.model, data, robot.frame)
        goal = Pose(here.rotation, here.translation_m + rng.uniform(-_WAY_M, _WAY_M, size=3))
        feet = tuple(pose_of(robot.model, data, foot) for foot in robot.feet)
        center = pose_of(robot.model, data, CenterOfMass()).translation_m
        cases.append(Case(data.qpos.copy(), goal, feet, center, robot.model.qpos0.copy()))
    return cases


def tasks_of(robot: Robot, case: Case) -> list[list[TaskFunction]]:
    """Levels: what stands, the centre of mass, the frame, the posture."""
    rows = range(6) if robot.balances else [3, 4, 5]
    stand: list[TaskFunction] = [
        FrameTask(foot, target=pose, rows=rows)
        for foot, pose in zip(robot.feet, case.feet, strict=True)
    ]
    levels: list[list[TaskFunction]] = [stand] if stand else []
    if robot.balances:
        levels.append([CenterOfMassTask(target=case.center, rows=[0, 1])])
    return [*levels, [FrameTask(robot.frame, target=case.goal)], [PostureTask(target=case.posture)]]


def by_mink(robot: Robot, case: Case) -> tuple[Any, ...]:
    """Configuration, positions, tasks and limits of mink."""
    tasks: list[Any] = [
        _frame(foot, pose, 1.0 if robot.balances else 0.0)
        for foot, pose in zip(robot.feet, case.feet, strict=True)
    ]
    if robot.balances:
        center = mink.ComTask(cost=[1.0, 1.0, 0.0])
        center.set_target(case.center)
        tasks.append(center)
    posture = mink.PostureTask(robot.model, cost=1e-2)
    posture.set_target(case.posture)
    model = robot.model
    joints = [k for k in range(model.njnt) if model.jnt_type[k] != mujoco.mjtJoint.mjJNT_FREE]
    speeds = {model.joint(k).name: RATE_LIMIT for k in joints}
    limits = [mink.ConfigurationLimit(model), mink.VelocityLimit(model, speeds)]
    tasks += [_frame(robot.frame, case.goal, 1.0), posture]
    return mink.Configuration(model, case.qpos), case.qpos, tasks, limits


def _frame(name: str, pose: Pose, turn: float) -> mink.FrameTask:
    task = mink.FrameTask(name, "site", position_cost=1.0, orientation_cost=turn)
    task.set_target(mink.SE3.from_matrix(pose.matrix()))
    return task


def mink_tick(
    configuration: Any, qpos: Array, tasks: Sequence[Any], limits: Sequence[Any]
) -> Array:
    """Kinematics and velocity."""
    configuration.update(qpos)
    return mink.solve_ik(configuration, tasks, PERIOD_S, "daqp", limits=limits)


def ik_tick(ik: Ik, data: mujoco.MjData) -> Array:
    """The same by levels."""
    return ik.step(data, PERIOD_S)


def by_levels(robot: Robot, case: Case) -> tuple[Ik, mujoco.MjData]:
    """What a tick needs."""
    data = mujoco.MjData(robot.model)
    data.qpos[:] = case.qpos
    limits = Limits(velocity=RATE_LIMIT)
    return Ik(robot.model, tasks_of(robot, case), limits, active=robot.active), data


def ik(name: str, rng: np.random.Generator) -> Question:
    """One tick in each way, and how far it is from what all tasks but the posture ask for."""
    robot = next(each for each in ROBOTS if each.name == name)
    cases = random_cases(robot, 8, rng)
    ours = [by_levels(robot, case) for case in cases]
    theirs = [by_mink(robot, case) for case in cases]
    contenders = {
        each.name: each
        for each in (
            Contender(f"ik_{name}", ik_tick, lambda: ours, len(cases)),
            Contender(f"ik_{name}_mink", mink_tick, lambda: theirs, len(cases)),
        )
    }
    apart = dict.fromkeys(contenders, 0.0)
    for case in cases:
        solver, data = by_levels(robot, case)
        found = ik_tick(solver, data), mink_tick(*by_mink(robot, case))
        for key, v in zip(apart, found, strict=True):
            for task in [task for level in tasks_of(robot, case)[:-1] for task in level]:
                located = task.on(robot.model)
                asked = located.error(robot.model, data) / PERIOD_S
                lacking = asked - located.jacobian(robot.model, data) @ v
                size = _WAY_M / PERIOD_S
                apart[key] = max(apart[key], float(np.linalg.norm(lacking)) / size)
    return Question(contenders, apart, TOLERANCE)
