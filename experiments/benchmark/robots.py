"""One tick with velocity limits of robots that are no hexapod: by the general path, and by mink.

An arm moves its camera in all six directions; a humanoid stands on both feet, moves its right palm
in six directions and its centre of mass in the two horizontal ones. All this is exact, no joint is
faster than its limit, and the rates are as close to desired ones as that leaves them.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import mink
import mujoco
import numpy as np
from scipy.linalg import null_space
from scipy.optimize import LinearConstraint, minimize

from argument_checks.ties import exceeds
from experiments.benchmark.measurement import Agreement, Contender, compare
from experiments.benchmark.pointing import Rows, general_tick, solve_ik
from prioritized import canonical_basis
from sim import MODELS, Array, CenterOfMass, JacobianReader, Jacobians, Pin, load_model

LIMIT = 1.0
"""Of each actuated joint, [rad]/[s]."""
TOLERANCE = 1e-6
"""Of the answers, as a fraction of the rates: daqp's default tolerance."""
_INSIDE = 0.7
"""The task is that of rates within this fraction of the limits."""
_AWAY_RAD = 0.3
"""How far joints are from the posture of the model, at most."""


@dataclass(frozen=True)
class Robot:
    """A model and its task in world axes: rows `major` of site and centre of mass; pinned feet.

    `spread` is the standard deviation of desired rates, [rad]/[s], chosen so that limits bind.
    """

    name: str
    model: mujoco.MjModel
    site: str
    major: tuple[int, ...]
    spread: float
    feet: tuple[str, ...] = ()

    @cached_property
    def read(self) -> Callable[[mujoco.MjData], Jacobians]:
        """Rows 0 to 5 of J_T are the site's, 6 to 8 the centre of mass's."""
        pins = [Pin(foot, weld=True) for foot in self.feet]
        return JacobianReader(self.model, [self.site, CenterOfMass()], pinned=pins).at

    @property
    def joints(self) -> Array:
        """Velocity index of each actuator, shape (n,)."""
        return self.model.jnt_dofadr[self.model.actuator_trnid[:, 0]]

    @property
    def tick(self) -> Callable[..., Array]:
        """The general path: rates (n,) from major velocity, joint positions, desired rates (n,)."""
        limits = np.full(self.model.nu, LIMIT)
        return general_tick(
            self.model,
            self.read,
            lambda kinematics: kinematics.velocity_mapping(
                self.major, joint_weight=np.ones(self.model.nu), rate_limits=(-limits, limits)
            ),
        )


def robots() -> list[Robot]:
    """The arm of models/arm.xml, and the humanoid of models/humanoid.xml."""
    return [
        Robot("arm", load_model(MODELS / "arm.xml"), "payload", tuple(range(6)), spread=2.0),
        Robot(
            "humanoid",
            load_model(MODELS / "humanoid.xml"),
            "right_hand",
            tuple(range(8)),
            spread=1.0,
            feet=("left_foot", "right_foot"),
        ),
    ]


@dataclass(frozen=True)
class Case:
    """Desired major velocity (m1,), joint positions (nq,), desired rates (n,)."""

    major: Array
    qpos: Array
    desired: Array


def random_cases(robot: Robot, count: int, rng: np.random.Generator) -> list[Case]:
    """Postures around that of the model; what is asked for there is within reach of the limits."""
    model, data = robot.model, mujoco.MjData(robot.model)
    cases = []
    for _ in range(count):
        qpos = model.qpos0.copy()
        away = rng.uniform(-_AWAY_RAD, _AWAY_RAD, size=model.nu)
        qpos[model.jnt_qposadr[model.actuator_trnid[:, 0]]] += away
        data.qpos[:] = qpos
        jac = robot.read(data)
        allowed = canonical_basis(null_space(jac.J_C)) if len(jac.J_C) else np.eye(model.nv)
        velocities = allowed @ rng.normal(size=allowed.shape[1])
        velocities *= _INSIDE * LIMIT / np.abs(velocities[jac.active]).max()
        major = jac.J_T[list(robot.major)] @ velocities
        cases.append(Case(major, qpos, rng.normal(scale=robot.spread, size=model.nu)))
    return cases


def mink_arguments(robot: Robot, cases: Sequence[Case]) -> list[tuple[Any, ...]]:
    """Of `solve_ik`: configurations already updated, tasks and limits already made."""
    model = robot.model
    moved = np.eye(model.nv)[robot.joints]
    names = [model.joint(joint).name for joint in model.actuator_trnid[:, 0]]
    limits = [mink.VelocityLimit(model, dict.fromkeys(names, LIMIT))]
    feet = [Rows(np.ones(6), np.zeros(6), _twist(model, foot)) for foot in robot.feet]
    arguments = []
    for case in cases:
        # mink's sign: what is left to move.
        posture = Rows(np.ones(model.nu), -case.desired, lambda _: moved)
        exact = [*feet, Rows(np.ones(6), -case.major[:6], _twist(model, robot.site))]
        if len(robot.major) > 6:
            level = len(robot.major) - 6
            exact.append(Rows(np.ones(level), -case.major[6:], _center_of_mass(model, level)))
        arguments.append((mink.Configuration(model, case.qpos), [posture], exact, limits))
    return arguments


def _twist(model: mujoco.MjModel, site: str) -> Callable[[mink.Configuration], Array]:
    number, twist = model.site(site).id, np.zeros((6, model.nv))

    def rows(configuration: mink.Configuration) -> Array:
        mujoco.mj_jacSite(model, configuration.data, twist[3:], twist[:3], number)
        return twist

    return rows


def _center_of_mass(model: mujoco.MjModel, rows: int) -> Callable[[mink.Configuration], Array]:
    velocity = np.zeros((3, model.nv))

    def first(configuration: mink.Configuration) -> Array:
        mujoco.mj_jacSubtreeCom(model, configuration.data, velocity, 0)
        return velocity[:rows]

    return first


def contenders(robot: Robot, cases: Sequence[Case]) -> list[Contender]:
    """One tick in each way, and mink's kinematics, which the general path includes."""
    theirs = mink_arguments(robot, cases)
    updates = [(each[0], case.qpos) for each, case in zip(theirs, cases, strict=True)]
    at_joints = [(case.major, case.qpos, case.desired) for case in cases]
    timed = {
        "tick": (robot.tick, lambda: at_joints),
        "mink": (solve_ik, lambda: theirs),
        "mink_update": (mink.Configuration.update, lambda: updates),
    }
    return [
        Contender(f"{robot.name}_{name}", *each, units=len(cases), samples=10)
        for name, each in timed.items()
    ]


def answers(robot: Robot, cases: Sequence[Case]) -> dict[str, Array]:
    """Rates (N, n) of both contenders, and of scipy's sequential quadratic programming."""
    tick, mink_tick, _ = (partial(_all, each) for each in contenders(robot, cases))
    return {
        f"{robot.name}_tick": tick(),
        f"{robot.name}_mink": mink_tick()[:, robot.joints],
        "slsqp": np.array([_by_slsqp(robot, case) for case in cases]),
    }


def _all(contender: Contender) -> Array:
    return np.array([contender.call(*given) for given in contender.arguments()])


def question(robot: Robot) -> str:
    """What is asked, in words."""
    return f"one tick of the {robot.name}"


def agreement(robot: Robot, cases: Sequence[Case]) -> Agreement:
    """How far apart the answers are."""
    return compare(question(robot), answers(robot, cases), TOLERANCE)


def active_limits(robot: Robot, cases: Sequence[Case]) -> list[int]:
    """How many cases have 0, 1, ... rates at a limit."""
    rates = np.array([robot.tick(case.major, case.qpos, case.desired) for case in cases])
    return np.bincount((~exceeds(LIMIT, np.abs(rates))).sum(axis=1)).tolist()


def _by_slsqp(robot: Robot, case: Case) -> Array:
    """The same rates from MuJoCo's Jacobians, in all joints at once."""
    data = mujoco.MjData(robot.model)
    data.qpos[:] = case.qpos
    jac = robot.read(data)
    joints = np.eye(robot.model.nv)[jac.active]
    equal = np.vstack([jac.J_T[list(robot.major)], jac.J_C])
    target = np.concatenate([case.major, np.zeros(len(jac.J_C))])
    box = np.full(robot.model.nv, np.inf)
    box[jac.active] = LIMIT
    found = minimize(
        lambda u: 0.5 * np.sum((joints @ u - case.desired) ** 2),
        np.zeros(robot.model.nv),
        jac=lambda u: joints.T @ (joints @ u - case.desired),
        method="SLSQP",
        bounds=np.column_stack([-box, box]),
        constraints=LinearConstraint(equal, target, target),
        options={"ftol": 1e-15, "maxiter": 500},
    )
    return joints @ found.x
