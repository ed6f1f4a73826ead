"""How accurate each entry of the Jacobians is, and what it is measured in."""

import contextlib
import copy
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np
from numpy.typing import NDArray

import argument_checks as check
from sim.array import Array
from sim.closing.equalities import Closures
from sim.closing.pin import Pin
from sim.mjcf.drive import Drive
from sim.mjcf.frame import Located, located, own_length
from sim.mjcf.ranges import turning
from sim.mjcf.rounding import Rounding, moved, roundings

Jacobians = tuple[Array, Array]
"""J_T and J_C."""
_WELD, _CONNECT = int(mujoco.mjtEq.mjEQ_WELD), int(mujoco.mjtEq.mjEQ_CONNECT)
_JOINT = int(mujoco.mjtEq.mjEQ_JOINT)
_OF_JOINT = int(mujoco.mjtWrap.mjWRAP_JOINT)
_ROUND_OFF = 1e-14
"""Part of the largest entry below which a difference is none."""
_MARGIN = 4.0
"""Of the bound: two chains meet in a closure, and errors of axes turn what hangs on them."""


@dataclass(frozen=True, eq=False)
class Natural:
    """What the structure of a mechanism fixes of its accuracy, whatever the pose.

    Attributes:
        model: The model.
        frames: That the task, closures and pins read.
        closures: The active equalities.
        extra: Drives that are no joint.
        pins: Frames that stay.
        task_rows: Whether each row of J_T is angular, shape (m,).
    """

    model: mujoco.MjModel
    frames: tuple[Located, ...]
    closures: Closures
    extra: tuple[Drive, ...]
    pins: tuple[Pin, ...]
    task_rows: NDArray[np.bool_]

    @cached_property
    def roundings(self) -> tuple[Rounding, ...]:
        """Numbers of the file that were rounded."""
        return roundings(self.model)

    @cached_property
    def copies(self) -> list[mujoco.MjData]:
        """States of copies of the model, made once: each is taken by one thread at a time."""
        return []

    def copied(self) -> mujoco.MjData:
        """The state of a copy of the model whose numbers may be moved."""
        with contextlib.suppress(IndexError):  # another thread may have the only one
            return self.copies.pop()
        model = copy.copy(self.model)
        model.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)
        return mujoco.MjData(model)

    @cached_property
    def length(self) -> float:
        """The mechanism's own length [m]; see :func:`own_length`."""
        return own_length(self.model, self.frames)

    @cached_property
    def velocity_units(self) -> Array:
        """Natural unit of each velocity, shape (N,): 1 of a turn, the length of a shift."""
        joints = np.where(turning(self.model), 1.0, self.length)
        others = [self._drive_unit(drive, joints) for drive in self.extra]
        return check.read_only(np.append(joints, others))

    def _drive_unit(self, drive: Drive, joints: Array) -> float:
        model = self.model
        if drive.tendon is not None:
            return self._tendon_unit(drive.tendon, joints)
        shifts = drive.has_length or model.actuator_gear[drive.ids[0], :3].any()
        return self.length if shifts else 1.0

    def _tendon_unit(self, tendon: int, joints: Array) -> float:
        model, first = self.model, self.model.tendon_adr[tendon]
        wraps = range(first, first + model.tendon_num[tendon])
        if model.wrap_type[first] != _OF_JOINT:
            return self.length
        each = [
            abs(model.wrap_prm[k]) * joints[model.jnt_dofadr[model.wrap_objid[k]]] for k in wraps
        ]
        return float(max(each)) or 1.0

    @cached_property
    def task_units(self) -> Array:
        """Of each row of J_T, shape (m,)."""
        return check.read_only(np.where(self.task_rows, 1.0, self.length))

    @cached_property
    def closure_units(self) -> Array:
        """Of each row of the closures, shape (.,)."""
        model, joints = self.model, np.where(turning(self.model), 1.0, self.length)
        units, row = np.empty(len(self.closures.units)), 0
        for k in dict.fromkeys(self.closures.equality.tolist()):
            kind, ends = model.eq_type[k], row + 1
            if kind in (_CONNECT, _WELD):
                units[row : row + 3], ends = self.length, row + (6 if kind == _WELD else 3)
                scale = self.closures.units[row + 3 : ends]  # a weld's rows are sines, scaled
                units[row + 3 : ends] = 1.0 / np.where(scale > 0.0, scale, 1.0)
            elif kind == _JOINT:
                units[row] = joints[model.jnt_dofadr[model.eq_obj1id[k]]]
            else:
                units[row] = self._tendon_unit(int(model.eq_obj1id[k]), joints)
            row = ends
        return units

    @cached_property
    def constraint_units(self) -> Array:
        """Of the rows of closures, drives that are no joint, and pins."""
        pins = [np.repeat([1.0, self.length], 3)[pin.rows] for pin in self.pins]
        drives = self.velocity_units[self.model.nv :]
        return check.read_only(np.concatenate([self.closure_units, drives, *pins]))

    @cached_property
    def bound(self) -> float:
        """Of the errors of all entries that rounding makes, in natural units.

        Infinite where the pose decides: of tendons in space, cranks and sites as transmissions.
        """
        if not self.roundings:
            return 0.0
        if any(drive.tendon is None or self._is_spatial(drive.tendon) for drive in self.extra):
            return np.inf
        model, own = self.model, np.zeros((self.model.nbody, 2))
        sites, closures = np.zeros(model.nsite), 0.0
        for field, row, _, half, is_unit in self.roundings:
            error = 2.0 * half if is_unit else half / self.length
            if field.startswith("site"):
                sites[row] += error
            elif field == "eq_data":
                closures += error
            else:
                body = row if field.startswith("body") else model.jnt_bodyid[row]
                own[body, int(is_unit)] += error
        for body in range(1, model.nbody):
            own[body] += own[model.body_parentid[body]]
        return _MARGIN * float(own.sum(axis=1).max() + sites.max(initial=0.0) + closures)

    def error_bound(self, residual: float) -> float:
        """Of all entries in natural units, where closures are open so far, [m] or [rad]."""
        return self.bound + residual / self.length

    def _is_spatial(self, tendon: int) -> bool:
        return self.model.wrap_type[self.model.tendon_adr[tendon]] != _OF_JOINT


def frames_of(
    model: mujoco.MjModel,
    closures: Closures,
    pins: Iterable[Pin],
    of_tasks: Iterable[Located],
) -> tuple[Located, ...]:
    """What tasks, closures and pins read."""
    pinned = (located(model, "pinned", pin.frame) for pin in pins)
    return (*pinned, *of_tasks, *closures.frames(model))


@dataclass(frozen=True, eq=False)
class EntryAccuracy:
    """How far each entry of J_T and J_C may be off at one pose, in its own unit.

    Attributes:
        natural: What no pose changes.
        residual: Largest gap of the closures, [m] or [rad].
        jacobians: J_T and J_C there.
        reader: J_T and J_C at that pose, for a state of a model with the same structure.
    """

    natural: Natural
    residual: float
    jacobians: Jacobians
    reader: Callable[[mujoco.MjData], Callable[[], Jacobians]]

    @property
    def length(self) -> float:
        """The mechanism's own length [m]; see :class:`Natural`."""
        return self.natural.length

    @property
    def error_bound(self) -> float:
        """Of all entries in natural units."""
        return self.natural.error_bound(self.residual)

    @property
    def task_units(self) -> Array:
        """Natural unit of each row of J_T, shape (m,): 1 of a turn, the length of a shift."""
        return self.natural.task_units

    @property
    def velocity_units(self) -> Array:
        """Of each velocity, shape (N,)."""
        return self.natural.velocity_units

    @cached_property
    def constraint_units(self) -> Array:
        """Of each row of J_C, shape (c,)."""
        units, J_C = self.natural.constraint_units, self.jacobians[1]
        stuck = np.abs(J_C[len(units) :]) * self.velocity_units
        return check.read_only(np.append(units, stuck.max(axis=1, initial=0.0)))

    @property
    def J_T_error(self) -> Array:
        """Shape (m, N)."""
        return check.read_only(self._of_rounding[0])

    @cached_property
    def J_C_error(self) -> Array:
        """Shape (c, N)."""
        J_C, natural = self.jacobians[1], self.natural
        gaps, equality = np.zeros(J_C.shape), natural.closures.equality
        for k in dict.fromkeys(equality.tolist()):
            if natural.model.eq_type[k] in (_CONNECT, _WELD):  # couplings hold however open
                rows = np.flatnonzero(equality == k)
                gaps[rows] = J_C[rows].any(axis=0)
        gaps *= self.residual / natural.length * self.constraint_units[:, None]
        return check.read_only(self._of_rounding[1] + gaps / self.velocity_units)

    @cached_property
    def _of_rounding(self) -> Jacobians:
        """The sum of what half a unit of the last digit of each number does."""
        errors = np.zeros(self.jacobians[0].shape), np.zeros(self.jacobians[1].shape)
        if not self.natural.roundings:
            return errors
        data = self.natural.copied()
        model, read = data.model, self.reader(data)
        here = read()
        for rounding in self.natural.roundings:
            before = moved(model, rounding, 1.0)
            for error, there, at in zip(errors, read(), here, strict=True):
                change = np.abs(there - at)
                change[change < _ROUND_OFF * np.abs(at).max(initial=0.0)] = 0.0
                error += change
            getattr(model, rounding.field)[rounding.row] = before
        self.natural.copies.append(data)
        return errors
