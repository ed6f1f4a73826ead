"""Reading the Jacobians of any MJCF model, once or at every tick."""

import copy
from collections.abc import Callable, Iterable, Sequence
from functools import partial

import mujoco
import numpy as np

import argument_checks as check
from sim.array import Array
from sim.closing.equalities import active_closures, equality_name
from sim.closing.pin import Pin, pin_rows, pins_of
from sim.errors import ClosureError, ModelError
from sim.kinematics.entry_accuracy import EntryAccuracy, Natural, frames_of
from sim.kinematics.jacobian import Jacobians
from sim.kinematics.machine import Machine
from sim.kinematics.pose import computed
from sim.kinematics.structure import Structure, bring_up_to_date, structure, unmoved
from sim.kinematics.task import Task, located_axes, located_task, task_list
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

    Raises:
        ClosureError: A closure is open farther than the tolerance.
        ModelError: A name that does not exist; a model without enabled actuators; a task that no
            actuator moves; an actuator or an active equality that is no velocity; closures that
            the model's flags switch off, or that sleep.
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
    ) -> None:
        """Look up the names; arguments and errors are those of :func:`jacobians`."""
        self._model = check.instance("model", model, mujoco.MjModel)
        tasks = task_list(model, site)
        self._tasks = [(task, located_task(model, task)) for task in tasks]
        self._pins = pins_of(model, pinned)
        self._stuck = stuck_names("stuck_at_limits", stuck_at_limits)
        unlimited = isinstance(closure_tolerance, float) and closure_tolerance == np.inf
        self._tolerance = closure_tolerance
        if not unlimited:
            self._tolerance = check.number("closure_tolerance", closure_tolerance)
        self._axes = None if axes is None else located_axes(model, axes)
        self._structures: dict[tuple[object, ...], Structure] = {}
        self._naturals: dict[tuple[object, ...], Natural] = {}
        self._machines: dict[tuple[object, ...], Machine] = {}

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
        opt, equalities = model.opt, data.efc_id[: data.ne].tobytes() if model.neq else b""
        key = data.eq_active.tobytes(), equalities, opt.disableactuator, opt.disableflags
        known = self._structures.get(key)
        closed = active_closures(model, data) if known is None else known.closures
        residual, worst = closed.largest_gap(data)
        if residual > self._tolerance:
            name = equality_name(model, worst)
            raise ClosureError(name, residual, "call sim.assemble(model, data)")
        now = structure(model, closed) if known is None else known
        J_T, rows = self._task_rows(data, len(now.extra))
        J_C = self._forbidden(data, now)
        if not check.is_moderate(J_C):
            raise ModelError("an equality or a transmission of the model is not finite")
        if known is None:
            if resting := [t for t, own in rows.items() if unmoved(J_T[own], J_C, now.active)]:
                raise ModelError(
                    f"no actuator moves {check.shown(resting[0])}: name another task, or what its "
                    "mechanism stands on in pinned="
                )
            self._structures[key], self._naturals[key] = now, self._natural(now, rows)
        accuracy = computed(
            EntryAccuracy,
            natural=self._naturals[key],
            residual=residual,
            jacobians=(J_T, J_C),
            reader=partial(self._read_anew, data.qpos.copy(), _outside(data)),
        )
        return computed(
            Jacobians,
            J_T=J_T,
            J_C=J_C,
            active=now.active,
            gear=now.gear,
            rows=rows,
            closure_residual=residual,
            machine=self._machine(data, key),
            accuracy=accuracy,
        )

    def _natural(self, now: Structure, rows: dict[Task, slice]) -> Natural:
        tasks = [(located.frame, located.root) for _, located in self._tasks]
        is_angular = [
            np.arange(own.stop - own.start) < (own.stop - own.start) - 3 for own in rows.values()
        ]
        frames = frames_of(self._model, now.closures, self._pins, tasks)
        return Natural(
            self._model, frames, now.closures, now.extra, self._pins, np.concatenate(is_angular)
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

    def _task_rows(self, data: mujoco.MjData, extra: int) -> tuple[Array, dict[Task, slice]]:
        parts, rows, start = [], {}, 0
        for task, located in self._tasks:
            velocity = located.jacobian(self._model, data)
            if self._axes is not None:
                blocks = velocity.reshape(-1, 3, velocity.shape[1])
                velocity = (self._axes.rotation(data).T @ blocks).reshape(velocity.shape)
            parts.append(velocity)
            rows[task] = slice(start, start + len(velocity))
            start += len(velocity)
        J_T = parts[0] if len(parts) == 1 else np.vstack(parts)
        return np.hstack([J_T, np.zeros((start, extra))]) if extra else J_T, rows

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
            blocks.append(pin_rows(model, data, self._pins))
        if self._stuck:
            blocks.append(stuck_rows(model, data, self._stuck))
        if not E:
            return np.vstack(blocks)
        mujoco.mj_transmission(model, data)
        wide = [np.hstack([rows, np.zeros((len(rows), E))]) for rows in blocks]
        driven = np.hstack([drive_rows(model, data, now.extra), -np.eye(E)])
        return np.vstack([wide[0], driven, *wide[1:]])

    def _machine(self, data: mujoco.MjData, key: tuple[object, ...]) -> Machine:
        model, mocap = self._model, _NO_MOCAP
        if model.nmocap:
            mocap = data.mocap_pos.copy(), data.mocap_quat.copy()
        machine = computed(
            Machine,
            model=model,
            qpos=data.qpos.copy(),
            mocap=mocap,
            pinned=self._pins,
            stuck=self._stuck,
        )
        self._machines[key] = machine.as_at(self._machines.get(key, machine))
        return machine


def _outside(data: mujoco.MjData) -> tuple[Array, ...]:
    """What decides the Jacobians besides the model and the pose."""
    return data.eq_active.copy(), data.mocap_pos.copy(), data.mocap_quat.copy()


_NO_MOCAP = np.zeros((0, 3)), np.zeros((0, 4))
