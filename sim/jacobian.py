"""Task and constraint Jacobians of any MJCF model."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import count

import mujoco
import numpy as np
from numpy.typing import NDArray

import argument_checks as check
from sim.array import Array
from sim.closure import check_closures, closure_rows, equality_name, largest_gap
from sim.errors import ClosureError, ModelError
from sim.frame import Body
from sim.limits import stuck_names, stuck_rows, touching
from sim.machine import Machine, Names
from sim.model import check_state
from sim.pin import Pin, pin_rows, pins_of
from sim.pose import computed
from sim.task import Task, task_jacobian, task_list, to_axes_of
from sim.transmission import drive_rows, drives, extra_drives, simple_velocities

CLOSURE_TOLERANCE = 1e-3
"""Largest gap of a closure, [m] or [rad], at which Jacobians are taken."""


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
        machine: The model behind it, from which names, limits and springs are read when asked for.

    Raises:
        ValueError: Shapes that do not fit, an index out of range, or numbers that are not finite.
        TypeError: An argument is of another kind.
    """

    J_T: Array
    J_C: Array
    active: NDArray[np.intp]
    gear: Array
    rows: Mapping[Task, slice] = field(default_factory=dict)
    closure_residual: float = 0.0
    machine: Machine | None = None

    def __post_init__(self) -> None:
        """Check the arguments."""
        nv = check.batch("J_T", self.J_T).shape[-1]
        check.batch("J_C", self.J_C, columns=nv)
        active = check.indices("active", self.active, nv)
        if not check.exactly("gear", self.gear, len(active)).all():
            raise ValueError(f"gear must not be zero, got {check.shown(self.gear)}")
        check.instance("rows", self.rows, Mapping)
        check.number("closure_residual", self.closure_residual)
        if self.machine is not None:
            check.instance("machine", self.machine, Machine)

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
        """Accuracy of the geometry, in rad or relative length, as the model shows it.

        The rounding of its numbers; or a tenth of what the gaps of the closures amount to in J_C,
        where `ConstrainedSystem(geometry_accuracy=...)` takes ten times the accuracy for zero.
        """
        size = float(np.linalg.norm(self.J_C))
        of_gaps = 0.1 * self.closure_residual / size if size else 0.0
        return max(of_gaps, self.machine.written_accuracy if self.machine else 0.0)


def jacobians(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    site: Task | Sequence[Task],
    axes: str | None = None,
    *,
    pinned: Iterable[str | Body | Pin] = (),
    stuck_at_limits: bool | Iterable[str] = False,
    closure_tolerance: float = CLOSURE_TOLERANCE,
) -> Jacobians:
    """Jacobians at the present `data.qpos`; derived quantities in `data` are brought up to date.

    Joints, equalities and transmissions of every kind that has velocities: connect, weld, joint and
    tendon equalities; actuators on joints, tendons, sites and slider-cranks. Dry friction is left
    out; contacts and limits too, unless `pinned` or `stuck_at_limits` says otherwise.

    Args:
        model: Any model.
        data: Its state; `eq_active` decides which equalities count. See :func:`assemble`.
        site: The task: name of a site, :class:`Body`, :class:`CenterOfMass` or :class:`Relative`;
            or several, whose rows are stacked.
        axes: Site whose axes velocities are expressed in; None is the world.
        pinned: Frames that stay where they are, as feet that stand: names of sites,
            :class:`Body`, or :class:`Pin`.
        stuck_at_limits: Which of the joints and tendons that rest on their limits count as stuck,
            in both directions: none, all (True), or those of these names.
        closure_tolerance: Largest gap of a closure, [m] or [rad]. Up to 1 mm a gap changes the
            Jacobians by no more than its own size; infinity takes any.

    Raises:
        ClosureError: A closure is open farther than the tolerance.
        ModelError: A name that does not exist; a model without enabled actuators; a task that no
            actuator moves; an actuator or an active equality that is no velocity; closures that
            the model's flags switch off, or that sleep.
        ValueError: `data.qpos` is not finite, or `data` of another model.
        TypeError: An argument is of another kind.
    """
    check_state(model, data)
    tasks, pins = task_list(model, site), pins_of(model, pinned)
    stuck = stuck_names(stuck_at_limits)
    if closure_tolerance != np.inf:
        check.number("closure_tolerance", closure_tolerance)
    check_closures(model, data)
    mujoco.mj_fwdPosition(model, data)
    residual, worst = largest_gap(model, data)
    if residual > closure_tolerance:
        raise ClosureError(equality_name(model, worst), residual, "call sim.assemble(model, data)")

    forbidden = [closure_rows(model, data)]
    if pins:
        forbidden.append(pin_rows(model, data, pins))
    if stuck:
        forbidden.append(stuck_rows(model, data, stuck))
    active, gear, extra = _driven(model, data)
    J_T, rows = _task_rows(model, data, tasks, axes, len(extra))
    J_C = _with_transmissions(forbidden, extra)
    if not check.is_moderate(J_C):
        raise ModelError("an equality or a transmission of the model is not finite")
    for task in tasks:
        if not _moves(J_T[rows[task]], J_C, active):
            raise ModelError(
                f"no actuator moves {check.shown(task)}: name another task, or what its mechanism "
                "stands on in pinned="
            )
    mocap = data.mocap_pos.copy(), data.mocap_quat.copy()
    machine = Machine(model, data.qpos.copy(), mocap, touching(model, data), pins, stuck)
    matrices = {"J_T": J_T, "J_C": J_C, "active": active, "gear": gear, "rows": rows}
    return computed(Jacobians, **matrices, closure_residual=residual, machine=machine)


def _driven(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[NDArray[np.intp], Array, Array]:
    """Active velocities, their gears, and the rows (E, nv) of those that are no joint."""
    active = simple_velocities(model)
    if active is not None and len(active):
        return active, model.actuator_gear[:, 0].copy(), np.zeros((0, model.nv))
    of_model = drives(model)
    if not of_model:
        raise ModelError("the model has no enabled actuator, so nothing can be commanded: add one")
    extra = extra_drives(of_model)
    after, first = count(model.nv), model.jnt_dofadr
    active = [next(after) if d.joint is None else int(first[d.joint]) for d in of_model]
    gear = np.array([drive.gear[0] for drive in of_model])
    return np.array(active, dtype=np.intp), gear, drive_rows(model, data, extra)


def _task_rows(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    tasks: list[Task],
    axes: str | None,
    extra: int,
) -> tuple[Array, dict[Task, slice]]:
    to_axes, parts, rows, start = to_axes_of(model, data, axes), [], {}, 0
    for task in tasks:
        velocity = task_jacobian(model, data, task)
        parts.append((to_axes @ velocity.reshape(-1, 3, model.nv)).reshape(velocity.shape))
        rows[task] = slice(start, start + len(velocity))
        start += len(velocity)
    if extra:
        parts = [np.hstack([part, np.zeros((len(part), extra))]) for part in parts]
    return parts[0] if len(parts) == 1 else np.vstack(parts), rows


def _with_transmissions(forbidden: list[Array], extra: Array) -> Array:
    """All rows; each transmission has one: row qvel less its own velocity is zero."""
    closures, *others = forbidden
    if not len(extra) and not others:
        return closures
    E = len(extra)
    blocks = [
        np.hstack([closures, np.zeros((len(closures), E))]),
        np.hstack([extra, -np.eye(E)]),
    ]
    return np.vstack(blocks + [np.hstack([rows, np.zeros((len(rows), E))]) for rows in others])


def _moves(J_T: Array, J_C: Array, active: NDArray[np.intp]) -> bool:
    """Whether any active velocity has to do with these rows, through whatever closures."""
    reached = np.asarray(J_T.any(axis=0))
    links = None
    while not reached[active].any():
        links = J_C != 0.0 if links is None else links
        linked = np.asarray(reached | ((links @ reached) @ links))
        if (linked == reached).all():
            return False
        reached = linked
    return True
