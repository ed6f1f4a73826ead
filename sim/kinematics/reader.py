"""Reading the Jacobians of any MJCF model, once or at every tick."""

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Any, NamedTuple

import mujoco
import numpy as np

import argument_checks as check
from sim.array import Array
from sim.closing.equalities import Closures, active_closures, equality_name, left_out
from sim.closing.pin import Pin, located_pins, pins_of
from sim.errors import ClosureError, ModelError
from sim.kinematics.entry_accuracy import EntryAccuracy, Natural, frames_of
from sim.kinematics.jacobian import Jacobians, JacobianViews
from sim.kinematics.machine import Machine, OfAnyPose
from sim.kinematics.rows import Matrices, RowSource, task_rows
from sim.kinematics.structure import (
    Structure,
    elsewhere,
    structure,
    unmoved,
    variables_of,
)
from sim.kinematics.task import Task, located_axes, located_task, task_list
from sim.mjcf.frame import Body
from sim.mjcf.limits import stuck_names
from sim.mjcf.model import bring_up_to_date, check_state

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
        site: The task: name of a site or, if there is none, of a body; :class:`Body`,
            :class:`CenterOfMass` or :class:`Relative`; or several, whose rows are stacked.
        axes: Site whose axes velocities are expressed in; None is the world.
        pinned: Frames that stay where they are, as feet that stand: names of sites,
            :class:`Body`, or :class:`Pin`.
        stuck_at_limits: Which of the joints and tendons that rest on their limits count as stuck,
            in both directions: none, all (True), or those of these names.
        closure_tolerance: Largest gap of a closure, [m] or [rad]. Up to 1 mm a gap changes the
            Jacobians by no more than its own size; infinity takes any.
        active: Velocities that are variables though they have no actuator, as those of the base of
            a robot that walks: names or numbers of joints, which mean all their velocities; True is
            every one without an actuator. They follow the others in `active`.

    Raises:
        ClosureError: A closure is open farther than the tolerance.
        ModelError: A name that does not exist; a model in which nothing is active; a task that
            nothing active moves; an actuator or an active equality that is no velocity; a variable
            that has an actuator; closures that the model's flags switch off.
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

    :meth:`at` gives arrays of their own, and all that a model says besides; :meth:`read` gives
    views, which costs less.

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
        check.instance("model", model, mujoco.MjModel)
        tasks = [(task, located_task(model, task)) for task in task_list(model, site)]
        self._located = tuple(located for _, located in tasks)
        self._pins = pins_of(model, pinned)
        stuck = stuck_names("stuck_at_limits", stuck_at_limits)
        unlimited = isinstance(closure_tolerance, float) and closure_tolerance == np.inf
        self._tolerance = closure_tolerance
        if not unlimited:
            self._tolerance = check.number("closure_tolerance", closure_tolerance)
        self._variables = variables_of(model, active)
        in_axes = None if axes is None else located_axes(model, axes)
        pins, rows = located_pins(model, self._pins), task_rows(tasks)
        self._source = RowSource(model, rows, in_axes, pins, stuck, np.zeros((0, model.nv)))
        self._rows = {task: each.rows for (task, _), each in zip(tasks, rows, strict=True)}
        self._known: dict[tuple[object, ...], _Known] = {}

    def __getstate__(self) -> dict[str, Any]:
        """Without what is found again: matrices and their views would be copied apart."""
        return vars(self) | {"_known": {}}

    def read(self, data: mujoco.MjData) -> JacobianViews:
        """The same as :meth:`at` for the tick of a loop: views that the next reading overwrites.

        MuJoCo writes the rows into matrices that the reader keeps. One reader serves one thread
        so; `at` serves any number.

        Args:
            data: As of :meth:`at`.

        Raises:
            ClosureError, ModelError, ValueError, TypeError: As :func:`jacobians`.
        """
        known, residual = self._known_at(data)
        now, stuck = known.structure, self._source.stuck_rows(data)
        kept = known.kept.get(len(stuck))
        if kept is None:
            to = self._source.blank(now, len(stuck))
            kept = to, check.read_only(to.J_T.view()), check.read_only(to.J_C.view())
            known.kept[len(stuck)] = kept
        to, J_T, J_C = kept
        self._source.write(data, now, stuck, to)
        return JacobianViews(J_T, J_C, now.active, residual, known.natural.error_bound(residual))

    def at(self, data: mujoco.MjData) -> Jacobians:
        """The Jacobians at the present `data.qpos`, as :func:`jacobians` returns them.

        Args:
            data: A state of the model; what :func:`jacobians` does to it is done.

        Raises:
            ClosureError, ModelError, ValueError, TypeError: As :func:`jacobians`.
        """
        model, (known, residual) = self._source.model, self._known_at(data)
        now = known.structure
        J_T, J_C = self._source.rows(data, now, known.spare)
        qpos, outside = check.read_only(data.qpos.copy()), _outside(model, data)
        return check.made(
            Jacobians,
            J_T=check.read_only(J_T),
            J_C=check.read_only(J_C),
            active=now.active,
            gear=now.gear,
            rows=self._rows.copy(),
            closure_residual=residual,
            machine=check.made(
                Machine,
                model=model,
                qpos=qpos,
                mocap=outside[1:],
                pinned=self._pins,
                stuck=self._source.stuck,
                variables=now.variables,
                of_any_pose=known.of_any_pose,
            ),
            accuracy=check.made(
                EntryAccuracy,
                natural=known.natural,
                residual=residual,
                jacobians=(J_T, J_C),
                reader=partial(_read_anew, self._source, now, qpos, outside),
            ),
        )

    def _known_at(self, data: mujoco.MjData) -> tuple["_Known", float]:
        """Bring a state up to date: what is known of its equalities, and their largest gap."""
        model = self._source.model
        check_state(model, data)
        bring_up_to_date(model, data)
        opt, closures = model.opt, b""
        if model.neq:
            closures = data.eq_active.tobytes() + data.efc_id[: data.ne].tobytes()
        key = closures, opt.disableactuator, opt.disableflags
        known = self._known.get(key)
        closed = active_closures(model, data) if known is None else known.structure.closures
        residual = closed.largest_gap(data)
        if residual > self._tolerance:
            name = equality_name(model, closed.worst(data))
            raise ClosureError(name, residual, "call sim.assemble(model, data)")
        if known is None:
            known = self._known[key] = self._found(data, closed)
        return known, residual

    def _found(self, data: mujoco.MjData, closed: Closures) -> "_Known":
        """What no pose changes, where something active moves each task."""
        model, now = self._source.model, structure(self._source.model, closed, self._variables)
        J_T, J_C = self._source.rows(data, now, spare := {})
        resting = [t for t, own in self._rows.items() if unmoved(J_T[own], J_C, now.active)]
        if resting:  # rows of what is stretched are zero here, and elsewhere are not
            J_T, J_C = self._source.rows(elsewhere(model, data), now, {})
            resting = [t for t in resting if unmoved(J_T[self._rows[t]], J_C, now.active)]
        if resting:
            raise ModelError(
                f"no actuator moves {check.shown(resting[0])}: name another task, what its "
                "mechanism stands on in pinned=, or joints that are variables in active="
            )
        frames = [frame for located in self._located for frame in located.frames]
        angular = [each for located in self._located for each in located.angular]
        pinned = [pin.frame for pin in self._source.pins]
        of_any_pose = OfAnyPose(model, now.variables, left_out(model, data, [*frames, *pinned]))
        read = frames_of(model, now.closures, self._pins, frames)
        is_turn = np.array(angular, dtype=bool)
        natural = Natural(model, read, now.closures, now.extra, self._pins, is_turn)
        return _Known(now, natural, of_any_pose, {}, spare)


class _Known(NamedTuple):
    """What a reader has found of one set of equalities and actuators.

    Attributes:
        structure: Of the Jacobians.
        natural: Of their accuracy.
        of_any_pose: Of the model.
        kept: By the number of rows of limits, matrices, and views of J_T and J_C.
        spare: Likewise, matrices of which nobody has a view.
    """

    structure: Structure
    natural: Natural
    of_any_pose: OfAnyPose
    kept: dict[int, tuple[Matrices, Array, Array]]
    spare: dict[int, Matrices]


def _read_anew(
    source: RowSource,
    now: Structure,
    qpos: Array,
    outside: tuple[Array, ...],
    data: mujoco.MjData,
) -> Callable[[], tuple[Array, Array]]:
    """What reads J_T and J_C at one pose in a state of a model like this, whose numbers move."""
    model, spare = data.model, {}
    source = source._replace(model=model)
    data.qpos[:] = qpos
    data.eq_active[:], data.mocap_pos[:], data.mocap_quat[:] = outside

    def read() -> tuple[Array, Array]:
        bring_up_to_date(model, data)
        return source.rows(data, now, spare)

    return read


def _outside(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[Array, Array, Array]:
    """What decides the Jacobians besides model and pose: active equalities, mocap bodies."""
    active = data.eq_active.copy() if model.neq else _NO_EQUALITY
    if not model.nmocap:
        return active, *_NO_MOCAP
    return active, data.mocap_pos.copy(), data.mocap_quat.copy()


_NO_EQUALITY = np.zeros(0, dtype=bool)
_NO_MOCAP = np.zeros((0, 3)), np.zeros((0, 4))
