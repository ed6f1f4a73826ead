"""Time one tick from joint positions to rates, by this library and by mink.

The rates perform the task exactly, within rate limits if there are any, as close to desired rates
as possible. The hexapod points (alpha, beta) with strut 1 locked and least motion of the other
struts. The arm moves its camera in all six directions. The humanoid stands on pinned feet and moves
its right palm in six directions, its centre of mass in the two horizontal ones.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import mink
import mujoco
import numpy as np
from scipy.linalg import null_space

from benchmarks.candidate import Candidate, check_agreement
from prioritized import ConstrainedSystem
from sim import MODELS, Array, CenterOfMass, JacobianReader, Pin, assemble, load_model

LIMIT = 1.0  # of each actuated joint, [rad]/[s]
TOLERANCE = 1e-8  # of the rates; mink solves the loop closure again
_INSIDE = 0.7  # fraction of the limits within which some rates perform the task


@dataclass(frozen=True, eq=False)
class Robot:
    """Bundled model with its task: rows `major` of a site and the centre of mass; pinned feet.

    The site's rows are in the axes of another, fixed site, or of the world. Actuators are sampled
    within `offset` [rad] or [m] of the model's posture. Desired rates have the standard deviation
    `spread` [rad]/[s], with which limits are active; 0 is no desired rates and no limits.
    """

    file: str
    site: str
    major: Sequence[int]
    offset: float = 0.3
    spread: float = 0.0
    feet: tuple[str, ...] = ()
    axes: str | None = None
    locked: tuple[int, ...] = ()

    @cached_property
    def model(self) -> mujoco.MjModel:
        """Model loaded from the bundled file of this name."""
        return load_model(MODELS / f"{self.file}.xml")

    @cached_property
    def reader(self) -> JacobianReader:
        """Jacobian reader; rows 0 to 5 of J_T are the site's, 6 to 8 the centre of mass's."""
        task = [self.site, CenterOfMass()] if max(self.major) > 5 else [self.site]
        pinned = [Pin(foot, weld=True) for foot in self.feet]
        return JacobianReader(self.model, task, self.axes, pinned=pinned)

    @property
    def joints(self) -> Array:
        """Velocity indices of the actuators, shape (n,)."""
        return self.model.jnt_dofadr[self.model.actuator_trnid[:, 0]]


_humanoid = partial(Robot, "humanoid", "right_hand", range(8), spread=1.0)
ROBOTS = {
    "hexapod": Robot("fjh", "payload", (0, 1), offset=1e-5, axes="base", locked=(0,)),
    "arm": Robot("arm", "payload", range(6), spread=2.0),
    "humanoid_one_foot": _humanoid(feet=("left_foot",)),
    "humanoid": _humanoid(feet=("left_foot", "right_foot")),
}


@dataclass(frozen=True)
class Case:
    """Problem of a tick: major velocity (m1,), joint positions (nq,), desired rates (n,)."""

    major: Array
    qpos: Array
    desired: Array


def random_case(robot: Robot, rng: np.random.Generator) -> Case:
    """Sample a posture with closed loops, and a major velocity that the limits allow."""
    model, data = robot.model, mujoco.MjData(robot.model)
    offset = rng.uniform(-robot.offset, robot.offset, size=model.nu)
    data.qpos[model.jnt_qposadr[model.actuator_trnid[:, 0]]] += offset
    data = assemble(model, data)
    jac = robot.reader.at(data)
    locked_rows = np.eye(model.nv)[robot.joints[list(robot.locked)]]
    allowed = null_space(np.vstack([jac.J_C, locked_rows]))
    velocities = allowed @ rng.normal(size=allowed.shape[1])
    velocities *= _INSIDE * LIMIT / np.abs(velocities[jac.active]).max()
    major = jac.J_T[list(robot.major)] @ velocities
    return Case(major, data.qpos.copy(), rng.normal(scale=robot.spread, size=model.nu))


def tick_of(robot: Robot) -> Callable[[Case], Array]:
    """Return a function from a case to rates (n,) by one compiled call.

    Pose-independent data are prepared once, outside the returned function.
    """
    data, reader = mujoco.MjData(robot.model), robot.reader
    system = ConstrainedSystem.of(reader.at(data)).with_failures(locked=robot.locked)
    kinematics = system.kinematics()
    mapping = kinematics.velocity_mapping(robot.major, joint_weight=np.ones(robot.model.nu))
    tick, survivors, joints = mapping.tick(), kinematics.actuators, robot.joints
    assert tick is not None
    limits = np.full(system.J_T.shape[1], np.inf)
    if robot.spread:
        limits[joints] = LIMIT
    box, m1 = (-limits, limits), len(robot.major)
    targets = np.empty(m1 + len(survivors))

    def solve(case: Case) -> Array:
        data.qpos[:] = case.qpos
        read = reader.read(data)
        targets[:m1], targets[m1:] = case.major, case.desired.take(survivors)
        velocities = tick(read.J_T, read.J_C, targets, box, read.error_bound)
        assert velocities is not None
        return velocities.take(joints)

    return solve


class Rows(mink.Task):
    """Task for mink with selected rows and a constant error.

    mink's `FrameTask` always has six rows, all of which would be constraints; its `DampingTask` has
    a row for every joint, which takes 6 % longer.
    """

    def __init__(self, desired: Array, rows: Callable[[mink.Configuration], Array]) -> None:
        """Take the desired velocities and a function from configuration to Jacobian (rows, nv)."""
        super().__init__(cost=np.ones(len(desired)))
        self._error, self._rows = -desired, rows

    def compute_error(self, configuration: mink.Configuration) -> Array:
        """Return the error (rows,), with mink's sign."""
        return self._error

    def compute_jacobian(self, configuration: mink.Configuration) -> Array:
        """Return the Jacobian, shape (rows, nv)."""
        return self._rows(configuration)


def mink_arguments(robot: Robot, case: Case) -> tuple[Any, ...]:
    """Return the arguments of `mink_tick`: configuration, positions, tasks, constraints, limits."""
    model, actuated, limits = robot.model, np.eye(robot.model.nv)[robot.joints], []
    if robot.spread:
        names = [model.joint(joint).name for joint in model.actuator_trnid[:, 0]]
        limits = [mink.VelocityLimit(model, dict.fromkeys(names, LIMIT))]
    twist, center = case.major[:6], case.major[6:]
    exact: list[Any] = [Rows(twist, _twist(model, robot.site, len(twist), robot.axes))]
    exact += [Rows(np.zeros(6), _twist(model, foot, 6)) for foot in robot.feet]
    if model.neq:
        exact.append(mink.EqualityConstraintTask(model, cost=1.0))
    if robot.locked:
        exact.append(mink.DofFreezingTask(model, robot.joints[list(robot.locked)].tolist()))
    if len(center):
        exact.append(Rows(center, _center_of_mass(model, len(center))))
    posture = Rows(case.desired, lambda _: actuated)
    return mink.Configuration(model, case.qpos), case.qpos, [posture], exact, limits


def mink_tick(
    configuration: mink.Configuration,
    qpos: Array,
    tasks: list[Any],
    constraints: list[Any],
    limits: Sequence[mink.Limit],
) -> Array:
    """Update mink's kinematics and solve for displacements of all joints (nv,), the fastest way.

    Tasks given as constraints are equalities, which have strict priority as in this library. The
    option `eq_reduction` takes no time; without it daqp's tolerance is 1e-4 of this small motion.
    """
    configuration.update(qpos)
    return mink.solve_ik(
        configuration, tasks, 1.0, "daqp", limits=limits, constraints=constraints, eq_reduction=1
    )


def _twist(
    model: mujoco.MjModel, site: str, first: int, axes: str | None = None
) -> Callable[[mink.Configuration], Array]:
    """Return a function from configuration to the first rows of a site's twist Jacobian."""
    number, twist, data = model.site(site).id, np.zeros((6, model.nv)), mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    turn = np.eye(3) if axes is None else data.site(axes).xmat.reshape(3, 3).T
    rotation = np.kron(np.eye(2), turn)[:first]

    def rows(configuration: mink.Configuration) -> Array:
        mujoco.mj_jacSite(model, configuration.data, twist[3:], twist[:3], number)
        return twist[:first] if axes is None else rotation @ twist

    return rows


def _center_of_mass(model: mujoco.MjModel, first: int) -> Callable[[mink.Configuration], Array]:
    velocity = np.zeros((3, model.nv))

    def rows(configuration: mink.Configuration) -> Array:
        mujoco.mj_jacSubtreeCom(model, configuration.data, velocity, 0)
        return velocity[:first]

    return rows


def tick(name: str, rng: np.random.Generator) -> dict[str, Candidate]:
    """Return candidates: the library's tick, and mink's `solve_ik` with its kinematics."""
    robot = ROBOTS[name]
    cases = [random_case(robot, rng) for _ in range(8)]
    solve, arguments = tick_of(robot), [mink_arguments(robot, case) for case in cases]
    solutions = {
        "ours": np.array([solve(case) for case in cases]),
        "mink": np.array([mink_tick(*problem)[robot.joints] for problem in arguments]),
    }
    check_agreement(solutions, TOLERANCE)
    return {
        "ours": Candidate(solve, lambda: [(case,) for case in cases], len(cases)),
        "mink": Candidate(mink_tick, lambda: arguments, len(cases)),
    }
