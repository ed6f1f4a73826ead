"""One tick of robots in MJCF, from joint positions to rates, and by mink.

Each carries out a task exactly; where there are limits no joint is faster, and the rates are as
close to desired ones as that leaves them. The hexapod points by (alpha, beta) with strut 1 locked,
the other struts moving least. Arms move their camera in all six directions. The humanoid stands on
pinned feet and moves its right palm in six directions, its centre of mass in the two horizontal
ones.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import mink
import mujoco
import numpy as np
from scipy.linalg import null_space
from scipy.linalg.lapack import dgglse
from scipy.optimize import LinearConstraint, minimize

from benchmarks.contender import Contender, Question, question
from fjh.rig.hexapod.closed_form import hexapod
from fjh.rig.hexapod.columns import MAJOR
from fjh.rig.hexapod.controller import StrutMapping
from ftc import Goal
from prioritized import ConstrainedSystem
from sim import MODELS, NOMINAL, Array, CenterOfMass, JacobianReader, Pin, Plant, load_model

LIMIT = 1.0  # of each actuated joint, [rad]/[s]
TOLERANCE = 1e-5
"""Of the answers, as a fraction of the rates: mink also closes what the loops sag by, 0.7 nm."""
STUCK = Goal(joint_weight=(1.0,) * 6, locked_at={0: 0.0})
_INSIDE = 0.7  # the task is that of rates within this fraction of the limits
_AWAY_RAD = 0.3  # how far joints are from the posture of the model, at most
_UR5E = (
    (0.0, 0, 0.1625), (0.0, 90, 0.0), (-0.425, 0, 0.0), (-0.3922, 0, 0.1333), (0.0, 90, 0.0997),
    (0.0, -90, 0.0996),
)  # fmt: skip
"""Modified Denavit-Hartenberg rows as the maker publishes them: a [m], alpha [deg], d [m]."""


@dataclass(frozen=True, eq=False)
class Robot:
    """A model and its task: rows `major` of a site and the centre of mass; pinned feet.

    Desired rates have the standard deviation `spread` [rad]/[s], chosen so that limits bind; 0 is
    neither desired rates nor limits.
    """

    name: str
    model: mujoco.MjModel
    site: str
    major: tuple[int, ...]
    spread: float = 0.0
    feet: tuple[str, ...] = ()
    axes: str | None = None
    locked: tuple[int, ...] = ()

    @property
    def task(self) -> list[str | CenterOfMass]:
        """Rows 0 to 5 of J_T are the site's, 6 to 8 the centre of mass's."""
        return [self.site, CenterOfMass()] if max(self.major) > 5 else [self.site]

    @property
    def pinned(self) -> list[Pin]:
        """The feet."""
        return [Pin(foot, weld=True) for foot in self.feet]

    @cached_property
    def reader(self) -> JacobianReader:
        """Of the task."""
        return JacobianReader(self.model, self.task, self.axes, pinned=self.pinned)

    @property
    def joints(self) -> Array:
        """Velocity index of each actuator, shape (n,)."""
        return self.model.jnt_dofadr[self.model.actuator_trnid[:, 0]]

    @property
    def limits(self) -> tuple[Array, Array] | None:
        """Of the rates."""
        most = np.full(self.model.nu, LIMIT)
        return (-most, most) if self.spread else None


@dataclass(frozen=True)
class Case:
    """Desired major velocity (m1,), joint positions (nq,), desired rates (n,)."""

    major: Array
    qpos: Array
    desired: Array


@cache
def robots() -> dict[str, Robot]:
    """The hexapod with strut 1 locked, arms of seven and six joints, a humanoid on its feet."""
    arm, humanoid = load_model(MODELS / "arm.xml"), load_model(MODELS / "humanoid.xml")
    six, stands = tuple(range(6)), ("right_hand", tuple(range(8)))
    found = [
        Robot("hexapod", load_model(), "payload", tuple(MAJOR), axes="base", locked=(0,)),
        Robot("arm", arm, "payload", six, spread=2.0),
        Robot("ur5e", _ur5e(), "tool", (3, 4, 5), spread=2.0),
        Robot("humanoid_one_foot", humanoid, *stands, spread=1.0, feet=("left_foot",)),
        Robot("humanoid", humanoid, *stands, spread=1.0, feet=("left_foot", "right_foot")),
    ]
    return {each.name: each for each in found}


def _ur5e() -> mujoco.MjModel:
    """Six joints, as far apart as those of a UR5e."""
    links = motors = ""
    for k, (a, alpha, d) in enumerate(_UR5E):
        sine, cosine = np.sin(np.radians(alpha)), np.cos(np.radians(alpha))
        links += f'<body pos="{a} {-sine * d} {cosine * d}" euler="{alpha} 0 0"><joint name="{k}" '
        links += 'axis="0 0 1"/><geom size="0.05" mass="1"/>'
        motors += f'<motor joint="{k}"/>'
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><worldbody>{links}<site name="tool"/>{"</body>" * len(_UR5E)}</worldbody>'
        f"<actuator>{motors}</actuator></mujoco>"
    )


def random_cases(robot: Robot, count: int, rng: np.random.Generator) -> list[Case]:
    """Postures around that of the model; what is asked for there is within reach of the limits."""
    if robot.locked:
        return _hexapod_cases(robot, count, rng)
    model, data = robot.model, mujoco.MjData(robot.model)
    cases = []
    for _ in range(count):
        qpos = model.qpos0.copy()
        away = rng.uniform(-_AWAY_RAD, _AWAY_RAD, size=model.nu)
        qpos[model.jnt_qposadr[model.actuator_trnid[:, 0]]] += away
        data.qpos[:] = qpos
        jac = robot.reader.at(data)
        allowed = null_space(jac.J_C) if len(jac.J_C) else np.eye(model.nv)
        velocities = allowed @ rng.normal(size=allowed.shape[1])
        velocities *= _INSIDE * LIMIT / np.abs(velocities[jac.active]).max()
        major = jac.J_T[list(robot.major)] @ velocities
        cases.append(Case(major, qpos, rng.normal(scale=robot.spread, size=model.nu)))
    return cases


def _hexapod_cases(robot: Robot, count: int, rng: np.random.Generator) -> list[Case]:
    """Postures that the machine itself has gone to, loops closed, and displacements asked there."""
    still, cases = np.zeros(robot.model.nu), []
    mapping = StrutMapping(hexapod(robot.model), STUCK, "analytic")
    for there_rad, asked_rad in rng.uniform(-1e-4, 1e-4, size=(count, 2, 2)):
        plant = Plant(robot.model)
        plant.settle(0.1, mapping.displacements(there_rad, NOMINAL))
        cases.append(Case(asked_rad, plant.data.qpos.copy(), still))
    return cases


def tick_of(robot: Robot) -> Callable[[Case], Array]:
    """From a case to rates (n,) by one compiled call; what no pose changes is looked up once."""
    data, reader = mujoco.MjData(robot.model), robot.reader
    system = ConstrainedSystem.of(reader.at(data)).with_failures(locked=robot.locked)
    kinematics = system.kinematics()
    weight = np.ones(robot.model.nu)
    mapping = kinematics.velocity_mapping(robot.major, joint_weight=weight)
    tick, survivors, joints = mapping.tick(), kinematics.actuators, robot.joints
    assert tick is not None
    unlimited = np.full(system.J_T.shape[1], np.inf)
    lower, upper = -unlimited, unlimited
    if robot.limits is not None:
        lower[joints], upper[joints] = robot.limits
    m1, asked = len(robot.major), np.empty(len(robot.major) + len(survivors))

    def once(case: Case) -> Array:
        data.qpos[:] = case.qpos
        read = reader.read(data)
        asked[:m1], asked[m1:] = case.major, case.desired.take(survivors)
        velocities = tick(read.J_T, read.J_C, asked, (lower, upper), read.error_bound)
        assert velocities is not None
        return velocities.take(joints)

    return once


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


def mink_arguments(robot: Robot, cases: Sequence[Case]) -> list[tuple[Any, ...]]:
    """Of `solve_ik`: configurations, tasks and limits already made."""
    model, moved, limits = robot.model, np.eye(robot.model.nv)[robot.joints], []
    if robot.spread:
        names = [model.joint(joint).name for joint in model.actuator_trnid[:, 0]]
        limits = [mink.VelocityLimit(model, dict.fromkeys(names, LIMIT))]
    held: list[Any] = [Rows(np.ones(6), np.zeros(6), _twist(model, foot)) for foot in robot.feet]
    if model.neq:
        held.append(mink.EqualityConstraintTask(model, cost=1.0))
    if robot.locked:
        stuck = [int(robot.joints[k]) for k in robot.locked]
        held.append(mink.DofFreezingTask(model, stuck))
    first = sum(row < 6 for row in robot.major)
    own = robot.major[:first]
    arguments = []
    for case in cases:
        # mink's sign: what is left to move.
        posture = Rows(np.ones(model.nu), -case.desired, lambda _: moved)
        rows = _twist(model, robot.site, own, robot.axes)
        exact = [Rows(np.ones(first), -case.major[:first], rows), *held]
        if level := len(robot.major) - first:
            exact.append(Rows(np.ones(level), -case.major[first:], _center_of_mass(model, level)))
        arguments.append((mink.Configuration(model, case.qpos), [posture], exact, limits))
    return arguments


def solve_ik(
    configuration: mink.Configuration,
    qpos: Array,
    tasks: list[Any],
    constraints: list[Any],
    limits: Sequence[mink.Limit] = (),
) -> Array:
    """Update and a displacement of all joints (nv,), as a user of mink gets it fastest.

    Tasks that are constraints are equalities: a strict priority, as here. Without `eq_reduction`
    daqp's tolerance is 1e-4 of so small a motion; it costs no time.
    """
    configuration.update(qpos)
    return mink.solve_ik(
        configuration, tasks, 1.0, "daqp", limits=limits, constraints=constraints, eq_reduction=1
    )


def _twist(
    model: mujoco.MjModel, site: str, own: Sequence[int] = range(6), axes: str | None = None
) -> Callable[[mink.Configuration], Array]:
    """Rows `own` of a site's twist, in the axes of another site, which rests."""
    number, twist, data = model.site(site).id, np.zeros((6, model.nv)), mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    turn = np.eye(3) if axes is None else data.site(axes).xmat.reshape(3, 3).T
    chosen = np.kron(np.eye(2), turn)[list(own)]

    def rows(configuration: mink.Configuration) -> Array:
        mujoco.mj_jacSite(model, configuration.data, twist[3:], twist[:3], number)
        return twist if len(chosen) == 6 else chosen @ twist

    return rows


def _center_of_mass(model: mujoco.MjModel, rows: int) -> Callable[[mink.Configuration], Array]:
    velocity = np.zeros((3, model.nv))

    def first(configuration: mink.Configuration) -> Array:
        mujoco.mj_jacSubtreeCom(model, configuration.data, velocity, 0)
        return velocity[:rows]

    return first


def tick(name: str, rng: np.random.Generator) -> Question:
    """The library's tick, and mink's `solve_ik` with its update of the kinematics."""
    robot = robots()[name]
    cases = random_cases(robot, 8, rng)
    arguments = mink_arguments(robot, cases)
    theirs = [(each[0], case.qpos, *each[1:]) for each, case in zip(arguments, cases, strict=True)]
    ours = tick_of(robot)
    answers = {
        f"{name}_tick": np.array([ours(case) for case in cases]),
        f"{name}_mink": np.array([solve_ik(*each)[robot.joints] for each in theirs]),
        "reference": np.array([_reference(robot, case) for case in cases]),
    }
    contenders = [
        Contender(f"{name}_tick", ours, lambda: [(case,) for case in cases], len(cases)),
        Contender(f"{name}_mink", solve_ik, lambda: theirs, len(cases)),
    ]
    return question(contenders, answers, TOLERANCE)


def _reference(robot: Robot, case: Case) -> Array:
    """The same rates from MuJoCo's Jacobians, in all joints at once."""
    data = mujoco.MjData(robot.model)
    data.qpos[:] = case.qpos
    jac = robot.reader.at(data)
    joints = np.eye(robot.model.nv)[jac.active]
    equal = np.vstack([jac.J_T[list(robot.major)], jac.J_C, joints[list(robot.locked)]])
    target = np.zeros(len(equal))
    target[: len(robot.major)] = case.major
    if not robot.spread:
        return dgglse(joints, equal, case.desired, target)[3][jac.active]
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
