"""A failed mechanism loaded from outside, and gauges that know nothing of the force mapping.

The environment is a fixture that clamps the payload to the world: two-sided, so that contact need
not be kept. Each gauge reads what one closure, lock or fixture does in MuJoCo.
"""

import copy
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from sim import Array, Failure, FailureKind, Plant, failed_plant, jacobians

HEXAPOD_TASK = range(6)
SAMPLE_S = 0.01
PRESS_S, HOLD_S = 0.05, 0.6
"""Clamped, nothing but closures moves; else the softest mode, 31.6 Hz, decays to 3e-5."""
_TARE_S = 0.05
FIXTURE = "fixture"


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

    @property
    def locked(self) -> tuple[int, ...]:
        """Position failures, for the theory."""
        return (self.strut,) if self.kind == "locked" else ()

    @property
    def free(self) -> tuple[int, ...]:
        """Torque failures, for the rigid theory: it knows no suspension spring."""
        return (self.strut,) if self.kind in ("free", "loose") else ()


KINDS: tuple[FailureKind, ...] = ("locked", "free", "loose")


def conditions(struts: int) -> tuple[Condition, ...]:
    """Sound, and each of the first struts failed in each way."""
    failed = [Condition(kind, strut) for kind in KINDS for strut in range(struts)]
    return (Condition(), *failed)


def with_fixture(path: Path) -> mujoco.MjModel:
    """The machine of an MJCF file, with a weld `fixture` from the world to its payload, unused yet.

    As stiff as the closures, and at the payload's origin.
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


@dataclass(frozen=True)
class Readings:
    """What the gauges read, less what they read before the first load.

    Each of the L loads is a step and stays for S samples; the last of them is at rest. Rows of the
    fixture's wrench that the mechanism is not about are zero.
    """

    fixture: Array  # wrench [moment; force] exerted on it, (L, S, 6)
    strut_n: Array  # along each actuated joint, what its closure takes on, (L, S, n)
    lock_n: Array  # of each lock on its joint, (L, S, n)
    displacement: Array  # of the payload, [rotation; translation], (L, S, 6), [rad] and [m]
    closure_residual_m: Array  # largest gap of a loop or of the fixture, in full, (L, S)

    @property
    def time_s(self) -> Array:
        """From the first load, shape (L, S)."""
        shape = self.strut_n.shape[:2]
        return SAMPLE_S * np.arange(1, np.prod(shape) + 1).reshape(shape)


def press(
    model: mujoco.MjModel,
    failures: Sequence[Failure],
    torques: Array,
    task: Sequence[int] = HEXAPOD_TASK,
) -> Readings:
    """Clamp the payload of a failed mechanism in the fixture and exert torques (L, n), [N].

    The model is one of :func:`with_fixture`; `task` are the rows of the payload twist that the
    mechanism is about.

    Raises:
        sim.SimulationDiverged: The physics left the finite numbers.
    """
    plant = failed_plant(model, failures)
    plant.data.eq_active[model.equality(FIXTURE).id] = True
    return _read(plant, task, torques, np.zeros((len(torques), 6)), PRESS_S)


def hold(
    model: mujoco.MjModel, failures: Sequence[Failure], torques: Array, wrench: Array
) -> Readings:
    """Exert torques (L, n) [N] while the world pushes the payload back with -wrench (L, 6).

    The wrench that is to be held is [moment; force] in base axes, [N m] and [N]; no fixture.

    Raises:
        sim.SimulationDiverged: The physics left the finite numbers.
    """
    return _read(failed_plant(model, failures), HEXAPOD_TASK, torques, -wrench, HOLD_S)


def _read(
    plant: Plant, task: Sequence[int], torques: Array, pushes: Array, each_s: float
) -> Readings:
    gauges = Gauges(plant, task)
    plant.settle(_TARE_S)
    before, rows, gaps = gauges.read(), [], []
    # At rest at zero an actuator that is commanded torque / gain exerts that torque.
    commands = torques / plant.model.actuator_gainprm[:, 0]
    for command, push in zip(commands, pushes, strict=True):
        plant.push(push)
        for _ in range(round(each_s / SAMPLE_S)):
            plant.step(command, SAMPLE_S)
            rows.append(gauges.read() - before)
            gaps.append(plant.closure_residual_m())
    L, n = torques.shape
    series = np.array(rows).reshape(L, -1, len(before))
    fixture, strut_n, lock_n, displacement = np.split(series, [6, 6 + n, 6 + 2 * n], axis=-1)
    return Readings(fixture, strut_n, lock_n, displacement, np.array(gaps).reshape(L, -1))


class Gauges:
    """On a plant, clamped or not, that does not leave its nominal pose by much."""

    def __init__(self, plant: Plant, task: Sequence[int] = HEXAPOD_TASK) -> None:
        """Read the wrench on the fixture in these rows of the payload twist."""
        model = copy.copy(plant.model)
        model.opt.disableactuator = 0  # a strut has its gauge, with a coil or without
        sound = jacobians(model, mujoco.MjData(model), site="payload", axes="base")
        self._plant, self._task = plant, list(task)
        self._J_T, self._active = sound.J_T[self._task], sound.active

    def read(self) -> Array:
        """Fixture wrench (6,), strut forces (n,), lock forces (n,), payload displacement (6,)."""
        joints = range(len(self._active))
        wrench = np.zeros(6)
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
