"""Reading the Jacobians of any MJCF model, once or at every tick."""

import copy
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import NamedTuple

import mujoco
import numpy as np

import argument_checks as check
from sim.array import Array
from sim.closing.equalities import active_closures, equality_name
from sim.closing.pin import Pin, located_pins, pin_rows, pins_of
from sim.errors import ClosureError, ModelError
from sim.kinematics.entry_accuracy import EntryAccuracy, Natural, frames_of
from sim.kinematics.jacobian import Jacobians
from sim.kinematics.machine import Machine, OfAnyPose
from sim.kinematics.pose import made
from sim.kinematics.structure import Structure, bring_up_to_date, structure, unmoved, variables_of
from sim.kinematics.task import HasRows, LocatedRows, Task, located_axes, located_task, task_list
from sim.mjcf.frame import Body
from sim.mjcf.limits import stuck_names, stuck_rows
from sim.mjcf.model import check_state
from sim.mjcf.transmission import drive_rows

CLOSURE_TOLERANCE = 1e-3
"""Largest gap of a closure, [m] or [rad], at which Jacobians are taken."""


def jacobians(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    site: Task | Sequence[Task],
    axes: str | None = None,
    *,
    pinned: Iterable[str | Body | Pin] = (),
    stuck_at_limits: bool | Iterable[str] = False,
    closure_tolerance: float = CLOSURE_TOLERANCE,
    active: bool | Iterable[str | int] = (),
) -> Jacobians:
    """Jacobians at the present `data.qpos`; for one pose after another: :class:`JacobianReader`.

    Joints, equalities and transmissions of every kind that has velocities: connect, weld, joint and
    tendon equalities; actuators on joints, tendons, sites and slider-cranks. Dry friction is left
    out; contacts and limits too, unless `pinned` or `stuck_at_limits` says otherwise.

    Args:
        model: Any model.
        data: Its state; `eq_active` decides which equalities count. See :func:`assemble`. Frames,
            tendons and rows of equalities in it are brought up to date; contacts and the mass
            matrix stay as they were.
        site: The task: name of a site, :class:`Body`, :class:`CenterOfMass` or :class:`Relative`;
            or several, whose rows are stacked.
        axes: Site whose axes velocities are expressed in; None is the world.
        pinned: Frames that stay where they are, as feet that stand: names of sites,
            :class:`Body`, or :class:`Pin`.
        stuck_at_limits: Which of the joints and tendons that rest on their limits count as stuck,
            in both directions: none, all (True), or those of these names.
        closure_tolerance: Largest gap of a closure, [m] or [rad]. Up to 1 mm a gap changes the
            Jacobians by no more than its own size; infinity takes any.
        active: Velocities that are variables though they have no actuator, as those of the base of
            a robot that walks: names of joints, which mean all their velocities, or velocity
            indices; True is every one without an actuator. They follow the others in `active`.

    Raises:
        ClosureError: A closure is open farther than the tolerance.
        ModelError: A name that does not exist; a model in which nothing is active; a task that
            nothing active moves; an actuator or an active equality that is no velocity; a variable
            that has an actuator; closures that the model's flags switch off, or that sleep.
        ValueError: `data.qpos` is not finite, or `data` of another model.
        TypeError: An argument is of another kind.
    """
    check_state(model, data)
    return JacobianReader(
        model,
        site,
        axes,
        pinned=pinned,
        stuck_at_limits=stuck_at_limits,
        closure_tolerance=closure_tolerance,
        active=active,
    ).at(data)


class JacobianReader:
    """The Jacobians of one model at one pose after another, as a control loop needs them.

    Names are looked up when it is made, so that a tick is mostly MuJoCo's own kinematics. Which
    equalities and actuators count is read anew whenever `data.eq_active`, `opt.disableactuator` or
    `opt.disableflags` change, and only then whether some actuator moves each task. After any other
    change of the model, make another reader.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        site: Task | Sequence[Task],
        axes: str | None = None,
        *,
        pinned: Iterable[str | Body | Pin] = (),
        stuck_at_limits: bool | Iterable[str] = False,
        closure_tolerance: float = CLOSURE_TOLERANCE,
        active: bool | Iterable[str | int] = (),
    ) -> None:
        """Look up the names; arguments and errors are those of :func:`jacobians`."""
        self._model = check.instance("model", model, mujoco.MjModel)
        tasks = task_list(model, site)
        self._tasks = [(task, located_task(model, task)) for task in tasks]
        self._rows = _rows_of(self._tasks)
        self._in_own_axes = {task for task in tasks if isinstance(task, HasRows)}
        self._pins = pins_of(model, pinned)
        self._located_pins = located_pins(model, self._pins)
        self._stuck = stuck_names("stuck_at_limits", stuck_at_limits)
        unlimited = isinstance(closure_tolerance, float) and closure_tolerance == np.inf
        self._tolerance = closure_tolerance
        if not unlimited:
            self._tolerance = check.number("closure_tolerance", closure_tolerance)
        self._variables = variables_of(model, active)
        self._axes = None if axes is None else located_axes(model, axes)
        self._known: dict[tuple[object, ...], _Known] = {}

    def at(self, data: mujoco.MjData) -> Jacobians:
        """The Jacobians at the present `data.qpos`, as :func:`jacobians` returns them.

        Args:
            data: A state of the model; what :func:`jacobians` does to it is done.

        Raises:
            ClosureError, ModelError, ValueError, TypeError: As :func:`jacobians`.
        """
        model = self._model
        check_state(model, data)
        bring_up_to_date(model, data)
        opt, closures = model.opt, b""
        if model.neq:
            closures = data.eq_active.tobytes() + data.efc_id[: data.ne].tobytes()
        key = closures, opt.disableactuator, opt.disableflags
        known = self._known.get(key)
        closed = active_closures(model, data) if known is None else known.structure.closures
        residual, worst = closed.largest_gap(data)
        if residual > self._tolerance:
            name = equality_name(model, worst)
            raise ClosureError(name, residual, "call sim.assemble(model, data)")
        now = structure(model, closed, self._variables) if known is None else known.structure
        J_T = self._task_rows(data, len(now.extra))
        J_C = self._forbidden(data, now)
        if not check.is_moderate(J_C):
            raise ModelError("an equality or a transmission of the model is not finite")
        if known is None:
            self._refuse_unmoved(J_T, J_C, now)
            of_any_pose = OfAnyPose(model, now.variables)
            known = self._known[key] = _Known(now, self._natural(now), of_any_pose)
        qpos, outside = check.read_only(data.qpos.copy()), _outside(model, data)
        return made(
            Jacobians,
            J_T=check.read_only(J_T),
            J_C=check.read_only(J_C),
            active=now.active,
            gear=now.gear,
            rows=self._rows.copy(),
            closure_residual=residual,
            machine=made(
                Machine,
                model=model,
                qpos=qpos,
                mocap=outside[1:],
                pinned=self._pins,
                stuck=self._stuck,
                variables=now.variables,
                of_any_pose=known.of_any_pose,
            ),
            accuracy=made(
                EntryAccuracy,
                natural=known.natural,
                residual=residual,
                jacobians=(J_T, J_C),
                reader=partial(self._read_anew, qpos, outside),
            ),
        )

    def _refuse_unmoved(self, J_T: Array, J_C: Array, now: Structure) -> None:
        if resting := [t for t, own in self._rows.items() if unmoved(J_T[own], J_C, now.active)]:
            raise ModelError(
                f"no actuator moves {check.shown(resting[0])}: name another task, what its "
                "mechanism stands on in pinned=, or joints that are variables in active="
            )

    def _natural(self, now: Structure) -> Natural:
        frames = [frame for _, located in self._tasks for frame in located.frames]
        angular = [each for _, located in self._tasks for each in located.angular]
        read = frames_of(self._model, now.closures, self._pins, frames)
        return Natural(
            self._model, read, now.closures, now.extra, self._pins, np.array(angular, dtype=bool)
        )

    def _read_anew(
        self, qpos: Array, outside: tuple[Array, ...], model: mujoco.MjModel
    ) -> Callable[[], tuple[Array, Array]]:
        """What reads J_T and J_C of a model like this one at one pose, however its numbers move."""
        reader, data = copy.copy(self), mujoco.MjData(model)
        reader._model, reader._tolerance = model, np.inf
        data.qpos[:] = qpos
        data.eq_active[:], data.mocap_pos[:], data.mocap_quat[:] = outside

        def read() -> tuple[Array, Array]:
            there = reader.at(data)
            return there.J_T, there.J_C

        return read

    def _task_rows(self, data: mujoco.MjData, extra: int) -> Array:
        """J_T, shape (m, nv + extra)."""
        parts = [self._task(task, located, data) for task, located in self._tasks]
        if len(parts) == 1 and not extra:
            return parts[0]
        J_T = np.concatenate(parts)
        return np.hstack([J_T, np.zeros((len(J_T), extra))]) if extra else J_T

    def _task(self, task: Task, located: LocatedRows, data: mujoco.MjData) -> Array:
        """Rows of one task per qvel, shape (k, nv)."""
        rows = located.jacobian(self._model, data)
        if self._axes is None or task in self._in_own_axes:
            return rows
        blocks = rows.reshape(-1, 3, self._model.nv)
        return (self._axes.rotation(data).T @ blocks).reshape(rows.shape)

    def _forbidden(self, data: mujoco.MjData, now: Structure) -> Array:
        """Rows of closures, transmissions, pins and limits.

        Each transmission has one: row qvel less its own velocity is zero.
        """
        model, E = self._model, len(now.extra)
        closed = now.closures.rows(model, data)
        if not E and not self._pins and not self._stuck:
            return closed
        blocks = [closed]
        if self._pins:
            blocks.append(pin_rows(model, data, self._located_pins))
        if self._stuck:
            blocks.append(stuck_rows(model, data, self._stuck))
        if not E:
            return np.vstack(blocks)
        mujoco.mj_transmission(model, data)
        wide = [np.hstack([rows, np.zeros((len(rows), E))]) for rows in blocks]
        driven = np.hstack([drive_rows(model, data, now.extra), -np.eye(E)])
        return np.vstack([wide[0], driven, *wide[1:]])


class _Known(NamedTuple):
    """What a reader has found of one set of equalities and actuators."""

    structure: Structure
    natural: Natural
    of_any_pose: OfAnyPose


def _rows_of(tasks: Iterable[tuple[Task, LocatedRows]]) -> dict[Task, slice]:
    """Which rows of J_T belong to which task."""
    rows, start = {}, 0
    for task, located in tasks:
        rows[task] = slice(start, start := start + len(located.angular))
    return rows


def _outside(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[Array, Array, Array]:
    """What decides the Jacobians besides model and pose: active equalities, mocap bodies."""
    active = data.eq_active.copy() if model.neq else _NO_EQUALITY
    if not model.nmocap:
        return active, *_NO_MOCAP
    return active, data.mocap_pos.copy(), data.mocap_quat.copy()


_NO_EQUALITY = np.zeros(0, dtype=bool)
_NO_MOCAP = np.zeros((0, 3)), np.zeros((0, 4))
