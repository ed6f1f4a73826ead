"""One tick of the hexapod, strut 1 locked: by the general path, in closed form, and by mink.

The hexapod is to point by (alpha, beta) with its loops closed, strut 1 where it is, and the other
struts moving least. LAPACK on MuJoCo's Jacobians is the reference.
"""

from collections.abc import Callable, Sequence
from copy import deepcopy
from dataclasses import dataclass
from typing import Any

import mink
import mujoco
import numpy as np
from scipy.linalg.lapack import dgglse

from experiments.benchmark.measurement import Agreement, Contender, compare
from experiments.rig.hexapod.columns import MAJOR, SECONDARY
from experiments.rig.hexapod.controller import StrutMapping
from ftc.goal import Goal
from prioritized import ConstrainedSystem, Kinematics, VelocityMapping
from sim import NOMINAL, Array, JacobianReader, Jacobians, Plant, Pose, hexapod, jacobians

TOLERANCE = 1e-5
"""mink also closes the 0.7 nm by which the loops sag: that is 1e-6 of the answer."""
STUCK = 0
GOAL = Goal(joint_weight=(1.0,) * 6, locked_at={STUCK: 0.0})


@dataclass(frozen=True)
class Case:
    """All joints (nq,) and the payload's pose, loops closed; (alpha, beta) that is asked for."""

    qpos: Array
    pose: Pose
    pointing_rad: Array


def random_cases(model: mujoco.MjModel, count: int, rng: np.random.Generator) -> list[Case]:
    """Poses that the machine itself has gone to, and as many displacements to ask for there."""
    mapping = strut_mapping(model)
    cases = []
    for there_rad, asked_rad in rng.uniform(-1e-4, 1e-4, size=(count, 2, 2)):
        plant = Plant(model)
        plant.settle(0.1, mapping.displacements(there_rad, NOMINAL))
        cases.append(Case(plant.data.qpos.copy(), plant.pose(), asked_rad))
    return cases


def strut_mapping(model: mujoco.MjModel) -> StrutMapping:
    """The experiments' own, which re-evaluates its Jacobian at every call."""
    return StrutMapping(hexapod(model), GOAL, "analytic")


def general_tick(
    model: mujoco.MjModel,
    read: Callable[[mujoco.MjData], Jacobians],
    mapped: Callable[[Kinematics], VelocityMapping],
    locked: Sequence[int] = (),
) -> Callable[..., Array]:
    """The library as a client with a robot of its own calls it, for any MJCF.

    `read` takes the Jacobians of the task at a state, and `mapped` prepares the mapping.

    Returns:
        From desired major velocities, joint positions (nq,) and desired rates, if any, to rates of
        all actuators (n,).
    """
    data = mujoco.MjData(model)
    system = ConstrainedSystem.of(read(data)).with_failures(locked=locked)
    mapping = mapped(system.kinematics())

    def tick(major: Array, qpos: Array, *desired: Array) -> Array:
        data.qpos[:] = qpos
        jac = read(data)
        kinematics = system.at(J_T=jac.J_T, J_C=jac.J_C).kinematics()
        return kinematics.expand(mapping.at(kinematics)(major, *desired))

    return tick


def pointing_tick(model: mujoco.MjModel) -> Callable[..., Array]:
    """From desired (alpha, beta) and joint positions (nq,) to strut displacements (6,)."""
    return general_tick(
        model,
        JacobianReader(model, site="payload", axes="base").at,
        lambda kinematics: kinematics.velocity_mapping(
            MAJOR, SECONDARY, GOAL.joint_weight, GOAL.secondary_weight
        ),
        locked=[STUCK],
    )


class Rows(mink.Task):
    """Only the rows that are meant, of constant error.

    mink's `FrameTask` has six rows where two are meant, all of which would be constraints, and its
    `DampingTask` one for every joint, which takes 6 % longer.
    """

    def __init__(
        self, cost: Array, error: Array, rows: Callable[[mink.Configuration], Array]
    ) -> None:
        """Rows of the Jacobian (rows, nv) follow from the configuration."""
        super().__init__(cost=cost)
        self._error, self._rows = error, rows

    def compute_error(self, configuration: mink.Configuration) -> Array:
        """What is left to move, with mink's sign."""
        return self._error

    def compute_jacobian(self, configuration: mink.Configuration) -> Array:
        """Shape (rows, nv)."""
        return self._rows(configuration)


def _pointing(model: mujoco.MjModel, pointing_rad: Array) -> Rows:
    """The payload's rotation about x_b and y_b, from the configuration that is solved for."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    to_base = data.site("base").xmat.reshape(3, 3).T[MAJOR]
    payload, rotation = model.site("payload").id, np.empty((3, model.nv))

    def rows(configuration: mink.Configuration) -> Array:
        mujoco.mj_jacSite(configuration.model, configuration.data, None, rotation, payload)
        return to_base @ rotation

    return Rows(np.ones(len(MAJOR)), -pointing_rad, rows)


def mink_arguments(model: mujoco.MjModel, cases: Sequence[Case]) -> list[tuple[Any, ...]]:
    """Of `solve_ik`: configurations already updated, tasks already made."""
    struts = _strut_velocities(model)
    moved = np.eye(model.nv)[struts]
    least = Rows(np.array(GOAL.joint_weight), np.zeros(len(moved)), lambda _: moved)
    loops = mink.EqualityConstraintTask(model, cost=1.0)
    freeze = mink.DofFreezingTask(model, [int(struts[STUCK])])
    return [
        (
            mink.Configuration(model, case.qpos),
            [least],
            [_pointing(model, case.pointing_rad), loops, freeze],
        )
        for case in cases
    ]


def solve_ik(
    configuration: mink.Configuration,
    tasks: list[Any],
    constraints: list[Any],
    limits: Sequence[mink.Limit] = (),
) -> Array:
    """A displacement of all joints (nv,), as a user of mink gets it fastest.

    Tasks that are constraints are equalities: a strict priority, as here. Without `eq_reduction`
    daqp's tolerance is 1e-4 of so small a motion; it costs no time.
    """
    return mink.solve_ik(
        configuration, tasks, 1.0, "daqp", limits=limits, constraints=constraints, eq_reduction=1
    )


def _strut_velocities(model: mujoco.MjModel) -> Array:
    """Velocity index of each strut, shape (6,)."""
    return model.jnt_dofadr[model.actuator_trnid[:, 0]]


def _by_lapack(model: mujoco.MjModel, case: Case) -> Array:
    """The same strut displacements (6,) from MuJoCo's Jacobians, in all joints at once."""
    data = mujoco.MjData(model)
    data.qpos[:] = case.qpos
    jac = jacobians(model, data, "payload", "base")
    struts = np.eye(model.nv)[jac.active]
    equal = np.vstack([jac.J_T[MAJOR], jac.J_C, struts[[STUCK]]])
    target = np.zeros(len(equal))
    target[: len(MAJOR)] = case.pointing_rad
    return dgglse(struts, equal, np.zeros(len(struts)), target)[3][jac.active]


def contenders(model: mujoco.MjModel, cases: Sequence[Case]) -> list[Contender]:
    """One tick in each way, and mink's kinematics, which the general path includes."""
    theirs = mink_arguments(model, cases)
    updates = [(each[0], case.qpos) for each, case in zip(theirs, cases, strict=True)]
    at_joints = [(case.pointing_rad, case.qpos) for case in cases]

    def at_poses() -> list[tuple[Array, Pose]]:
        return [(case.pointing_rad, deepcopy(case.pose)) for case in cases]

    timed = {
        "tick": (pointing_tick(model), lambda: at_joints),
        "hexapod_tick": (strut_mapping(model).displacements, at_poses),
        "mink": (solve_ik, lambda: theirs),
        "mink_update": (mink.Configuration.update, lambda: updates),
    }
    return [Contender(name, *each, units=len(cases), samples=10) for name, each in timed.items()]


def agreement(model: mujoco.MjModel, cases: Sequence[Case]) -> Agreement:
    """Strut displacements of the three contenders, and of LAPACK."""
    answers = {
        each.name: np.array([each.call(*given) for given in each.arguments()])
        for each in contenders(model, cases)
    }
    del answers["mink_update"]  # it returns nothing
    answers["mink"] = answers["mink"][:, _strut_velocities(model)]
    answers["dgglse"] = np.array([_by_lapack(model, case) for case in cases])
    return compare("pointing with strut 1 locked", answers, TOLERANCE)
