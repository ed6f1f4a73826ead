"""Reading the Jacobians of any MJCF model, once or at every tick."""

from collections.abc import Iterable, Sequence
from copy import copy
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

import argument_checks as check
from sim.array import Array
from sim.closing.equalities import Closures, active_closures, equality_name, left_out
from sim.closing.hold import Pin, pins_of
from sim.errors import ClosureError, ModelError
from sim.kinematics.jacobian import PLACE, Jacobians, JacobianViews, Machine
from sim.kinematics.structure import (
    Kept,
    Structure,
    active_velocities,
    rows_at,
    variables_of,
    written,
)
from sim.kinematics.task import Task, located_axes, located_tasks
from sim.mjcf.frame import Body
from sim.mjcf.joints import turning
from sim.mjcf.limits import stuck_names
from sim.mjcf.model import bring_up_to_date, check_state

CLOSURE_TOLERANCE = 1e-3
"""Largest gap of a closure, [m] or [rad], at which Jacobians are taken."""
_ROUND_OFF = 1e-13
"""Part of the largest entry of a Jacobian, or of 1, that is zero but for round-off."""


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

    Names are looked up when it is made. Which equalities and actuators count is read anew whenever
    `data.eq_active`, `opt.disableactuator` or `opt.disableflags` change, and only then whether some
    actuator moves each task. After any other change of the model, make another reader.
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
        self._model = model
        self._tasks = located_tasks(model, site, located_axes(model, axes))
        self._pins = pins_of(model, pinned)
        self._stuck = stuck_names("stuck_at_limits", stuck_at_limits)
        unlimited = isinstance(closure_tolerance, float) and closure_tolerance == np.inf
        self._tolerance = closure_tolerance
        if not unlimited:
            self._tolerance = check.number("closure_tolerance", closure_tolerance, 0.0)
        self._variables = variables_of(model, active)
        ends = np.cumsum([0, *(len(located.angular) for located in self._tasks.values())]).tolist()
        self._rows = dict(zip(self._tasks, map(slice, ends, ends[1:]), strict=True))
        self._known = dict[tuple[object, ...], Structure]()
        self._views, self._spare = Kept(), Kept()

    def __getstate__(self) -> dict[str, Any]:
        """Without what is found again: matrices and their views would be copied apart."""
        return vars(self) | {"_known": {}, "_views": {}, "_spare": {}}

    def read(self, data: mujoco.MjData) -> JacobianViews:
        """Views of the Jacobians, for the tick of a loop; the next reading overwrites them.

        One reader serves one thread so; :meth:`at` serves any number. Arguments and errors are
        those of :meth:`at`.
        """
        now, residual = self._known_at(data)
        to = written(now, data, self._views)
        self._views[now, len(to.limits)] = to
        return JacobianViews(to.J_T, to.J_C, now.active, residual, now.error_bound(residual))

    def at(self, data: mujoco.MjData) -> Jacobians:
        """The Jacobians at the present `data.qpos`, as :func:`jacobians` returns them."""
        now, residual = self._known_at(data)
        J_T, J_C = rows_at(now, data, self._spare)
        place = np.empty(mujoco.mj_stateSize(self._model, PLACE))
        mujoco.mj_getState(self._model, data, place, PLACE)
        fields = {"structure": now, "place": check.read_only(place), "residual": residual}
        return check.made(
            Jacobians,
            J_T=J_T,
            J_C=J_C,
            active=now.active,
            gear=now.gear,
            rows=self._rows.copy(),
            closure_residual=residual,
            machine=check.made(Machine, **fields, J_T=J_T, J_C=J_C),
        )

    def _known_at(self, data: mujoco.MjData) -> tuple[Structure, float]:
        """Bring a state up to date: what is known of its equalities, and their largest gap."""
        model = self._model
        check_state(model, data)
        bring_up_to_date(model, data)
        opt, closures = model.opt, b""
        if model.neq:
            closures = data.eq_active.tobytes() + data.efc_id[: data.ne].tobytes()
        key = closures, opt.disableactuator, opt.disableflags
        known = self._known.get(key)
        closed = active_closures(model, data) if known is None else known.closures
        residual = closed.largest_gap(data)
        if residual > self._tolerance:
            name = equality_name(model, closed.worst(data))
            raise ClosureError(name, residual, "call sim.assemble(model, data)")
        if known is None:
            known = self._known[key] = self._found(data, closed)
        return known, residual

    def _found(self, data: mujoco.MjData, closed: Closures) -> Structure:
        """What no pose changes, where something active moves each task."""
        model, known = self._model, (self._model, self._tasks, self._pins, self._stuck, closed)
        velocities = active_velocities(model, self._variables)
        now = Structure(*known, (), *velocities)
        resting = self._resting(now, data)
        if resting:  # rows of what is stretched are zero here, and elsewhere are not
            resting = self._resting(now, _elsewhere(model, data))
        if resting:
            raise ModelError(
                f"no actuator moves {check.shown(resting[0])}: name another task, what its "
                "mechanism stands on in pinned=, or joints that are variables in active="
            )
        frames = [frame for located in self._tasks.values() for frame in located.frames]
        frames += [pin.frame for pin in self._pins]
        return Structure(*known, left_out(model, data, frames), *velocities)

    def _resting(self, now: Structure, data: mujoco.MjData) -> list[Task]:
        """Tasks of which no active velocity moves anything, through whatever closures."""
        J_T, J_C = rows_at(now, data, {})
        return [task for task, own in self._rows.items() if _unmoved(J_T[own], J_C, now.active)]


def _elsewhere(model: mujoco.MjModel, data: mujoco.MjData) -> mujoco.MjData:
    """A state near by where no entry of a Jacobian vanishes that does not at every pose."""
    there, size = copy(data), np.where(turning(model), 0.3, 0.1 * model.stat.extent)
    motion = size * np.random.default_rng(0).uniform(0.5, 1.5, size=model.nv)
    mujoco.mj_integratePos(model, there.qpos, motion, 1.0)
    bring_up_to_date(model, there)
    return there


def _unmoved(J_T: Array, J_C: Array, active: NDArray[np.intp]) -> bool:
    """Whether no active velocity has to do with these rows, through whatever closures."""
    reached = np.asarray((np.abs(J_T) > _ROUND_OFF * np.abs(J_T).max(initial=1.0)).any(axis=0))
    links = np.abs(J_C) > _ROUND_OFF * np.abs(J_C).max(initial=1.0)
    while not reached[active].any():
        linked = np.asarray(reached | ((links @ reached) @ links))
        if (linked == reached).all():
            return True
        reached = linked
    return False
