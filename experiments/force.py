"""Study `force`: static forces commanded by the force mapping; docs/force.md."""

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
from prioritized import ConstrainedSystem, Kinematics, Status, canonical_basis, force_mapping
from sim import HEXAPOD_MJCF, NOMINAL, Array, Failure, Plant, jacobians, load_model
from sim.mjcf import weightless
from sim.plant import FailureKind, failed_plant

# Sizes of the commanded wrenches: the major moment, the secondary force, and (at most) the moment
# about z_b. Together they take up to some 20 N of a coil, which has 80.
SAMPLES, MAJOR_N_M, FORCE_N, TWIST_N_M = 4, 3.0, 20.0, 2.0
# W3 [1]/[N]: struts 1, 3 and 5 are hot, as under the paper's W_b. With W3 = I there would be no
# trade-off: in the orthogonal hexapod the torque of least norm exerts no secondary force.
W3_HOT = (2.0, 1.0, 2.0, 1.0, 2.0, 1.0)
# W4 of [f_x, f_y, f_z, m_z]: a moment counts as its force at the nodes, at 0.33 m.
W4_LEVER = (1.0, 1.0, 1.0, 3.0)

Weights = tuple[Sequence[float] | None, Sequence[float] | None]
GOALS: dict[int, Weights] = {7: (W3_HOT, W4_LEVER), 8: (W3_HOT, None), 9: (None, W4_LEVER)}
"""Diagonals of W3 and W4 in Problem 6, by number of the theorem that solves it; None: zero."""
WITHOUT_W4, PRESCRIBED = 8, 9

OTHER_TORQUES = 60  # torques of the same major force, at random
MAJOR_WEIGHTS = (0.3, 1.0, 3.0, 10.0, 30.0, 100.0)  # of the weighted pseudo-inverse, [1]/[N m]

# The platform has four legs, one more than necessary. Its whole task is prescribed: with torques
# J^T f, eq. (22), only the internal force is free.
PLATFORM_MJCF = HEXAPOD_MJCF.with_name("platform.xml")
PLATFORM_TASK, PLATFORM_MAJOR = (2, 3, 4), (0, 1, 2)
PLATFORM_N_M, PLATFORM_N = 1.0, 15.0  # largest moment and size of the force: up to 9.2 N a leg
HOT, SQUEEZE_N = 3.0, 30.0  # weight of a hot motor, others 1; bias that closes a leg's backlash

# Clamped, only the closures move; else the softest mode, 31.6 Hz, decays to 3e-5.
FIXTURE, SAMPLE_S, OFFSET_S, PRESS_S, LOAD_S = "fixture", 0.01, 0.05, 0.05, 0.6
LIMIT, COST_EXCESS, ROUND_OFF_N = 1.0, 1e-9, 1e-9  # limits of the checks, the first one in %


@dataclass(frozen=True)
class Condition:
    """Failure condition with one failed strut 0..5, or none if `kind` is None."""

    kind: FailureKind | None = None
    strut: int = 0

    def __str__(self) -> str:
        return "healthy" if self.kind is None else f"strut {self.strut + 1} {self.kind}"

    @property
    def failures(self) -> tuple[Failure, ...]:
        """Failures of the plant."""
        return () if self.kind is None else (Failure(self.strut, self.kind),)


def failed_system(condition: Condition) -> ConstrainedSystem:
    """Return the failed hexapod as a rigid mechanism, without suspension springs."""
    struts = [] if condition.kind is None else [condition.strut]
    failed = {"locked" if condition.kind == "locked" else "free": struts}
    return healthy_system(HEXAPOD_MJCF, range(6)).with_failures(**failed)


def healthy_system(path: Path, task: Sequence[int]) -> ConstrainedSystem:
    """Return a healthy rigid machine, without fixture, with the given task rows."""
    model = load_model(path)
    jac = jacobians(model, mujoco.MjData(model), site="payload", axes="base")
    return ConstrainedSystem(jac.J_T[list(task)], jac.J_C, jac.active)


# A mechanism with external loads, and gauges that are independent of the force mapping.


def with_fixture(path: Path) -> mujoco.MjModel:
    """Return the machine of an MJCF file with a fixture, an inactive weld of its payload.

    The weld acts in both directions, unlike a contact, and is as stiff as the closures.
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
    """Gauges for the forces of closures, locks and fixture in MuJoCo, near the nominal pose."""

    def __init__(self, plant: Plant, task: Sequence[int] = range(6)) -> None:
        """Prepare to measure the fixture's wrench in these rows of the payload twist."""
        model = copy.copy(plant.model)
        model.opt.disableactuator = 0  # struts without coil have gauges, too
        healthy = jacobians(model, mujoco.MjData(model), site="payload", axes="base")
        self._plant, self._task = plant, list(task)
        self._J_T, self._active = healthy.J_T[self._task], healthy.active

    def read(self) -> Array:
        """Return fixture wrench (6,), forces of struts and of locks (n,), payload motion (6,)."""
        joints, wrench = range(len(self._active)), np.zeros(6)
        # J_T^T maps the fixture's wrench to the joints; the sign is that of the mechanism on it.
        wrench[self._task] = -np.linalg.lstsq(self._J_T.T, self._on_joints(FIXTURE))[0]
        strut = [-self._on_joints(f"closure{k + 1}")[self._active[k]] for k in joints]
        lock = [self._on_joints(f"lock{k + 1}")[self._active[k]] for k in joints]
        return np.concatenate([wrench, strut, lock, self._plant.displacement()])

    def _on_joints(self, equality: str) -> Array:
        """Return the generalized forces of one equality, shape (nv,)."""
        model, data = self._plant.model, self._plant.data
        rows = data.efc_type == int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)
        rows &= data.efc_id == model.equality(equality).id
        force = np.zeros(model.nv)
        mujoco.mj_mulJacTVec(model, data, force, np.where(rows, data.efc_force, 0.0))
        return force


class Readings(NamedTuple):
    """Readings of the gauges under L loads, relative to those before the first load.

    Each load lasts S samples; at the last one the machine is at rest.
    """

    fixture: Array  # wrench [moment; force] exerted on it, (L, S, 6)
    strut_n: Array  # force of each closure along its actuated joint, (L, S, n)
    lock_n: Array  # of each lock on its joint, (L, S, n)
    displacement: Array  # of the payload, [rotation; translation], (L, S, 6), [rad] and [m]
    closure_residual_m: Array  # largest gap of a loop or of the fixture, absolute, (L, S)


def simulate_load(
    model: mujoco.MjModel,
    failures: Sequence[Failure],
    torques: Array,
    wrenches: Array | None = None,
    task: Sequence[int] = range(6),
) -> Readings:
    """Simulate torques (L, n) [N] that press on the fixture or balance external wrenches.

    Args:
        model: Model of :func:`with_fixture`.
        failures: Failures of its actuators.
        torques: Torques of all actuators, a load in each row.
        wrenches: Wrenches (L, 6) in base axes that the mechanism exerts on the world, without a
            fixture.
        task: Rows of the payload twist that the mechanism can move.

    Raises:
        sim.SimulationDiverged: The state is not finite.
    """
    plant, (L, n) = failed_plant(model, failures), torques.shape
    plant.data.eq_active[model.equality(FIXTURE).id] = wrenches is None
    gauges, steps = Gauges(plant, task), round((PRESS_S if wrenches is None else LOAD_S) / SAMPLE_S)
    plant.settle(OFFSET_S)
    before, samples_read, gaps = gauges.read(), [], []
    # At rest at zero an actuator exerts gain * command.
    commands = torques / plant.model.actuator_gainprm[:, 0]
    pushes = np.zeros((L, 6)) if wrenches is None else -wrenches
    for command, push in zip(commands, pushes, strict=True):
        plant.push(push)
        for _ in range(steps):
            plant.step(command, SAMPLE_S)
            samples_read.append(gauges.read() - before)
            gaps.append(plant.closure_residual_m())
    series = np.array(samples_read).reshape(L, steps, -1)
    fixture, strut_n, lock_n, displacement = np.split(series, [6, 6 + n, 6 + 2 * n], axis=-1)
    return Readings(fixture, strut_n, lock_n, displacement, np.array(gaps).reshape(L, steps))


# Rows by table, and the arrays from which they are computed.

Part = tuple[dict[str, list[dict[str, Any]]], dict[str, Array]]


def merged(parts: Sequence[Part]) -> Part:
    """Merge the rows of each table, and all arrays."""
    rows, arrays = dict[str, list[dict[str, Any]]](), dict[str, Array]()
    for part_rows, part_arrays in parts:
        arrays |= part_arrays
        for name, new_rows in part_rows.items():
            rows.setdefault(name, []).extend(new_rows)
    return rows, arrays


def prefixed(where: str, arrays: dict[str, Array]) -> dict[str, Array]:
    """Return arrays with a prefix before their names, as in the `.npz`."""
    return {f"{where} {name}".replace(" ", "_"): values for name, values in arrays.items()}


def difference_percent(simulated: Array, expected: Array) -> float:
    """Return the norm of the difference of all rows, relative to the expected ones [%]."""
    return 100 * float(np.linalg.norm(simulated - expected) / np.linalg.norm(expected))


# Problem 6, and its minimum from eqs. (8) and (9) without elimination: independent of the library's
# elimination, mapping and rank decision.


def sample_wrenches(rng: np.random.Generator, count: int) -> Array:
    """Sample wrenches [moment; force] in random directions, shape (count, 6)."""
    angle = rng.uniform(0, 2 * np.pi, count)
    force = rng.normal(size=(count, 3))
    force *= FORCE_N / np.linalg.norm(force, axis=1, keepdims=True)
    twist = rng.uniform(-TWIST_N_M, TWIST_N_M, count)
    return np.column_stack([MAJOR_N_M * np.cos(angle), MAJOR_N_M * np.sin(angle), twist, force])


def equilibrium_set(system: ConstrainedSystem, major: Array) -> tuple[Array, Array]:
    """Return all [torques; secondary force] of a failed mechanism that exert major forces (D, 2).

    The set is a solution for each major force (D, 10), plus combinations of a basis (10, d).
    """
    balance = np.vstack([system.J_T, system.J_C]).T  # velocities x [f; f_C]
    failed = sorted(system.failures.locked | system.failures.free)
    # A lock bears any force on its joint, every other passive joint none.
    driven = np.delete(system.active, failed)
    unloaded = np.setdiff1d(np.arange(len(balance)), [*driven, *system.stuck])
    to_f = np.eye(6, balance.shape[1])
    conditions = np.vstack([balance[unloaded], to_f[MAJOR]])
    targets = np.hstack([np.zeros((len(major), len(unloaded))), major])
    outputs = np.vstack([balance[system.active], to_f[SECONDARY]])
    outputs[failed] = 0.0
    start = outputs @ np.linalg.lstsq(conditions, targets.T)[0]
    return start.T, outputs @ scipy.linalg.null_space(conditions)


def least_cost(weight: Array, possible: tuple[Array, Array], desired: Array) -> Array:
    """Return the minimum of |weight ([torques; f_s] - desired)|^2 over all equilibria, (D,)."""
    start, free = possible
    A, off = weight[:, None] * free, (weight * (start - desired)).T
    return ((A @ np.linalg.lstsq(A, -off)[0] + off) ** 2).sum(axis=0)


def closure_forces(system: ConstrainedSystem, kin: Kinematics, f: Array, torques: Array) -> Array:
    """Return the closures' forces along actuated joints, eqs. (5) and (11)."""
    f_C = kin.constraint_force(f, torques)[:, : len(system.J_C)]  # after these, the locks'
    return (f_C @ system.J_C)[:, system.active]


# The healthy hexapod, and with a failed strut: it presses on the fixture, and balances wrenches.


class Solution(NamedTuple):
    """Solution of the mapping for D commanded wrenches [moment; force]."""

    exact: bool  # whether the status is exact
    torques: Array  # of the coils, (D, 6), [N]; zero at failed struts
    wrench: Array  # exerted by these torques, (D, 6)
    strut: Array  # forces of the closures, eq. (11), at locks their reaction, (D, 6), [N]
    span: Array  # orthogonal projector on the wrenches that the actuators span, (6, 6)
    cost_excess: Array  # over the minimum, relative to the cost of torques and target, (D,)


def solve_theorem(system: ConstrainedSystem, theorem: int, targets: Array) -> Solution:
    """Solve Problem 6 with the weights of a theorem for commanded wrenches (D, 6)."""
    kin, (W3, W4) = system.kinematics(), GOALS[theorem]
    weight = np.concatenate([np.zeros(6) if W3 is None else W3, np.zeros(4) if W4 is None else W4])
    major, desired = targets.take(MAJOR, axis=1), targets.take(SECONDARY, axis=1)
    mapping = kin.force_mapping(MAJOR, SECONDARY, W3, W4)
    survivors, wrench = mapping(major, secondary_force=desired), np.empty_like(targets)
    secondary = mapping.secondary_force(major, secondary_force=desired)
    wrench[:, MAJOR], wrench[:, SECONDARY] = major - mapping.residual(major), secondary
    torques = kin.expand(survivors)
    target = np.hstack([np.zeros_like(torques), desired])
    cost = ((weight * (np.hstack([torques, secondary]) - target)) ** 2).sum(axis=1)
    total = ((weight * np.hstack([torques, desired])) ** 2).sum(axis=1)
    return Solution(
        exact=mapping.status is Status.EXACT,
        torques=torques,
        wrench=wrench,
        strut=closure_forces(system, kin, wrench, survivors),
        span=np.eye(6) - mapping.reaction,
        cost_excess=(cost - least_cost(weight, equilibrium_set(system, major), target)) / total,
    )


def simulate_condition(condition: Condition, system: ConstrainedSystem, targets: Array) -> Part:
    """Simulate commanded wrenches (D, 6) on the fixture and against loads, with a known failure.

    A strut that loses its spring also loses the preload that carries the weight. It is simulated
    without gravity, and without prescribed wrenches, which no spring would balance.
    """
    model = with_fixture(HEXAPOD_MJCF)
    if condition.kind == "loose":
        model = weightless(model)
    solutions = {theorem: solve_theorem(system, theorem, targets) for theorem in GOALS}
    parts = [_press(condition, model, targets, *pair) for pair in solutions.items()]
    if condition.kind == "loose":
        return merged(parts)
    torques = {"rigid": solutions[PRESCRIBED].torques}
    if released := system.failures.free:
        kin = elastic_system(load_model()).with_failures(free=released).kinematics()
        mapping = kin.force_mapping(MAJOR, SECONDARY, secondary_weight=W4_LEVER)
        goals = targets.take(SECONDARY, axis=1)
        torques["elastic"] = kin.expand(mapping(targets[:, MAJOR], secondary_force=goals))
    locked = sorted(system.failures.locked)
    return merged([*parts, *(_load(condition, locked, targets, *pair) for pair in torques.items())])


def _press(
    condition: Condition, model: mujoco.MjModel, targets: Array, theorem: int, solution: Solution
) -> Part:
    """Simulate a solution on the fixture, and without fixture against the wrench that it exerts."""
    pressed = simulate_load(model, condition.failures, solution.torques)
    loaded = simulate_load(model, condition.failures, solution.torques, solution.wrench)
    fixture = pressed.fixture[:, -1]
    deviation = (fixture - solution.wrench) @ solution.span
    # Displacement of the payload if the springs alone balanced the load.
    springs_alone = np.linalg.solve(payload_stiffness(load_model()), solution.wrench.T).T
    row = {
        "condition": str(condition),
        "kind": condition.kind,
        "theorem": theorem,
        "exact": solution.exact,
        "cost_excess": solution.cost_excess.max(),
        "torque_peak_n": np.abs(solution.torques).max(),
        "pressed_off_percent": percent(deviation, solution.wrench),
        "pressed_major_off_percent": difference_percent(fixture[:, MAJOR], targets[:, MAJOR]),
        "held_off_percent": difference_percent(loaded.strut_n[:, -1], solution.strut),
        "moved_percent": percent(loaded.displacement[:, -1], springs_alone),
        "closure_residual_max_m": max(x.closure_residual_m.max() for x in (pressed, loaded)),
    }
    columns = {
        "condition": str(condition),
        "theorem": theorem,
        "load": np.arange(len(targets)) + 1,
        "predicted_n": solution.strut[:, condition.strut],
        "simulated_n": loaded.lock_n[:, -1, condition.strut],
        "simulated_pressed_n": pressed.lock_n[:, -1, condition.strut],
    }
    reaction = pd.DataFrame(columns).to_dict("records") if condition.kind == "locked" else []
    arrays = {"torques_n": solution.torques, "wrench": solution.wrench, "strut_n": solution.strut}
    arrays |= prefixed("pressed", pressed._asdict()) | prefixed("held", loaded._asdict())
    where = f"{condition} theorem {theorem}"
    return {"theorems": [row], "reaction": reaction}, prefixed(where, arrays)


def _load(
    condition: Condition, locked: Sequence[int], targets: Array, mapping: str, torques: Array
) -> Part:
    """Simulate prescribed wrenches against the torques of a mapping, with these struts locked.

    In the rigid mapping a free strut bears no force, eq. (9); in the elastic mapping its spring
    does.
    """
    model = load_model()
    A, K = hexapod(model).inverse_jacobian(NOMINAL), payload_stiffness(model)
    # A lock leaves five directions of motion, and bears forces in the sixth.
    Z = scipy.linalg.null_space(A[locked]) if locked else np.eye(6)
    compliance = Z @ np.linalg.inv(Z.T @ K @ Z) @ Z.T
    loaded = simulate_load(with_fixture(HEXAPOD_MJCF), condition.failures, torques, targets)
    missing, simulated = targets - torques @ A, loaded.displacement[:, -1]
    missing_task, predicted = missing @ Z @ Z.T, -missing @ compliance
    sizes = {
        "lacking_force_n": missing_task[:, 3:],
        "lacking_major_n_m": missing_task[:, MAJOR],
        "predicted_pointing_urad": 1e6 * predicted[:, MAJOR],
        "predicted_translation_um": 1e6 * predicted[:, 3:],
        "simulated_pointing_urad": 1e6 * simulated[:, MAJOR],
        "simulated_translation_um": 1e6 * simulated[:, 3:],
    }
    columns = {
        "condition": str(condition),
        "mapping": mapping,
        # -targets @ compliance is the displacement if the springs balanced the whole wrench.
        "off_percent": percent(simulated - predicted, targets @ compliance),
        "load": np.arange(len(targets)) + 1,
        **{name: np.linalg.norm(vectors, axis=1) for name, vectors in sizes.items()},
    }
    arrays = {"torques_n": torques, "predicted": predicted} | loaded._asdict()
    rows = pd.DataFrame(columns).to_dict("records")
    return {"prescribed": rows}, prefixed(f"{condition} prescribed {mapping}", arrays)


def payload_stiffness(model: mujoco.MjModel) -> Array:
    """Return the stiffness K of all springs for payload displacements in base axes, (6, 6)."""
    of_struts_and_payload = strut_and_payload_stiffness(model)
    A = hexapod(model).inverse_jacobian(NOMINAL)
    return A.T @ of_struts_and_payload[:6, :6] @ A + of_struts_and_payload[6:, 6:]


# The optimum compared with other torques on the same fixture.


def compare_torques(moment: Array, rng: np.random.Generator) -> Part:
    """Compare torques of the mapping, random ones and pseudo-inverses for a moment (2,)."""
    model, system = with_fixture(HEXAPOD_MJCF), failed_system(Condition())
    kin, W3 = system.kinematics(), np.array(W3_HOT)
    best = kin.expand(kin.force_mapping(MAJOR, SECONDARY, *GOALS[WITHOUT_W4])(moment[None]))
    directions = canonical_basis(scipy.linalg.orth(equilibrium_set(system, moment[None])[1][:6]))
    offsets = rng.normal(size=(OTHER_TORQUES, directions.shape[1])) @ directions.T
    size = np.linalg.norm(best) * rng.uniform(0.05, 1.0, (OTHER_TORQUES, 1))
    offsets *= size / np.linalg.norm(offsets, axis=1, keepdims=True)
    # Least squares over f with a weight of the major rows: [f_m; torques] = [I_m; J^T] f.
    rows_of_f = np.vstack([np.eye(6)[MAJOR], kin.J.T])
    compromises = [
        weighted_pseudo_inverse(rows_of_f, [0, 1], range(2, 8), w, secondary_weight=W3)(moment)
        for w in MAJOR_WEIGHTS
    ]
    methods = {
        "mapping": (best, [None]),
        "others": (best + offsets, [None] * OTHER_TORQUES),
        "pseudo_inverse": (np.array([kin.J.T @ f for f in compromises]), MAJOR_WEIGHTS),
    }
    least, rows, arrays = float(np.linalg.norm(best * W3)), [], dict[str, Array]()
    for method, (torques, weights) in methods.items():
        at_rest = simulate_load(model, (), torques).fixture[:, -1]
        error = np.linalg.norm(at_rest[:, MAJOR] - moment, axis=1) / np.linalg.norm(moment)
        weighed_n = np.linalg.norm(torques * W3, axis=1)
        columns = {
            "way": method,
            "major_weight_per_n_m": weights,
            "weighed_torque_n": weighed_n,
            "weighed_over_mapping": weighed_n / least,
            "major_off_percent": 100 * error,
        }
        rows += pd.DataFrame(columns).to_dict("records")
        arrays_of_method = {"torques": torques, "weighed": weighed_n, "major_off": error}
        arrays |= prefixed(f"tradeoff {method}", arrays_of_method)
    return {"tradeoff": rows}, arrays


# A platform on four legs, one more than necessary, which has an internal force.


def simulate_internal_force(rng: np.random.Generator) -> Part:
    """Simulate internal force of a platform that presses on the fixture.

    Torques are J^T f, as in the paper, and J^T f + C^T eta, which relieves a motor or squeezes.
    """
    model, system = with_fixture(PLATFORM_MJCF), healthy_system(PLATFORM_MJCF, PLATFORM_TASK)
    kin = system.kinematics()
    angle = rng.uniform(0, 2 * np.pi, SAMPLES)
    moment = rng.uniform(-PLATFORM_N_M, PLATFORM_N_M, SAMPLES)
    f = np.column_stack([moment, PLATFORM_N * np.cos(angle), PLATFORM_N * np.sin(angle)])
    wrench = np.zeros((SAMPLES, 6))
    wrench[:, PLATFORM_TASK] = f
    # The torques that do no work in any motion; W3 and desired torques of each case.
    direction, weights = kin.active_constraint[0], np.ones((4, 4)) + (HOT - 1) * np.eye(4)
    cases = {f"motor {k + 1} hot": (k, weights[k], np.zeros(4)) for k in range(4)}
    cases |= {"squeezed": (None, np.ones(4), SQUEEZE_N * np.sign(direction))}
    rows, arrays = [], dict[str, Array]()
    for name, (hot, W3, desired) in cases.items():
        mappings = {
            "without": force_mapping(kin.J, PLATFORM_MAJOR, torque_weight=W3),
            "used": kin.force_mapping(PLATFORM_MAJOR, torque_weight=W3),
        }
        torques = {method: mapping(f, torque=desired) for method, mapping in mappings.items()}
        weighed_n = {w: np.linalg.norm((x - desired) * W3, axis=1) for w, x in torques.items()}
        arrays |= prefixed(f"platform {name}", {"wrench": wrench})
        for method, torques_n in torques.items():
            predicted = closure_forces(system, kin, f, torques_n)
            pressed = simulate_load(model, (), torques_n, task=PLATFORM_TASK)
            legs, fixture = pressed.strut_n[:, -1], pressed.fixture[:, -1]
            squeeze_n = (legs * np.sign(desired)).min()
            rows.append(
                {
                    "name": name,
                    "internal_force": method,
                    "weighed_rms_n": rms(weighed_n[method]),
                    "saved_at_least_n": (weighed_n["without"] - weighed_n[method]).min(),
                    "hot_motor_rms_n": None if hot is None else rms(torques_n[:, hot]),
                    "least_squeeze_n": squeeze_n if hot is None else None,
                    "internal_rms_n": rms(predicted @ direction),
                    "internal_simulated_rms_n": rms(legs @ direction),
                    "wrench_off_percent": percent(fixture - wrench, wrench),
                    "legs_off_percent": difference_percent(legs, predicted),
                }
            )
            arrays_of_case = {"torques_n": torques_n, "legs_n": predicted} | pressed._asdict()
            arrays |= prefixed(f"platform {name} {method}", arrays_of_case)
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
    it presses against a fixed environment, or balances a prescribed wrench. A platform on four legs
    tests the internal force. Takes 35 s on two cores, 12 s with --quick.

    Writes force.json, its tables as force.md and Parquet, a figure, and all commanded and measured
    forces (force.npz).

    Example: fjh paper force --quick --quiet
    """
    rng = np.random.default_rng(seed)
    wrenches = sample_wrenches(rng, SAMPLES)
    parts = [compare_torques(wrenches[0, MAJOR], rng), simulate_internal_force(rng)]
    kinds: tuple[FailureKind, ...] = ("locked", "free", "loose")
    struts = range(1 if quick else 6)
    conditions = [Condition(), *(Condition(kind, k) for kind in kinds for k in struts)]
    calls = [{"condition": c, "system": failed_system(c), "targets": wrenches} for c in conditions]
    rows, arrays = merged([*in_parallel(simulate_condition, calls, on_progress), *parts])
    tables = {name: pd.DataFrame(table_rows) for name, table_rows in rows.items()}
    plot = partial(figure, tables["tradeoff"], tables["internal_force"])
    return Result(
        settings=origin(seed, platform=PLATFORM_MJCF)
        | {
            "bench": plant_constants(load_model()),
            "asked_major_n_m": wrenches[:, MAJOR],
            "asked_secondary_n_and_n_m": wrenches.take(SECONDARY, axis=1),
            "data": "force.npz",
        },
        tables=tables,
        checks=checks(tables),
        views=printed_tables(tables),
        pictures=[Picture("force", CAPTION, ALT, plot)],
        arrays={"force.npz": {"asked_wrench": wrenches} | arrays},
    )


def checks(tables: dict[str, pd.DataFrame]) -> list[Check]:
    """Return checks of forces, motions and costs against predictions and other torques."""
    theorems, uses = tables["theorems"], tables["internal_force"]
    theorems = theorems.set_index(["condition", "theorem " + theorems.theorem.astype(str)])
    # Clamped, a lock and the fixture share a wrench that no torque affects: not compared.
    claimed = theorems[theorems.kind != "locked"].pressed_major_off_percent
    first = tables["prescribed"].query("load == 1").set_index(["condition", "mapping"])
    uses = uses.set_index(["name", "internal force " + uses.internal_force])
    torques = tables["tradeoff"].set_index("way")
    exact = torques.drop("pseudo_inverse").major_off_percent
    least = torques.weighed_over_mapping["others"].min(skipna=False)
    off = "difference between {} and the prediction [%]".format
    what = "weighted torque divided by the least of other torques with this major force"
    more = "weighted torque with internal force minus that without [N]"
    return [
        *check("closure residual [m]", theorems.closure_residual_max_m, CLOSURE_LIMIT_M),
        *check("status other than exact", 1.0 - theorems.exact, 0.5),
        *check("relative excess over the minimum cost", theorems.cost_excess, COST_EXCESS),
        *check(off("the wrench on the fixture"), theorems.pressed_off_percent, LIMIT),
        *check(off("the strut forces"), theorems.held_off_percent, LIMIT),
        *check(off("the payload's position"), theorems.moved_percent, LIMIT),
        *check(off("the major force"), claimed, LIMIT),
        *check(off("the payload's position"), first.off_percent, LIMIT, "prescribed wrench"),
        *check(what, 1 / least, 1.0, "mapping"),
        *check(off("the major force"), exact, LIMIT),
        *check(more, -uses.saved_at_least_n, ROUND_OFF_N, "platform"),
        *check(off("the wrench on the fixture"), uses.wrench_off_percent, LIMIT, "platform"),
        *check(off("the leg forces"), uses.legs_off_percent, LIMIT, "platform"),
    ]


def printed_tables(tables: dict[str, pd.DataFrame]) -> list[TableView]:
    """Return the printed tables."""
    theorems, loads = tables["theorems"], tables["prescribed"].query("load == 1")
    major = theorems.pressed_major_off_percent.where(theorems.kind != "locked")
    theorems = theorems.assign(major_percent=major).groupby("condition", sort=False, as_index=False)
    torques = tables["tradeoff"].groupby(["way", "major_weight_per_n_m"], dropna=False)
    torque = torques.weighed_over_mapping
    return [
        TableView(
            "Theorems 7, 8, 9: largest difference between simulation and prediction",
            theorems.max(),
            "condition major_percent=major_force_percent:.2g "
            "pressed_off_percent=wrench_percent:.2g held_off_percent=strut_forces_percent:.2g "
            "moved_percent=position_percent:.2g",
            "Major force and wrench: on a fixture. Strut forces and position: under a load.",
        ),
        TableView(
            "First prescribed wrench, and displacement of the payload",
            loads,
            "condition mapping lacking_force_n=missing_force_n:.2f "
            "simulated_translation_um=translation_um:.2f simulated_pointing_urad=pointing_urad:.2f",
        ),
        TableView(
            "First prescribed wrench, reaction of the lock",
            tables["reaction"].query("load == 1 and theorem == @PRESCRIBED"),
            "condition simulated_n:.2f predicted_n:.2f",
        ),
        TableView(
            "One major force, hexapod without failure: weighted torque over the mapping's",
            torques.max().assign(least=torque.min(), largest=torque.max()).reset_index(),
            "way=method least:.3f largest:.3f major_off_percent=error_of_force_percent:.3g "
            "major_weight_per_n_m=major_weight:g",
        ),
        TableView(
            "Over-actuated platform, without internal force and with it used",
            tables["internal_force"],
            "name internal_force weighed_rms_n=weighted_norm_n:.1f "
            "hot_motor_rms_n=hot_motor_n:.1f least_squeeze_n:.1f",
            f"Weighted norm of the torques: {HOT:g} times that of the hot motor.",
        ),
    ]


CAPTION = (
    "Left: the hexapod without failure exerts one moment on a fixture; weighted pseudo-inverses "
    "exert less of it with less torque. Right: a platform on four legs presses with the same "
    "wrenches, the weight of one motor three times that of the others."
)
ALT = (
    "Left: only the force mapping has no error; that of pseudo-inverses falls towards it with "
    "increasing torque. Right: with internal force the hot motor has a third of its force."
)


def figure(tradeoff: pd.DataFrame, internal_force: pd.DataFrame) -> Figure:
    """Plot moment errors over torques, and the force of a hot motor."""
    figure = new_figure(PAGE_IN, 3.0)
    left, right = figure.subplots(1, 2)
    for method, marker, color, size in (
        ("others", ".", BLACK, 4),
        ("pseudo_inverse", "s-", VERMILION, 4),
        ("mapping", "*", BLUE, 9),
    ):
        points = tradeoff[tradeoff.way == method]
        line = left.semilogy(points.weighed_over_mapping, points.major_off_percent, marker)[0]
        line.set(color=color, markersize=size, label=method.replace("_", "-"))
    left.set_title("The mapping exerts the moment with the least torque")
    left.set_xlabel("weighted torque, relative to the mapping's")
    left.set_ylabel("error of the moment, %")
    hot = internal_force.dropna(subset="hot_motor_rms_n").groupby("internal_force")
    for method, place, color in (("without", -0.2, PURPLE), ("used", 0.2, BLUE)):
        motors = hot.get_group(method)
        bars = right.bar(np.arange(len(motors)) + place, motors.hot_motor_rms_n, 0.4, color=color)
        right.set_xticks(range(len(motors)), list(motors.name))
        bars.set_label(f"internal force: {method}")
    right.set_title("Internal force relieves a hot motor")
    right.set_ylabel("force of the hot motor, RMS, N")
    one_legend(figure, 5)
    return figure
