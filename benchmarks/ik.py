"""Time one tick of inverse kinematics with tasks and limits, by `Ik` and by mink.

A frame moves to a nearby pose while the posture is kept; a walking robot also keeps its feet in
place and its centre of mass above them. Joints have ranges and a velocity limit. Tasks and limits
are made outside the timed part; mink's update of the kinematics is timed. mink weights the tasks
and `Ik` ranks them, so that the motion of the last task, the posture, is not compared.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import mink
import mujoco
import numpy as np

from benchmarks.candidate import Candidate, check_agreement
from fjh import Ik, Limits
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
RATE_LIMIT = 3.0  # of every slide joint [m]/[s] and hinge [rad]/[s]
TOLERANCE = 0.1  # relative, for all tasks but the posture: mink weights them 100 to 1
_MOVE_M = 0.002
_SPREAD_RAD = 0.05


@dataclass(frozen=True)
class Robot:
    """Bundled model, with the frame that moves, its feet, and whether it keeps its balance."""

    name: str
    frame: str
    feet: tuple[str, ...] = ()
    balances: bool = False

    @cached_property
    def model(self) -> mujoco.MjModel:
        """Model loaded from the bundled file of this name."""
        return load_model(MODELS / f"{self.name}.xml")

    @property
    def active(self) -> tuple[str, ...]:
        """Unactuated joints that the solver may move: the base of a walking robot."""
        return ("root",) if self.feet else ()


ROBOTS = {
    robot.name: robot
    for robot in (
        Robot("arm", "payload"),
        Robot("mobile", "tool"),
        Robot("quadruped", "trunk", ("front_left", "front_right", "rear_left", "rear_right")),
        Robot("humanoid", "right_hand", ("left_foot", "right_foot"), balances=True),
    )
}


@dataclass(frozen=True)
class Case:
    """State of a robot, and targets of its frame, feet and centre of mass [m]."""

    data: mujoco.MjData
    goal: Pose
    feet: dict[str, Pose]
    center: Array


def random_case(robot: Robot, rng: np.random.Generator) -> Case:
    """Sample a state near the model's posture, and a nearby target of the frame."""
    model, data = robot.model, mujoco.MjData(robot.model)
    step = rng.uniform(-_SPREAD_RAD, _SPREAD_RAD, size=model.nv)
    step[: 6 if robot.active else 0] = 0.0
    mujoco.mj_integratePos(model, data.qpos, step, 1.0)
    data = assemble(model, data)
    start = pose_of(model, data, robot.frame)
    goal = Pose(start.rotation, start.translation_m + rng.uniform(-_MOVE_M, _MOVE_M, size=3))
    feet = {foot: pose_of(model, data, foot) for foot in robot.feet}
    return Case(data, goal, feet, pose_of(model, data, CenterOfMass()).translation_m)


def tasks_of(robot: Robot, case: Case) -> list[list[TaskFunction]]:
    """Return the task levels: feet, centre of mass, frame, posture."""
    rows = range(6) if robot.balances else [3, 4, 5]
    levels: list[list[TaskFunction]] = [
        [FrameTask(robot.frame, target=case.goal)],
        [PostureTask(target=robot.model.qpos0)],
    ]
    if robot.balances:
        levels.insert(0, [CenterOfMassTask(target=case.center, rows=[0, 1])])
    if robot.feet:
        levels.insert(
            0, [FrameTask(foot, target=pose, rows=rows) for foot, pose in case.feet.items()]
        )
    return levels


def ik_tick(ik: Ik, data: mujoco.MjData) -> Array:
    """Solve one tick with `Ik`; return the velocities (nv,)."""
    return ik.step(data, PERIOD_S)


def mink_arguments(robot: Robot, case: Case) -> tuple[Any, ...]:
    """Return the arguments of `mink_tick`: configuration, positions, tasks and limits."""
    model = robot.model
    turn = 1.0 if robot.balances else 0.0
    tasks: list[Any] = [_frame(foot, pose, turn) for foot, pose in case.feet.items()]
    if robot.balances:
        center = mink.ComTask(cost=[1.0, 1.0, 0.0])
        center.set_target(case.center)
        tasks.append(center)
    posture = mink.PostureTask(model, cost=1e-2)
    posture.set_target(model.qpos0)
    joints = [k for k in range(model.njnt) if model.jnt_type[k] != mujoco.mjtJoint.mjJNT_FREE]
    speeds = {model.joint(k).name: RATE_LIMIT for k in joints}
    limits = [mink.ConfigurationLimit(model), mink.VelocityLimit(model, speeds)]
    tasks += [_frame(robot.frame, case.goal, 1.0), posture]
    return mink.Configuration(model, case.data.qpos), case.data.qpos, tasks, limits


def _frame(name: str, pose: Pose, turn: float) -> mink.FrameTask:
    task = mink.FrameTask(name, "site", position_cost=1.0, orientation_cost=turn)
    task.set_target(mink.SE3.from_matrix(pose.matrix()))
    return task


def mink_tick(
    configuration: Any, qpos: Array, tasks: Sequence[Any], limits: Sequence[Any]
) -> Array:
    """Update mink's kinematics and solve one tick; return the velocities (nv,)."""
    configuration.update(qpos)
    return mink.solve_ik(configuration, tasks, PERIOD_S, "daqp", limits=limits)


def ik(name: str, rng: np.random.Generator) -> dict[str, Candidate]:
    """Return one tick of `Ik` and of mink as candidates that agree in all tasks but the posture."""
    robot = ROBOTS[name]
    cases = [random_case(robot, rng) for _ in range(8)]
    limits, active = Limits(velocity=RATE_LIMIT), robot.active
    problems = [
        (Ik(robot.model, tasks_of(robot, case), limits, active=active), case.data) for case in cases
    ]
    mink_problems = [mink_arguments(robot, case) for case in cases]
    velocities: dict[str, list[Array]] = {"ours": [], "targets": [], "mink": []}
    for case, problem, mink_problem in zip(cases, problems, mink_problems, strict=True):
        first = [task.on(robot.model) for level in tasks_of(robot, case)[:-1] for task in level]
        J = np.vstack([task.jacobian(robot.model, case.data) for task in first])
        error = np.concatenate([task.error(robot.model, case.data) for task in first])
        velocities["targets"].append(error / PERIOD_S)
        velocities["ours"].append(J @ ik_tick(*problem))
        velocities["mink"].append(J @ mink_tick(*mink_problem))
    check_agreement({name: np.array(rows) for name, rows in velocities.items()}, TOLERANCE)
    return {
        "ours": Candidate(ik_tick, lambda: problems, len(cases)),
        "mink": Candidate(mink_tick, lambda: mink_problems, len(cases)),
    }
