"""A mechanism loaded from outside, and gauges that know nothing of the force mapping.

The environment is a fixture that clamps the payload to the world: two-sided, so that contact need
not be kept. Each gauge reads what one closure, lock or fixture does in MuJoCo.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from sim import Array, Failure, Plant, failed_plant, jacobians

HEXAPOD_TASK = range(6)
SAMPLE_S = 0.01
PRESS_S, HOLD_S = 0.05, 0.6
"""Clamped, nothing but closures moves; else the softest mode, 31.6 Hz, decays to 3e-5."""
_TARE_S = 0.05
FIXTURE = "fixture"


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

    Each of the L loads is a step and stays for S samples; the last of them is at rest.

    Attributes:
        fixture: Wrench [moment; force] that the mechanism exerts on it, shape (L, S, 6); rows that
            the mechanism is not about are zero.
        strut_n: Force along each actuated joint that its closure takes on, shape (L, S, n), [N].
        lock_n: Force of each lock on its joint, shape (L, S, n), [N].
        displacement: Of the payload, [rotation; translation], shape (L, S, 6), [rad] and [m].
        closure_residual_m: Largest gap of a loop or of the fixture, not lessened, shape (L, S).
    """

    fixture: Array
    strut_n: Array
    lock_n: Array
    displacement: Array
    closure_residual_m: Array

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

    Args:
        model: From :func:`with_fixture`.
        failures: What is broken from the start.
        torques: Of all actuators, one load a row.
        task: Rows of the payload twist that the mechanism is about.

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
        sound = jacobians(plant.model, mujoco.MjData(plant.model), site="payload", axes="base")
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
