"""Task and constraint Jacobians of a model at one pose, their accuracy, and what else it says."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

import argument_checks as check
from sim.array import Array
from sim.errors import ModelError
from sim.kinematics.structure import Kept, Names, Structure, rows_at
from sim.kinematics.task import Task
from sim.mjcf.accuracy import moved, written_accuracy
from sim.mjcf.drive import Drive, is_disabled
from sim.mjcf.joints import is_slack, joint_stiffness
from sim.mjcf.limits import at_limits, tendon_row, touching
from sim.mjcf.model import bring_up_to_date, listed, name_of

_POINTS = int(mujoco.mjtEq.mjEQ_CONNECT), int(mujoco.mjtEq.mjEQ_WELD)
_OF_JOINT = int(mujoco.mjtWrap.mjWRAP_JOINT)
_UNLOADED_M = 1e-9
_ROUND_OFF = 1e-14
"""Part of the largest entry below which a difference is none."""
_STATE = mujoco.mjtState
PLACE = int(
    _STATE.mjSTATE_QPOS
    | _STATE.mjSTATE_EQ_ACTIVE
    | _STATE.mjSTATE_MOCAP_POS
    | _STATE.mjSTATE_MOCAP_QUAT
)
"""What decides the Jacobians of a model in one state."""


@dataclass(frozen=True, eq=False)
class Machine:
    """What a model says besides the Jacobians at one pose, and how accurate each entry of them is.

    All is computed when first asked for. Errors are in the unit of the entry; natural units are 1
    of an angle, the mechanism's own length of a length.

    Attributes:
        structure: What no pose changes.
        place: The pose, as `mj_getState` gives it of :data:`PLACE`.
        residual: Largest gap of the closures, [m] or [rad].
    """

    structure: Structure
    place: Array
    residual: float
    J_T: Array
    J_C: Array

    @property
    def drives(self) -> tuple[Drive, ...]:
        """What each active velocity is and what drives it, in actuator order."""
        return self.structure.drives

    @property
    def names(self) -> Names:
        """Names of the velocities and of the actuators."""
        return self.structure.names

    @property
    def error_bound(self) -> float:
        """Bound of the errors of all entries in natural units."""
        return self.structure.error_bound(self.residual)

    @property
    def task_units(self) -> Array:
        """Natural unit of each row of J_T, shape (m,)."""
        return self.structure.task_units

    @property
    def velocity_units(self) -> Array:
        """Natural unit of each velocity, shape (N,)."""
        return self.structure.velocity_units

    @cached_property
    def constraint_units(self) -> Array:
        """Natural unit of each row of J_C, shape (c,)."""
        units = self.structure.constraint_units
        stuck = np.abs(self.J_C[len(units) :]) * self.velocity_units
        return check.read_only(np.append(units, stuck.max(axis=1, initial=0.0)))

    @property
    def J_T_error(self) -> Array:
        """Largest error of each entry of J_T, shape (m, N)."""
        return self._of_rounding[0]

    @cached_property
    def J_C_error(self) -> Array:
        """Largest error of each entry of J_C, shape (c, N)."""
        of, gaps = self.structure, np.zeros(self.J_C.shape)
        for _, kind, rows in of.closures.parts(of.model):
            if kind in _POINTS:  # couplings hold however open
                gaps[rows] = self.J_C[rows].any(axis=0)
        gaps *= self.residual / of.length * self.constraint_units[:, None]
        return check.read_only(self._of_rounding[1] + gaps / self.velocity_units)

    @cached_property
    def _of_rounding(self) -> tuple[Array, Array]:
        """The sum of what half a unit of the last digit of each number does."""
        errors = np.zeros(self.J_T.shape), np.zeros(self.J_C.shape)
        if self.structure.roundings:
            of = self.structure.copied()
            model, data, spare = of.model, state_at(of.model, self.place), Kept()

            def read() -> tuple[Array, Array]:
                bring_up_to_date(model, data)
                return rows_at(of, data, spare)

            here = read()
            for rounding in of.roundings:
                before = moved(model, rounding, 1.0)
                for error, there, at in zip(errors, read(), here, strict=True):
                    change = np.abs(there - at)
                    change[change < _ROUND_OFF * np.abs(at).max(initial=0.0)] = 0.0
                    error += change
                getattr(model, rounding.field)[rounding.row] = before
            self.structure.copies.append(of)
        return check.read_only(errors[0]), check.read_only(errors[1])

    @cached_property
    def stiffness(self) -> Array | None:
        """K of the springs, shape (N, N); None where one is not linear in the joints' motion.

        That is so for a spatial tendon under load, too: its force turns with it.
        """
        model, extra = self._model, len(self.structure.extra)
        if model.tendon_stiffnesspoly.any():
            return None
        try:
            K = np.diag(np.append(joint_stiffness(model), np.zeros(extra)))
        except ModelError:
            return None
        for k in np.flatnonzero(model.tendon_stiffness).tolist():
            if not is_slack(model, self._data, k):
                length = self._data.ten_length[k]
                stretch = length - np.clip(length, *model.tendon_lengthspring[k])
                if model.wrap_type[model.tendon_adr[k]] != _OF_JOINT and abs(stretch) > _UNLOADED_M:
                    return None
                row = tendon_row(model, self._data, int(k))
                K[: model.nv, : model.nv] += model.tendon_stiffness[k] * np.outer(row, row)
        return check.read_only(K)

    @cached_property
    def force_range(self) -> Array:
        """Least and most force along each active velocity, shape (n, 2), [N] or [N m].

        Zero where no actuator is.
        """
        of_each = [drive.force_range for drive in self.drives]
        of_each += [(0.0, 0.0)] * self.structure.variables
        return check.read_only(np.array(of_each).reshape(-1, 2))

    @cached_property
    def one_sided(self) -> Array:
        """Of each active velocity 1 or -1 if it is only pushed so, 0 if both ways, shape (n,)."""
        of_each = [drive.one_sided for drive in self.drives] + [0] * self.structure.variables
        return check.read_only(np.array(of_each, dtype=int))

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """What the Jacobians leave out, a sentence each."""
        return (
            *self.structure.left_out,
            *self._limit_warnings(),
            *self._contact_warnings(),
            *self._other_warnings(),
        )

    @property
    def _model(self) -> mujoco.MjModel:
        return self.structure.model

    @cached_property
    def _data(self) -> mujoco.MjData:
        data = state_at(self._model, self.place)
        mujoco.mj_fwdPosition(self._model, data)
        return data

    def _limit_warnings(self) -> list[str]:
        stuck = self.structure.stuck
        if stuck is True:
            return []
        return [
            f'{limit.kind} "{limit.name}" rests on its limit and is taken to move freely: '
            f'stuck_at_limits=["{limit.name}"] takes it as stuck'
            for limit in at_limits(self._model, self._data)
            if not stuck or limit.name not in stuck
        ]

    def _contact_warnings(self) -> list[str]:
        model = self._model
        rigid = model.body_weldid  # bodies without a joint between them are one
        held = {rigid[pin.frame.body] for pin in self.structure.pins}
        return [
            f'"{name_of(model.body(b))}" touches "{name_of(model.body(a))}" and is taken '
            "to move freely: pinned= takes it to stand"
            for a, b in sorted(touching(model, self._data))
            if not {rigid[a], rigid[b]} & held
        ]

    def _other_warnings(self) -> list[str]:
        """Actuators without effect or of one direction; offsets that MuJoCo takes for none."""
        model = self._model
        at_body = model.site_sameframe == mujoco.mjtSameFrame.mjSAMEFRAME_BODY
        dropped = np.flatnonzero(at_body & model.site_pos.any(axis=1))
        actuators = range(model.nactuator)
        said: dict[str, list[str]] = {
            "opt.disableactuator switches off, so not active: ": [
                name_of(model.actuator(k)) for k in actuators if is_disabled(model, k)
            ],
            "actuated in one direction only, which the mappings do not know: ": [
                drive.name for drive in self.drives if drive.one_sided
            ],
            "MuJoCo drops offsets of sites below 1e-6 of the unit of length, state the model in a "
            "smaller one; these are at the origins of their bodies: ": [
                name_of(model.site(k)) for k in dropped
            ],
        }
        return [words + listed(names) for words, names in said.items() if names]


def state_at(model: mujoco.MjModel, place: Array) -> mujoco.MjData:
    """A state of a model at a place; nothing is computed."""
    mujoco.mj_setState(model, data := mujoco.MjData(model), place, PLACE)
    return data


class JacobianViews(NamedTuple):
    """What one tick needs of :class:`Jacobians`: the next reading overwrites the matrices.

    They cannot be written to; `active` is the same array as long as the same equalities and
    actuators count. `error_bound` is of all entries, in natural units.
    """

    J_T: Array
    J_C: Array
    active: NDArray[np.intp]
    closure_residual: float
    error_bound: float


@dataclass(frozen=True, eq=False)
class Jacobians:
    """Velocities of a MuJoCo model as v = J_T u, 0 = J_C u, with u = [qvel; other actuators'].

    N velocities: the nv of MuJoCo, then one of each transmission that is no slide or hinge joint.

    Attributes:
        J_T: Velocities of the tasks, shape (m, N): a frame has the twist [angular; linear] of its
            origin, [rad]/[s] and [m]/[s].
        J_C: Rows of the active equality constraints, shape (c, N), then of the transmissions, pins
            and limits; redundant rows are normal.
        active: Velocity index of each active velocity, in actuator order, shape (n,).
        gear: Gear ratio of its first actuator, never zero, shape (n,).
        rows: Which rows of J_T belong to which task.
        closure_residual: Largest gap of the closures, [m] or [rad].
        machine: The model behind it: names, limits, springs, and the accuracy of each entry.
    """

    J_T: Array
    J_C: Array
    active: NDArray[np.intp]
    gear: Array
    rows: Mapping[Task, slice] = field(default_factory=dict)
    closure_residual: float = 0.0
    machine: Machine | None = None

    def __post_init__(self) -> None:
        """Check the arguments, and keep read-only copies."""
        nv = (J_T := check.array("J_T", self.J_T, ..., None, None)).shape[-1]
        J_C = check.array("J_C", self.J_C, ..., None, nv)
        active = check.indices("active", self.active, nv)
        gear = check.array("gear", self.gear, len(active))
        if not gear.all():
            raise ValueError(f"gear must not be zero, got {check.shown(self.gear)}")
        for name, value in {"J_T": J_T, "J_C": J_C, "active": active, "gear": gear}.items():
            object.__setattr__(self, name, check.frozen(value))
        check.instance("rows", self.rows, Mapping)
        check.number("closure_residual", self.closure_residual, 0.0)
        if self.machine is not None:
            check.instance("machine", self.machine, Machine)

    @property
    def accuracy(self) -> Machine | None:
        """How far each entry may be off, and natural units: what the model says."""
        return self.machine

    @property
    def names(self) -> Names | None:
        """Names of the velocities and of the actuators of each active one."""
        return self.machine and self.machine.names

    @property
    def stiffness(self) -> Array | None:
        """K of the springs of joints and tendons, (N, N); None where one is not linear."""
        return self.machine and self.machine.stiffness

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the model has besides, and the Jacobians leave out; a sentence each."""
        return self.machine.warnings if self.machine else ()

    @cached_property
    def geometry_accuracy(self) -> float:
        """Accuracy of the geometry in one number, in rad or relative length, as the model shows it.

        The rounding of its numbers; or a tenth of what the gaps of the closures amount to in J_C,
        where `ConstrainedSystem(geometry_accuracy=...)` takes ten times the accuracy for zero.
        `accuracy` says it for each entry.
        """
        size = float(np.linalg.norm(self.J_C))
        of_gaps = 0.1 * self.closure_residual / size if size else 0.0
        return max(of_gaps, written_accuracy(self.machine.structure.model) if self.machine else 0.0)
