"""The study `force`: static forces commanded by the force mapping; docs/force.md."""

import copy
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import mujoco
import numpy as np
import pandas as pd
import scipy.linalg
from matplotlib.figure import Figure

from fjh.rig.checks import CLOSURE_LIMIT_M
from fjh.rig.compromise import weighted_pseudo_inverse
from fjh.rig.hexapod.closed_form import hexapod
from fjh.rig.hexapod.columns import MAJOR, SECONDARY
from fjh.rig.hexapod.fault_tolerance import elastic_system, strut_and_payload_stiffness
from fjh.rig.hexapod.metrics import percent, plant_constants
from fjh.rig.run import rms
from fjh.study.option import OnProgress, Option, seed_of
from fjh.study.palette import BLACK, BLUE, PURPLE, VERMILION
from fjh.study.plotting import PAGE_IN, new_figure, one_legend
from fjh.study.result import Check, Picture, Result, TableView, check, origin
from fjh.study.workers import in_parallel
from prioritized import (
    ConstrainedSystem,
    Kinematics,
    Status,
    canonical_basis,
    force_mapping,
)
from sim import HEXAPOD_MJCF, NOMINAL, Array, Failure, Plant, jacobians, load_model
from sim.mjcf import weightless
from sim.plant import FailureKind, failed_plant

# Sizes of what is asked for: the major moment, the secondary force, and (at most) the moment about
# z_b. Together they take up to some 20 N of a coil, which has 80.
DRAWS, MAJOR_N_M, FORCE_N, TWIST_N_M = 4, 3.0, 20.0, 2.0
# W3 [1]/[N]: struts 1, 3 and 5 are hot, as under the paper's W_b. With W3 = I nothing would be
# traded: in the orthogonal hexapod the least torque exerts no secondary force at all.
SPARING = (2.0, 1.0, 2.0, 1.0, 2.0, 1.0)
# W4 of [f_x, f_y, f_z, m_z]: a moment counts as the force that makes it at the nodes, at 0.33 m.
LEVERED = (1.0, 1.0, 1.0, 3.0)

Weights = tuple[Sequence[float] | None, Sequence[float] | None]
GOALS: dict[int, Weights] = {7: (SPARING, LEVERED), 8: (SPARING, None), 9: (None, LEVERED)}
"""W3 and W4 of Problem 6, diagonal, by the theorem that solves it without failures; None is 0."""
LEAST_TORQUE, PRESCRIBED = 8, 9

OTHERS = 60  # torques of the same major force, at random
MAJOR_WEIGHTS = (0.3, 1.0, 3.0, 10.0, 30.0, 100.0)  # of the weighted pseudo-inverse, [1]/[N m]

# The platform stands on four legs where three are enough. All of its task is prescribed: torques
# that are J^T f, eq. (22), leave nothing to choose but the internal force.
PLATFORM_MJCF = HEXAPOD_MJCF.with_name("platform.xml")
PLATFORM_TASK, PLATFORM_MAJOR = (2, 3, 4), (0, 1, 2)
PLATFORM_N_M, PLATFORM_N = 1.0, 15.0  # largest moment and size of the force: up to 9.2 N a leg
HOT, SQUEEZE_N = 3.0, 30.0  # weight of a hot motor, others 1; bias that keeps a leg's play closed

# Clamped, nothing but closures moves; else the softest mode, 31.6 Hz, decays to 3e-5.
FIXTURE, SAMPLE_S, TARE_S, PRESS_S, HOLD_S = "fixture", 0.01, 0.05, 0.05, 0.6
OFF_PERCENT, COST_EXCESS, ROUND_OFF_N = 1.0, 1e-9, 1e-9  # limits of the checks


@dataclass(frozen=True)
class Condition:
    """What is broken: one strut, 0..5, or with kind None nothing."""

    kind: FailureKind | None = None
    strut: int = 0

    def __str__(self) -> str:
        return "sound" if self.kind is None else f"strut {self.strut + 1} {self.kind}"

    @property
    def failures(self) -> tuple[Failure, ...]:
        """What happens to the plant."""
        return () if self.kind is None else (Failure(self.strut, self.kind),)


def known_system(condition: Condition) -> ConstrainedSystem:
    """The failed hexapod as the mapping knows it: a rigid theory knows no suspension spring."""
    struts = [] if condition.kind is None else [condition.strut]
    failed = {"locked" if condition.kind == "locked" else "free": struts}
    return sound_system(HEXAPOD_MJCF, range(6)).with_failures(**failed)


def sound_system(path: Path, task: Sequence[int]) -> ConstrainedSystem:
    """A machine without failure, rigid, and without fixture."""
    model = load_model(path)
    jac = jacobians(model, mujoco.MjData(model), site="payload", axes="base")
    return ConstrainedSystem(jac.J_T[list(task)], jac.J_C, jac.active)


# A mechanism loaded from outside, and gauges that know nothing of the force mapping.


def with_fixture(path: Path) -> mujoco.MjModel:
    """The machine of an MJCF file, with a weld from the world to its payload's origin, unused yet.

    It clamps both ways, so that contact need not be kept, and is as stiff as the closures.
    """
    spec = mujoco.MjSpec.from_file(str(path))
    closure = spec.equality("closure1")
    spec.add_equality(
        name=FIXTURE,
        type=mujoco.mjtEq.mjEQ_WELD,
        objtype=mujoco.mjtObj.mjOBJ_BODY,
        name1="world",
        name2=spec.site("payload").parent.name,
        active=False,
        solref=closure.solref,
        solimp=closure.solimp,
    )
    return spec.compile()


class Gauges:
    """What closures, locks and the fixture do in MuJoCo, near the plant's nominal pose."""

    def __init__(self, plant: Plant, task: Sequence[int] = range(6)) -> None:
        """Read the wrench on the fixture in these rows of the payload twist."""
        model = copy.copy(plant.model)
        model.opt.disableactuator = 0  # a strut has its gauge, with a coil or without
        sound = jacobians(model, mujoco.MjData(model), site="payload", axes="base")
        self._plant, self._task = plant, list(task)
        self._J_T, self._active = sound.J_T[self._task], sound.active

    def read(self) -> Array:
        """Fixture wrench (6,), strut forces (n,), lock forces (n,), payload displacement (6,)."""
        joints, wrench = range(len(self._active)), np.zeros(6)
        # On the joints the fixture's wrench acts as J_T^T times it; here by the mechanism on it.
        wrench[self._task] = -np.linalg.lstsq(self._J_T.T, self._on_joints(FIXTURE))[0]
        strut = [-self._on_joints(f"closure{k + 1}")[self._active[k]] for k in joints]
        lock = [self._on_joints(f"lock{k + 1}")[self._active[k]] for k in joints]
        return np.concatenate([wrench, strut, lock, self._plant.displacement()])

    def _on_joints(self, equality: str) -> Array:
        """What one equality alone does to each velocity, shape (nv,)."""
        model, data = self._plant.model, self._plant.data
        rows = data.efc_type == int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)
        rows &= data.efc_id == model.equality(equality).id
        force = np.zeros(model.nv)
        mujoco.mj_mulJacTVec(model, data, force, np.where(rows, data.efc_force, 0.0))
        return force


class Readings(NamedTuple):
    """What the gauges read, less what they read before the first load.

    Each of the L loads is a step and stays for S samples; the last of them is at rest.
    """

    fixture: Array  # wrench [moment; force] exerted on it, (L, S, 6)
    strut_n: Array  # along each actuated joint, what its closure takes on, (L, S, n)
    lock_n: Array  # of each lock on its joint, (L, S, n)
    displacement: Array  # of the payload, [rotation; translation], (L, S, 6), [rad] and [m]
    closure_residual_m: Array  # largest gap of a loop or of the fixture, in full, (L, S)


def exert(
    model: mujoco.MjModel,
    failures: Sequence[Failure],
    torques: Array,
    held: Array | None = None,
    task: Sequence[int] = range(6),
) -> Readings:
    """Exert torques (L, n), [N], pressing on the fixture or holding wrenches.

    Args:
        model: One of :func:`with_fixture`.
        failures: Of its actuators.
        torques: Of all of them, one load a row.
        held: Wrenches (L, 6) in base axes that the world pushes back, without a fixture.
        task: Rows of the payload twist that the mechanism is about.

    Raises:
        sim.SimulationDiverged: The physics left the finite numbers.
    """
    plant, (L, n) = failed_plant(model, failures), torques.shape
    plant.data.eq_active[model.equality(FIXTURE).id] = held is None
    gauges, samples = Gauges(plant, task), round((PRESS_S if held is None else HOLD_S) / SAMPLE_S)
    plant.settle(TARE_S)
    before, rows, gaps = gauges.read(), [], []
    # At rest at zero an actuator that is commanded torque / gain exerts that torque.
    commands = torques / plant.model.actuator_gainprm[:, 0]
    for command, push in zip(commands, np.zeros((L, 6)) if held is None else -held, strict=True):
        plant.push(push)
        for _ in range(samples):
            plant.step(command, SAMPLE_S)
            rows.append(gauges.read() - before)
            gaps.append(plant.closure_residual_m())
    series = np.array(rows).reshape(L, samples, -1)
    fixture, strut_n, lock_n, displacement = np.split(series, [6, 6 + n, 6 + 2 * n], axis=-1)
    return Readings(fixture, strut_n, lock_n, displacement, np.array(gaps).reshape(L, samples))


# Rows by table, and the arrays that they were computed from.

Part = tuple[dict[str, list[dict[str, Any]]], dict[str, Array]]


def joined(parts: Sequence[Part]) -> Part:
    """All rows of each table, and all arrays."""
    rows, arrays = dict[str, list[dict[str, Any]]](), dict[str, Array]()
    for found, own in parts:
        arrays |= own
        for name, more in found.items():
            rows.setdefault(name, []).extend(more)
    return rows, arrays


def prefixed(where: str, arrays: dict[str, Array]) -> dict[str, Array]:
    """Arrays as their `.npz` names them."""
    return {f"{where} {name}".replace(" ", "_"): values for name, values in arrays.items()}


def off_percent(found: Array, expected: Array) -> float:
    """Distance of all of the rows from what was expected, relative to it."""
    return 100 * float(np.linalg.norm(found - expected) / np.linalg.norm(expected))


# Problem 6, and the least that it can cost, from eqs. (8) and (9) themselves, of which nothing is
# eliminated: independent of the library's elimination, mapping and rank decision.


def draw(rng: np.random.Generator, count: int) -> Array:
    """Wrenches [moment; force] in random directions, shape (count, 6)."""
    angle = rng.uniform(0, 2 * np.pi, count)
    force = rng.normal(size=(count, 3))
    force *= FORCE_N / np.linalg.norm(force, axis=1, keepdims=True)
    twist = rng.uniform(-TWIST_N_M, TWIST_N_M, count)
    return np.column_stack([MAJOR_N_M * np.cos(angle), MAJOR_N_M * np.sin(angle), twist, force])


def equilibria(system: ConstrainedSystem, major: Array) -> tuple[Array, Array]:
    """Every [torques; secondary force] of a failed mechanism with the given major forces (D, 2).

    One for each major force (D, 10), and columns of what may be added to it (10, d).
    """
    balance = np.vstack([system.J_T, system.J_C]).T  # velocities x [f; f_C]
    failed = sorted(system.failures.locked | system.failures.free)
    # A lock bears whatever comes on its joint; every other passive joint bears nothing.
    driven = np.delete(system.active, failed)
    bears_nothing = np.setdiff1d(np.arange(len(balance)), [*driven, *system.stuck])
    to_f = np.eye(6, balance.shape[1])
    conditions = np.vstack([balance[bears_nothing], to_f[MAJOR]])
    asked = np.hstack([np.zeros((len(major), len(bears_nothing))), major])
    seen = np.vstack([balance[system.active], to_f[SECONDARY]])
    seen[failed] = 0.0
    start = seen @ np.linalg.lstsq(conditions, asked.T)[0]
    return start.T, seen @ scipy.linalg.null_space(conditions)


def least_cost(weight: Array, possible: tuple[Array, Array], desired: Array) -> Array:
    """The least |weight ([torques; f_s] - desired)|^2 of any equilibrium, shape (D,)."""
    start, free = possible
    A, off = weight[:, None] * free, (weight * (start - desired)).T
    return ((A @ np.linalg.lstsq(A, -off)[0] + off) ** 2).sum(axis=0)


def closure_forces(system: ConstrainedSystem, kin: Kinematics, f: Array, torques: Array) -> Array:
    """What closures take on along actuated joints, eqs. (5) and (11), of survivors' torques."""
    f_C = kin.constraint_force(f, torques)[:, : len(system.J_C)]  # after these, the locks'
    return (f_C @ system.J_C)[:, system.active]


# The hexapod, sound and with a failed strut: it presses on the fixture, and holds wrenches.


class Answer(NamedTuple):
    """What the mapping says of wrenches [moment; force] that are asked for, one a row."""

    exact: bool  # its status
    torques: Array  # of the coils, (D, 6), [N]; zero at failed struts
    wrench: Array  # what they exert, with the secondary force chosen, (D, 6)
    strut: Array  # what each closure then takes on, eq. (11); a lock's reaction, (D, 6), [N]
    seen: Array  # orthogonal projector on the wrenches that the actuators span, (6, 6)
    cost_excess: Array  # over the least of all equilibria, relative to all that is weighed, (D,)


def answer(system: ConstrainedSystem, theorem: int, asked: Array) -> Answer:
    """The mapping's torques and the forces that go with them, for wrenches (D, 6)."""
    kin, (W3, W4) = system.kinematics(), GOALS[theorem]
    weight = np.concatenate([np.zeros(6) if W3 is None else W3, np.zeros(4) if W4 is None else W4])
    major, desired = asked.take(MAJOR, axis=1), asked.take(SECONDARY, axis=1)
    mapping = kin.force_mapping(MAJOR, SECONDARY, W3, W4)
    survivors, wrench = mapping(major, secondary_force=desired), np.empty_like(asked)
    secondary = mapping.secondary_force(major, secondary_force=desired)
    wrench[:, MAJOR], wrench[:, SECONDARY] = major - mapping.residual(major), secondary
    torques = kin.expand(survivors)
    target = np.hstack([np.zeros_like(torques), desired])
    cost = ((weight * (np.hstack([torques, secondary]) - target)) ** 2).sum(axis=1)
    whole = ((weight * np.hstack([torques, desired])) ** 2).sum(axis=1)
    return Answer(
        exact=mapping.status is Status.EXACT,
        torques=torques,
        wrench=wrench,
        strut=closure_forces(system, kin, wrench, survivors),
        seen=np.eye(6) - mapping.reaction,
        cost_excess=(cost - least_cost(weight, equilibria(system, major), target)) / whole,
    )


def examine(condition: Condition, system: ConstrainedSystem, asked: Array) -> Part:
    """The torques of a mapping that knows this system, for wrenches (D, 6), pressing and holding.

    A strut that loses its spring loses its preload too, which carries the weight, and is looked at
    in orbit; no spring holds it against prescribed wrenches.
    """
    model = with_fixture(HEXAPOD_MJCF)
    if condition.kind == "loose":
        model = weightless(model)
    found = {theorem: answer(system, theorem, asked) for theorem in GOALS}
    parts = [_try(condition, model, asked, *each) for each in found.items()]
    if condition.kind == "loose":
        return joined(parts)
    torques = {"rigid": found[PRESCRIBED].torques}
    if known := system.failures.free:
        kin = elastic_system(load_model()).with_failures(free=known).kinematics()
        mapping = kin.force_mapping(MAJOR, SECONDARY, secondary_weight=LEVERED)
        goals = asked.take(SECONDARY, axis=1)
        torques["elastic"] = kin.expand(mapping(asked[:, MAJOR], secondary_force=goals))
    locked = sorted(system.failures.locked)
    return joined([*parts, *(_hold(condition, locked, asked, *way) for way in torques.items())])


def _try(
    condition: Condition, model: mujoco.MjModel, asked: Array, theorem: int, said: Answer
) -> Part:
    """Pressing on the fixture; held without it, against the wrench that the mapping exerts."""
    pressed = exert(model, condition.failures, said.torques)
    held = exert(model, condition.failures, said.torques, said.wrench)
    fixture = pressed.fixture[:, -1]
    # As far as the push would move the payload if the springs alone held it.
    unheld = np.linalg.solve(payload_stiffness(load_model()), said.wrench.T).T
    row = {
        "condition": str(condition),
        "kind": condition.kind,
        "theorem": theorem,
        "exact": said.exact,
        "cost_excess": said.cost_excess.max(),
        "torque_peak_n": np.abs(said.torques).max(),
        "pressed_off_percent": percent((fixture - said.wrench) @ said.seen, said.wrench),
        "pressed_major_off_percent": off_percent(fixture[:, MAJOR], asked[:, MAJOR]),
        "held_off_percent": off_percent(held.strut_n[:, -1], said.strut),
        "moved_percent": percent(held.displacement[:, -1], unheld),
        "closure_residual_max_m": max(x.closure_residual_m.max() for x in (pressed, held)),
    }
    bears = {
        "condition": str(condition),
        "theorem": theorem,
        "load": np.arange(len(asked)) + 1,
        "predicted_n": said.strut[:, condition.strut],
        "simulated_n": held.lock_n[:, -1, condition.strut],
        "simulated_pressed_n": pressed.lock_n[:, -1, condition.strut],
    }
    reaction = pd.DataFrame(bears).to_dict("records") if condition.kind == "locked" else []
    arrays = {"torques_n": said.torques, "wrench": said.wrench, "strut_n": said.strut}
    return {"theorems": [row], "reaction": reaction}, prefixed(
        f"{condition} theorem {theorem}",
        arrays | prefixed("pressed", pressed._asdict()) | prefixed("held", held._asdict()),
    )


def _hold(
    condition: Condition, locked: Sequence[int], asked: Array, mapping: str, torques: Array
) -> Part:
    """All that is asked for, against torques of a mapping that knows these struts to be locked.

    The rigid one knows no springs, and eq. (9) forbids what a free strut would have to bear; the
    elastic one leaves that to the strut's spring.
    """
    model = load_model()
    A, K = hexapod(model).inverse_jacobian(NOMINAL), payload_stiffness(model)
    # A lock leaves five directions to move in, and bears what comes across them.
    Z = scipy.linalg.null_space(A[locked]) if locked else np.eye(6)
    give = Z @ np.linalg.inv(Z.T @ K @ Z) @ Z.T
    held = exert(with_fixture(HEXAPOD_MJCF), condition.failures, torques, asked)
    missing, simulated = asked - torques @ A, held.displacement[:, -1]
    lacking, predicted = missing @ Z @ Z.T, -missing @ give
    sizes = {
        "lacking_force_n": lacking[:, 3:],
        "lacking_major_n_m": lacking[:, MAJOR],
        "predicted_pointing_urad": 1e6 * predicted[:, MAJOR],
        "predicted_translation_um": 1e6 * predicted[:, 3:],
        "simulated_pointing_urad": 1e6 * simulated[:, MAJOR],
        "simulated_translation_um": 1e6 * simulated[:, 3:],
    }
    columns = {
        "condition": str(condition),
        "mapping": mapping,
        # If the springs had to balance all of what is asked for, it would move by -asked @ give.
        "off_percent": percent(simulated - predicted, asked @ give),
        "load": np.arange(len(asked)) + 1,
        **{name: np.linalg.norm(vectors, axis=1) for name, vectors in sizes.items()},
    }
    arrays = {"torques_n": torques, "predicted": predicted} | held._asdict()
    rows = pd.DataFrame(columns).to_dict("records")
    return {"prescribed": rows}, prefixed(f"{condition} prescribed {mapping}", arrays)


def payload_stiffness(model: mujoco.MjModel) -> Array:
    """K of all springs against the payload's displacement in base axes, shape (6, 6)."""
    of_struts_and_payload = strut_and_payload_stiffness(model)
    A = hexapod(model).inverse_jacobian(NOMINAL)
    return A.T @ of_struts_and_payload[:6, :6] @ A + of_struts_and_payload[6:, 6:]


# What the optimum is worth: other torques press on the same fixture.


def trade(asked: Array, rng: np.random.Generator) -> Part:
    """Torques for one major force (2,): the mapping's, others at random, pseudo-inverses."""
    model, system = with_fixture(HEXAPOD_MJCF), known_system(Condition())
    kin, W3 = system.kinematics(), np.array(SPARING)
    best = kin.expand(kin.force_mapping(MAJOR, SECONDARY, *GOALS[LEAST_TORQUE])(asked[None]))
    directions = canonical_basis(scipy.linalg.orth(equilibria(system, asked[None])[1][:6]))
    away = rng.normal(size=(OTHERS, directions.shape[1])) @ directions.T
    size = np.linalg.norm(best) * rng.uniform(0.05, 1.0, (OTHERS, 1))
    away *= size / np.linalg.norm(away, axis=1, keepdims=True)
    # Over f all errors at once, the major ones weighted: [f_m; torques] = [I_m; J^T] f.
    rows_of_f = np.vstack([np.eye(6)[MAJOR], kin.J.T])
    compromises = [
        weighted_pseudo_inverse(rows_of_f, [0, 1], range(2, 8), w, secondary_weight=W3)(asked)
        for w in MAJOR_WEIGHTS
    ]
    ways = {
        "mapping": (best, [None]),
        "others": (best + away, [None] * OTHERS),
        "pseudo_inverse": (np.array([kin.J.T @ f for f in compromises]), MAJOR_WEIGHTS),
    }
    least, rows, arrays = float(np.linalg.norm(best * W3)), [], dict[str, Array]()
    for way, (torques, weights) in ways.items():
        at_rest = exert(model, (), torques).fixture[:, -1]
        off = np.linalg.norm(at_rest[:, MAJOR] - asked, axis=1) / np.linalg.norm(asked)
        weighed_n = np.linalg.norm(torques * W3, axis=1)
        columns = {
            "way": way,
            "major_weight_per_n_m": weights,
            "weighed_torque_n": weighed_n,
            "weighed_over_mapping": weighed_n / least,
            "major_off_percent": 100 * off,
        }
        rows += pd.DataFrame(columns).to_dict("records")
        arrays |= prefixed(
            f"tradeoff {way}", {"torques": torques, "weighed": weighed_n, "major_off": off}
        )
    return {"tradeoff": rows}, arrays


# A platform stands on four legs where three are enough, and has an internal force to use.


def use_internal_force(rng: np.random.Generator) -> Part:
    """Relieve each motor in turn, then squeeze, pressing on the fixture.

    With the torques J^T f, as in the paper, and with J^T f + C^T eta.
    """
    model, system = with_fixture(PLATFORM_MJCF), sound_system(PLATFORM_MJCF, PLATFORM_TASK)
    kin = system.kinematics()
    angle = rng.uniform(0, 2 * np.pi, DRAWS)
    moment = rng.uniform(-PLATFORM_N_M, PLATFORM_N_M, DRAWS)
    f = np.column_stack([moment, PLATFORM_N * np.cos(angle), PLATFORM_N * np.sin(angle)])
    wrench = np.zeros((DRAWS, 6))
    wrench[:, PLATFORM_TASK] = f
    # The torques that do no work on any motion; W3 and what torques are to stay near, of each use.
    direction, weights = kin.active_constraint[0], np.ones((4, 4)) + (HOT - 1) * np.eye(4)
    uses = {f"motor {k + 1} hot": (k, weights[k], np.zeros(4)) for k in range(4)}
    uses |= {"squeezed": (None, np.ones(4), SQUEEZE_N * np.sign(direction))}
    rows, arrays = [], dict[str, Array]()
    for name, (hot, W3, desired) in uses.items():
        ways = {
            "without": force_mapping(kin.J, PLATFORM_MAJOR, torque_weight=W3),
            "used": kin.force_mapping(PLATFORM_MAJOR, torque_weight=W3),
        }
        torques = {way: mapping(f, torque=desired) for way, mapping in ways.items()}
        weighed_n = {w: np.linalg.norm((x - desired) * W3, axis=1) for w, x in torques.items()}
        arrays |= prefixed(f"platform {name}", {"wrench": wrench})
        for way, own in torques.items():
            predicted = closure_forces(system, kin, f, own)
            pressed = exert(model, (), own, task=PLATFORM_TASK)
            legs, fixture = pressed.strut_n[:, -1], pressed.fixture[:, -1]
            squeeze_n = (legs * np.sign(desired)).min()
            rows.append(
                {
                    "name": name,
                    "internal_force": way,
                    "weighed_rms_n": rms(weighed_n[way]),
                    "saved_at_least_n": (weighed_n["without"] - weighed_n[way]).min(),
                    "hot_motor_rms_n": None if hot is None else rms(own[:, hot]),
                    "least_squeeze_n": squeeze_n if hot is None else None,
                    "internal_rms_n": rms(predicted @ direction),
                    "internal_simulated_rms_n": rms(legs @ direction),
                    "wrench_off_percent": percent(fixture - wrench, wrench),
                    "legs_off_percent": off_percent(legs, predicted),
                }
            )
            found = {"torques_n": own, "legs_n": predicted} | pressed._asdict()
            arrays |= prefixed(f"platform {name} {way}", found)
    return {"internal_force": rows}, arrays


# The study.


def force(
    *,
    seed: Annotated[int, seed_of("the directions of all forces")] = 0,
    quick: Annotated[bool, Option(help="Only strut 1 fails.")] = False,
    on_progress: OnProgress,
) -> Result:
    """Simulate static forces commanded by the force mapping.

    Tests Theorems 7, 8 and 9 on the hexapod without failure, with a locked and with a free strut:
    it presses against a fixed environment, or holds a prescribed wrench. A platform on four legs
    tests the internal force. 35 s on two cores, 12 s with --quick.

    Writes force.json, its tables as force.md and Parquet, a figure, and all commanded and measured
    forces (force.npz).

    Example: fjh paper force --quick --quiet
    """
    rng = np.random.default_rng(seed)
    asked = draw(rng, DRAWS)
    parts = [trade(asked[0, MAJOR], rng), use_internal_force(rng)]
    kinds: tuple[FailureKind, ...] = ("locked", "free", "loose")
    struts = range(1 if quick else 6)
    conditions = [Condition(), *(Condition(kind, k) for kind in kinds for k in struts)]
    calls = [{"condition": c, "system": known_system(c), "asked": asked} for c in conditions]
    rows, arrays = joined([*in_parallel(examine, calls, on_progress), *parts])
    tables = {name: pd.DataFrame(each) for name, each in rows.items()}
    drawn = partial(figure, tables["tradeoff"], tables["internal_force"])
    return Result(
        settings=origin(seed, platform=PLATFORM_MJCF)
        | {
            "bench": plant_constants(load_model()),
            "asked_major_n_m": asked[:, MAJOR],
            "asked_secondary_n_and_n_m": asked.take(SECONDARY, axis=1),
            "data": "force.npz",
        },
        tables=tables,
        checks=checks(tables),
        views=shown(tables),
        pictures=[Picture("force", CAPTION, ALT, drawn)],
        arrays={"force.npz": {"asked_wrench": asked} | arrays},
    )


def checks(tables: dict[str, pd.DataFrame]) -> list[Check]:
    """Forces and motions against the prediction, and the cost against that of other torques."""
    trials, uses = tables["theorems"], tables["internal_force"]
    trials = trials.set_index(["condition", "theorem " + trials.theorem.astype(str)])
    # Clamped, a lock and the fixture share what no torque sees: no major force is claimed.
    claimed = trials[trials.kind != "locked"].pressed_major_off_percent
    first = tables["prescribed"].query("load == 1").set_index(["condition", "mapping"])
    uses = uses.set_index(["name", "internal force " + uses.internal_force])
    torques = tables["tradeoff"].set_index("way")
    exact = torques.drop("pseudo_inverse").major_off_percent
    least = torques.weighed_over_mapping["others"].min(skipna=False)
    off = "difference between {} and the prediction [%]".format
    what = "weighted torque divided by the least of other torques with this major force"
    more = "weighted torque with internal force minus that without [N]"
    return [
        *check("closure residual [m]", trials.closure_residual_max_m, CLOSURE_LIMIT_M),
        *check("status other than exact", 1.0 - trials.exact, 0.5),
        *check("relative excess over the minimum cost", trials.cost_excess, COST_EXCESS),
        *check(off("the wrench on the fixture"), trials.pressed_off_percent, OFF_PERCENT),
        *check(off("the strut forces"), trials.held_off_percent, OFF_PERCENT),
        *check(off("the payload's position"), trials.moved_percent, OFF_PERCENT),
        *check(off("the major force"), claimed, OFF_PERCENT),
        *check(off("the payload's position"), first.off_percent, OFF_PERCENT, "prescribed wrench"),
        *check(what, 1 / least, 1.0, "mapping"),
        *check(off("the major force"), exact, OFF_PERCENT),
        *check(more, -uses.saved_at_least_n, ROUND_OFF_N, "platform"),
        *check(off("the wrench on the fixture"), uses.wrench_off_percent, OFF_PERCENT, "platform"),
        *check(off("the leg forces"), uses.legs_off_percent, OFF_PERCENT, "platform"),
    ]


def shown(tables: dict[str, pd.DataFrame]) -> list[TableView]:
    """The printed tables."""
    trials, held = tables["theorems"], tables["prescribed"].query("load == 1")
    major = trials.pressed_major_off_percent.where(trials.kind != "locked")
    trials = trials.assign(major_percent=major).groupby("condition", sort=False, as_index=False)
    torques = tables["tradeoff"].groupby(["way", "major_weight_per_n_m"], dropna=False)
    torque = torques.weighed_over_mapping
    return [
        TableView(
            "Theorems 7, 8, 9: largest error of the simulation",
            trials.max().rename(columns=lambda name: name.replace("_off", "")),
            "condition major_percent:.2g pressed_percent:.2g held_percent:.2g moved_percent:.2g",
            "major, pressed: on a fixture. held, moved: strut forces, payload, holding a wrench.",
        ),
        TableView(
            "First prescribed wrench, and how the payload gives way",
            held.rename(columns=lambda name: name.removeprefix("simulated_")),
            "condition mapping lacking_force_n:.2f translation_um:.2f pointing_urad:.2f",
            "lacking: what is not exerted. translation, pointing: simulated.",
        ),
        TableView(
            "First prescribed wrench, reaction of the lock",
            tables["reaction"].query("load == 1 and theorem == @PRESCRIBED"),
            "condition simulated_n:.2f predicted_n:.2f",
        ),
        TableView(
            "One major force, hexapod without failure: weighted torque over the mapping's",
            torques.max().assign(least=torque.min(), largest=torque.max()).reset_index(),
            "way major_weight_per_n_m:g least:.3f largest:.3f major_off_percent:.3g",
        ),
        TableView(
            "Over-actuated platform, without internal force and with it used",
            tables["internal_force"],
            "name internal_force weighed_rms_n:.1f hot_motor_rms_n:.1f least_squeeze_n:.1f",
            f"weighed: norm of the torques, the hot motor's {HOT:g} times.",
        ),
    ]


CAPTION = (
    "Left: the hexapod without failure exerts one moment on a fixture; weighted pseudo-inverses "
    "give it up for less torque. Right: a platform of four legs presses with the same wrenches, "
    "one motor three times as costly as the others."
)
ALT = (
    "Left: the force mapping alone has the least torque and no error, and pseudo-inverses fall "
    "towards it. Right: with internal force the hot motor has a third of its force."
)


def figure(tradeoff: pd.DataFrame, internal_force: pd.DataFrame) -> Figure:
    """Torque against error of the moment; and the force of a hot motor. Blue: the library's."""
    figure = new_figure(PAGE_IN, 3.0)
    left, right = figure.subplots(1, 2)
    for way, marker, color, size in (
        ("others", ".", BLACK, 4),
        ("pseudo_inverse", "s-", VERMILION, 4),
        ("mapping", "*", BLUE, 9),
    ):
        tried = tradeoff[tradeoff.way == way]
        line = left.semilogy(tried.weighed_over_mapping, tried.major_off_percent, marker)[0]
        line.set(color=color, markersize=size, label=way.replace("_", "-"))
    left.set_title("The mapping exerts the moment with the least torque")
    left.set_xlabel("weighted torque, relative to the mapping's")
    left.set_ylabel("error of the moment, %")
    hot = internal_force.dropna(subset="hot_motor_rms_n").groupby("internal_force")
    for way, place, color in (("without", -0.2, PURPLE), ("used", 0.2, BLUE)):
        motors = hot.get_group(way)
        bars = right.bar(np.arange(len(motors)) + place, motors.hot_motor_rms_n, 0.4, color=color)
        right.set_xticks(range(len(motors)), list(motors.name))
        bars.set_label(f"internal force: {way}")
    right.set_title("Internal force relieves a hot motor")
    right.set_ylabel("force of the hot motor, RMS, N")
    one_legend(figure, 5)
    return figure
