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

from benchmarks.contender import Contender, agree
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
RATE_LIMIT = 3.0  # of every slide and hinge
TOLERANCE = 0.1  # of what the first tasks ask for: the costs of mink are a hundred to one
_WAY_M = 0.002
_AWAY_RAD = 0.05


@dataclass(frozen=True)
class Robot:
    """A model, the frame that goes somewhere, and what stands meanwhile."""

    name: str
    frame: str
    feet: tuple[str, ...] = ()
    balances: bool = False

    @cached_property
    def model(self) -> mujoco.MjModel:
        """The file of that name."""
        return load_model(MODELS / f"{self.name}.xml")

    @property
    def active(self) -> tuple[str, ...]:
        """What moves beside the motors: the trunk of who walks."""
        return ("root",) if self.feet else ()


ROBOTS = {
    each.name: each
    for each in (
        Robot("arm", "payload"),
        Robot("mobile", "tool"),
        Robot("quadruped", "trunk", ("front_left", "front_right", "rear_left", "rear_right")),
        Robot("humanoid", "right_hand", ("left_foot", "right_foot"), balances=True),
    )
}


@dataclass(frozen=True)
class Case:
    """A state, and where the frame, the feet and the centre of mass are to be."""

    data: mujoco.MjData
    goal: Pose
    feet: dict[str, Pose]
    center: Array


def random_case(robot: Robot, rng: np.random.Generator) -> Case:
    """A posture around that of the model."""
    model, data = robot.model, mujoco.MjData(robot.model)
    step = rng.uniform(-_AWAY_RAD, _AWAY_RAD, size=model.nv)
    step[: 6 if robot.active else 0] = 0.0
    mujoco.mj_integratePos(model, data.qpos, step, 1.0)
    data = assemble(model, data)
    here = pose_of(model, data, robot.frame)
    goal = Pose(here.rotation, here.translation_m + rng.uniform(-_WAY_M, _WAY_M, size=3))
    feet = {foot: pose_of(model, data, foot) for foot in robot.feet}
    return Case(data, goal, feet, pose_of(model, data, CenterOfMass()).translation_m)


def tasks_of(robot: Robot, case: Case) -> list[list[TaskFunction]]:
    """Levels: what stands, the centre of mass, the frame, the posture."""
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


def by_levels(robot: Robot, case: Case) -> tuple[Ik, mujoco.MjData]:
    """Arguments of `ik_tick`."""
    limits = Limits(velocity=RATE_LIMIT)
    return Ik(robot.model, tasks_of(robot, case), limits, active=robot.active), case.data


def ik_tick(ik: Ik, data: mujoco.MjData) -> Array:
    """Velocities (nv,)."""
    return ik.step(data, PERIOD_S)


def by_mink(robot: Robot, case: Case) -> tuple[Any, ...]:
    """Arguments of `mink_tick`: configuration, positions, tasks and limits."""
    model = robot.model
    tasks: list[Any] = [
        _frame(foot, pose, 1.0 if robot.balances else 0.0) for foot, pose in case.feet.items()
    ]
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
    """Kinematics and velocities (nv,)."""
    configuration.update(qpos)
    return mink.solve_ik(configuration, tasks, PERIOD_S, "daqp", limits=limits)


def ik(name: str, rng: np.random.Generator) -> dict[str, Contender]:
    """One tick in each way; both do what all tasks but the posture ask for."""
    robot = ROBOTS[name]
    cases = [random_case(robot, rng) for _ in range(8)]
    ours = [by_levels(robot, case) for case in cases]
    theirs = [by_mink(robot, case) for case in cases]
    done: dict[str, list[Array]] = {"ours": [], "asked": [], "mink": []}
    for case, own, other in zip(cases, ours, theirs, strict=True):
        first = [task.on(robot.model) for level in tasks_of(robot, case)[:-1] for task in level]
        J = np.vstack([task.jacobian(robot.model, case.data) for task in first])
        error = np.concatenate([task.error(robot.model, case.data) for task in first])
        done["asked"].append(error / PERIOD_S)
        done["ours"].append(J @ ik_tick(*own))
        done["mink"].append(J @ mink_tick(*other))
    agree({who: np.array(each) for who, each in done.items()}, TOLERANCE)
    return {
        "ours": Contender(ik_tick, lambda: ours, len(cases)),
        "mink": Contender(mink_tick, lambda: theirs, len(cases)),
    }
