"""Pose-independent structure of a mechanism's Jacobians, and matrices for their rows."""

from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import count
from typing import NamedTuple, TypeAlias

import mujoco
import numpy as np
from numpy.typing import NDArray

import argument_checks as check
from sim.array import Array
from sim.closing.equalities import Closures
from sim.closing.fixed import LocatedPin
from sim.errors import ModelError
from sim.kinematics.task import LocatedFunction, Motion, Task
from sim.mjcf.accuracy import Rounding, roundings
from sim.mjcf.drive import Drive, drive_rows, drives, extra_drives, required_drives
from sim.mjcf.frame import own_length
from sim.mjcf.joints import turning
from sim.mjcf.limits import stuck_rows
from sim.mjcf.model import element_id, name_of

_OF_JOINT, _TENDON = int(mujoco.mjtWrap.mjWRAP_JOINT), int(mujoco.mjtEq.mjEQ_TENDON)
_MARGIN = 4.0
"""Safety factor of the bound: closures join two chains, and axis errors rotate their subtrees."""
_NONE_STUCK = check.frozen(np.zeros((0, 0)))
_Writer = Callable[[mujoco.MjModel, mujoco.MjData, Array], None]
"""Function that writes rows per qvel to an array (k, nv)."""


@dataclass(frozen=True, eq=False)
class Structure:
    """Pose-independent structure of the Jacobians of a model with given equalities and actuators.

    Arrays are read-only, because ticks share them. The natural unit is 1 rad for angles and the
    mechanism's length for lengths.

    Attributes:
        tasks: Functions that give the rows of J_T, task by task.
        stuck: Joints and tendons on their limits that count as stuck: none, all, or by names.
        left_out: Sentence for each active equality that is left out.
        active: Velocity index of each active velocity, shape (n,): those with actuators, then
            variables without one.
        gear: Gear of the first actuator of each, 1 where there is none, shape (n,).
        drives: Drive of each active velocity with an actuator, in their order.
        variables: Number of active velocities without an actuator.
    """

    model: mujoco.MjModel
    tasks: Mapping[Task, LocatedFunction]
    pins: tuple[LocatedPin, ...]
    stuck: bool | tuple[str, ...]
    closures: Closures
    left_out: tuple[str, ...]
    active: NDArray[np.intp]
    gear: Array
    drives: tuple[Drive, ...]
    variables: int

    @cached_property
    def extra(self) -> tuple[Drive, ...]:
        """Drives that move no single joint."""
        return extra_drives(self.drives)

    @cached_property
    def length(self) -> float:
        """Length of the mechanism [m]; see :func:`own_length`."""
        tasks, pins = self.tasks.values(), (pin.frame for pin in self.pins)
        frames = [frame for located in tasks for frame in located.frames]
        return own_length(self.model, [*pins, *frames, *self.closures.frames(self.model)])

    @cached_property
    def velocity_units(self) -> Array:
        """Natural unit of each velocity, shape (N,)."""
        joints = np.where(turning(self.model), 1.0, self.length)
        others = [self._drive_unit(drive, joints) for drive in self.extra]
        return check.read_only(np.append(joints, others))

    @cached_property
    def task_units(self) -> Array:
        """Natural unit of each row of J_T, shape (m,)."""
        angular = [is_angle for located in self.tasks.values() for is_angle in located.angular]
        return check.read_only(np.where(np.array(angular, dtype=bool), 1.0, self.length))

    @cached_property
    def constraint_units(self) -> Array:
        """Natural units of the rows of closures, of drives without a joint, and of pins."""
        model, velocities = self.model, self.velocity_units
        scale = self.closures.units  # of the turns of a weld, which are sines that are scaled
        lengths = np.where(self.closures.turns(model), 1.0, self.length)
        units = lengths / np.where(scale > 0.0, scale, 1.0)
        for k, kind, rows in self.closures.parts(model):
            if kind == _TENDON:
                units[rows] = self._tendon_unit(int(model.eq_obj1id[k]), velocities)
        pins = [np.repeat([1.0, self.length], 3)[pin.rows] for pin in self.pins]
        return check.read_only(np.concatenate([units, velocities[model.nv :], *pins]))

    @cached_property
    def roundings(self) -> tuple[Rounding, ...]:
        """Rounded numbers of the model file."""
        return roundings(self.model)

    @cached_property
    def bound(self) -> float:
        """Bound of the errors of all entries due to rounding, in natural units.

        It is infinite for transmissions by spatial tendons, cranks and sites, whose errors depend
        on the pose.
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
        """Return the bound of all errors, in natural units, at a closure gap [m] or [rad]."""
        return self.bound + residual / self.length

    @cached_property
    def copies(self) -> list["Structure"]:
        """Copies whose model may be changed, each used by one thread at a time."""
        return []

    def copied(self) -> "Structure":
        """Take a copy from the pool, or create one, which for meshes takes longer than a tick."""
        with suppress(IndexError):  # another thread may have the only one
            return self.copies.pop()
        model = copy(self.model)
        model.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)
        return replace(self, model=model)

    def _drive_unit(self, drive: Drive, joints: Array) -> float:
        if drive.tendon is not None:
            return self._tendon_unit(drive.tendon, joints)
        shifts = drive.has_length or self.model.actuator_gear[drive.ids[0], :3].any()
        return self.length if shifts else 1.0

    def _tendon_unit(self, tendon: int, joints: Array) -> float:
        model, first = self.model, self.model.tendon_adr[tendon]
        if self._is_spatial(tendon):
            return self.length
        wraps = slice(first, first + model.tendon_num[tendon])
        units = joints[model.jnt_dofadr[model.wrap_objid[wraps]]]
        return float((np.abs(model.wrap_prm[wraps]) * units).max()) or 1.0

    def _is_spatial(self, tendon: int) -> bool:
        return self.model.wrap_type[self.model.tendon_adr[tendon]] != _OF_JOINT


def active_velocities(
    model: mujoco.MjModel, variables: NDArray[np.intp] | None
) -> tuple[NDArray[np.intp], Array, tuple[Drive, ...], int]:
    """Return indices, gears, drives and number of variables, as in :class:`Structure`.

    `variables` are velocities without an actuator; None is all of them.

    Raises:
        ModelError: There is neither an enabled actuator nor a variable; an actuator has no
            velocity; or a variable has an actuator.
    """
    of_model = drives(model) if variables is None or len(variables) else required_drives(model)
    after = count(model.nv)
    numbers = [next(after) if d.joint is None else model.jnt_dofadr[d.joint] for d in of_model]
    active = np.array(numbers, dtype=np.intp)
    if variables is None:
        variables = np.setdiff1d(np.arange(model.nv), active)
    elif len(both := np.intersect1d(variables, active)):
        joint = name_of(model.joint(int(model.dof_jntid[both[0]])))
        raise ModelError(f'active must name joints without an actuator, got "{joint}"')
    gear = check.frozen(np.append([drive.gear[0] for drive in of_model], np.ones(len(variables))))
    return check.read_only(np.append(active, variables)), gear, of_model, len(variables)


def variables_of(
    model: mujoco.MjModel, active: bool | Iterable[str | int]
) -> NDArray[np.intp] | None:
    """Return the velocities that are variables, ascending; None for all without an actuator."""
    if isinstance(active, bool):
        return None if active else np.zeros(0, dtype=np.intp)
    joints = set[int]()
    for item in check.members("active", active, str, int, np.integer):
        is_name = isinstance(item, str)
        joint = element_id(model, "joint", item) if is_name else check.integer("active", item)
        if joint >= model.njnt:
            raise ValueError(f"active must have numbers of joints below {model.njnt}, got {joint}")
        joints.add(joint)
    return np.flatnonzero(np.isin(model.dof_jntid, list(joints))).astype(np.intp)


class Matrices(NamedTuple):
    """Matrices J_T and J_C, to which MuJoCo writes the rows of each pose.

    Attributes:
        whole: J_T (m, N) and J_C (c, N): rows of closures, transmissions, pins and limits.
        views: Read-only views of both.
        per_qvel: Arrays of their first nv columns; the matrices themselves if nv = N.
        parts: Function that writes each block of rows, and its place.
        limits: Rows of limits, whose number depends on the pose.
    """

    whole: tuple[Array, Array]
    views: tuple[Array, Array]
    per_qvel: tuple[Array, Array]
    parts: tuple[tuple[_Writer, Array], ...]
    limits: Array


def _blank(of: Structure, limits: int) -> Matrices:
    """Create the matrices of a structure with a given number of rows of limits."""
    nv, E, C = of.model.nv, len(of.extra), len(of.closures.units)
    m = sum(len(located.angular) for located in of.tasks.values())
    c = C + E + sum(pin.height for pin in of.pins)
    whole = np.zeros((m, nv + E)), np.zeros((c + limits, nv + E))
    per_qvel = whole
    if E:  # MuJoCo writes rows of nv numbers, one after the other
        whole[1][C : C + E, nv:] = -np.eye(E)
        per_qvel = np.zeros((m, nv)), np.zeros((c + limits, nv))
    row, (tasks, constraints) = 0, per_qvel
    parts: list[tuple[_Writer, Array]] = [(of.closures.write_rows, constraints[:C])]
    for task, located in of.tasks.items():
        write = partial(_write_checked, f"the Jacobian of {check.short_repr(task)}", located)
        if isinstance(located, Motion):
            write = located.write_jacobian
        parts.append((write, tasks[row : (row := row + len(located.angular))]))
    row = C + E
    for pin in of.pins:
        parts.append((pin.frame.write_jacobian, constraints[row : (row := row + pin.height)]))
    views = check.read_only(whole[0].view()), check.read_only(whole[1].view())
    return Matrices(whole, views, per_qvel, tuple(parts), constraints[c:])


Cache: TypeAlias = dict[tuple["Structure", int], Matrices]
"""Matrices by structure and number of rows of limits."""


def rows_at(
    of: Structure, data: mujoco.MjData, cache: Cache, *, copied: bool = True
) -> tuple[Array, Array]:
    """Return J_T (m, N) and J_C (c, N), read-only, at a pose that is up to date.

    They are copies, or views that the next call with the same `cache` overwrites. Rows that are not
    finite or not as many as `angular` raise a ModelError or ValueError.
    """
    model = of.model
    limits = stuck_rows(model, data, of.stuck) if of.stuck else _NONE_STUCK
    key = of, len(limits)
    to = cache.pop(key, None) or _blank(*key)  # another thread must not use them meanwhile
    for write, out in to.parts:
        write(model, data, out)
    if len(limits):
        to.limits[:] = limits
    if E := len(of.extra):  # row qvel less its own velocity is zero
        mujoco.mj_transmission(model, data)
        C = len(of.closures.units)
        to.per_qvel[1][C : C + E] = drive_rows(model, data, of.extra)
        for whole, part in zip(to.whole, to.per_qvel, strict=True):
            whole[:, : model.nv] = part
    if not check.is_moderate(to.per_qvel[1]):
        raise ModelError("equalities and transmissions must be finite, got NaN or infinity")
    J_T, J_C = to.views
    if copied:
        J_T, J_C = check.read_only(J_T.copy()), check.read_only(J_C.copy())
    cache[key] = to
    return J_T, J_C


def _write_checked(
    name: str, located: LocatedFunction, model: mujoco.MjModel, data: mujoco.MjData, out: Array
) -> None:
    """Write the rows of a task, and check their shape, since the task may be user-defined."""
    out[:] = check.array(name, located.jacobian(model, data), *out.shape)
