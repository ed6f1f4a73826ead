"""The hexapod, strut 1 locked: cases of a tick, and its tick in closed form.

It is to point by (alpha, beta) with its loops closed, strut 1 where it is, and the other struts
moving least.
"""

from copy import deepcopy
from dataclasses import dataclass

import mujoco
import numpy as np

from experiments.benchmark import robots
from experiments.benchmark.measurement import Agreement, Contender, Entry, compare
from experiments.rig.hexapod.columns import MAJOR
from experiments.rig.hexapod.controller import StrutMapping
from ftc.goal import Goal
from sim import NOMINAL, Array, Plant, Pose, hexapod

STUCK = 0
GOAL = Goal(joint_weight=(1.0,) * 6, locked_at={STUCK: 0.0})


@dataclass(frozen=True)
class Case(robots.Case):
    """Besides all joints (nq,), loops closed, the payload's pose."""

    pose: Pose


def robot(model: mujoco.MjModel) -> robots.Robot:
    """The hexapod as any robot."""
    points = {"site": "payload", "axes": "base", "major": tuple(MAJOR)}
    return robots.Robot("fjh", model, **points, locked=(STUCK,))


def random_cases(model: mujoco.MjModel, count: int, rng: np.random.Generator) -> list[Case]:
    """Poses that the machine itself has gone to, and as many displacements to ask for there."""
    mapping = strut_mapping(model)
    cases = []
    for there_rad, asked_rad in rng.uniform(-1e-4, 1e-4, size=(count, 2, 2)):
        plant = Plant(model)
        plant.settle(0.1, mapping.displacements(there_rad, NOMINAL))
        cases.append(Case(asked_rad, plant.data.qpos.copy(), np.zeros(model.nu), plant.pose()))
    return cases


def strut_mapping(model: mujoco.MjModel) -> StrutMapping:
    """The experiments' own, which re-evaluates its Jacobian at every call."""
    return StrutMapping(hexapod(model), GOAL, "analytic")


def closed_form(model: mujoco.MjModel, cases: list[Case]) -> Contender:
    """A tick from pose to struts, by the formula for this one machine."""

    def at_poses() -> list[tuple[Array, Pose]]:
        # Without what a pose already knows of its struts.
        return [(case.major, deepcopy(case.pose)) for case in cases]

    call = strut_mapping(model).displacements
    return Contender("hexapod_tick", call, at_poses, units=len(cases), samples=10)


def agreement(model: mujoco.MjModel, cases: list[Case]) -> Agreement:
    """Strut displacements by every way."""
    form, any_robot = closed_form(model, cases), robot(model)
    found = robots.answers(any_robot, cases)
    found[form.name] = np.array([form.call(*given) for given in form.arguments()])
    return compare(robots.question(any_robot), found, robots.TOLERANCE)


def entry(model: mujoco.MjModel, cases: list[Case]) -> Entry:
    """As any robot, by mink, and in closed form."""
    any_robot = robots.contenders(robot(model), cases)
    return Entry([*any_robot, closed_form(model, cases)], [agreement(model, cases)])
