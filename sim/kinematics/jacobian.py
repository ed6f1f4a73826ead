"""Task and constraint Jacobians of any MJCF model, once or at every tick; their accuracy."""

from collections.abc import Iterable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

import argument_checks as check
from sim.array import Array
from sim.closing.equalities import Closures, active_closures, left_out
from sim.closing.hold import Pin, pins_of
from sim.errors import ModelError
from sim.kinematics.structure import Kept, Structure, active_velocities, rows_at, variables_of
from sim.kinematics.task import Task, located_axes, located_tasks
from sim.mjcf.accuracy import moved, written_accuracy
from sim.mjcf.drive import Drive, is_disabled
from sim.mjcf.frame import Body
from sim.mjcf.joints import is_slack, joint_stiffness, turning
from sim.mjcf.limits import at_limits, stuck_names, tendon_row, touching
from sim.mjcf.model import bring_up_to_date, check_state, listed, name_of

CLOSURE_TOLERANCE = 1e-3
"""Largest gap of a closure, [m] or [rad], at which Jacobians are taken."""
_ZERO = 1e-13
"""Part of the largest entry of a Jacobian, or of 1, that is zero but for round-off."""
_POINTS = int(mujoco.mjtEq.mjEQ_CONNECT), int(mujoco.mjtEq.mjEQ_WELD)
_OF_JOINT = int(mujoco.mjtWrap.mjWRAP_JOINT)
_UNLOADED_M = 1e-9
_ROUND_OFF = 1e-14
"""Part of the largest entry below which a difference is none."""
_STATE = mujoco.mjtState
_PLACE = int(
    _STATE.mjSTATE_QPOS
    | _STATE.mjSTATE_EQ_ACTIVE
    | _STATE.mjSTATE_MOCAP_POS
    | _STATE.mjSTATE_MOCAP_QUAT
)
"""What decides the Jacobians of a model in one state."""


class Names(NamedTuple):
    """Names of a mechanism.

    Attributes:
        velocities: The joint, tendon or actuator of each of the N velocities; those of a ball or
            free joint share one, and a joint without a name has "".
        actuators: Those that drive each active velocity; none for a variable without one.
    """

    velocities: tuple[str, ...]
    actuators: tuple[tuple[str, ...], ...]


@dataclass(frozen=True, eq=False)
class Jacobians:
    """Velocities of a MuJoCo model as v = J_T u, 0 = J_C u, with u = [qvel; other actuators'].

    N velocities: the nv of MuJoCo, then one of each transmission that is no slide or hinge joint.
    What the model says besides is computed when first asked for. Errors are in the unit of the
    entry; natural units are 1 of an angle, the mechanism's own length of a length.

    Attributes:
        J_T: Velocities of the tasks, shape (m, N): a frame has the twist [angular; linear] of its
            origin, [rad]/[s] and [m]/[s].
        J_C: Rows of the active equality constraints, shape (c, N), then of the transmissions, pins
            and limits; redundant rows are normal.
        active: Velocity index of each active velocity, in actuator order, shape (n,).
        gear: Gear ratio of its first actuator, never zero, shape (n,).
        rows: Which rows of J_T belong to which task.
        closure_residual: Largest gap of the closures, [m] or [rad].
        structure: What no pose changes.
        place: The pose, as `mj_getState` gives it.
    """

    J_T: Array
    J_C: Array
    active: NDArray[np.intp]
    gear: Array
    rows: Mapping[Task, slice]
    closure_residual: float
    structure: Structure
    place: Array

    @property
    def accuracy(self) -> "Jacobians":
        """How far each entry may be off, and natural units: what these Jacobians themselves say."""
        return self

    @property
    def drives(self) -> tuple[Drive, ...]:
        """What each active velocity is and what drives it, in actuator order."""
        return self.structure.drives

    @cached_property
    def names(self) -> Names:
        """Names of the velocities and of the actuators."""
        model, of = self._model, self.structure
        joints = [model.joint(k).name for k in model.dof_jntid]
        return Names(
            velocities=(*joints, *(drive.name for drive in of.extra)),
            actuators=(*(drive.actuators for drive in self.drives), *((),) * of.variables),
        )

    @cached_property
    def geometry_accuracy(self) -> float:
        """Accuracy of the geometry in one number, in rad or relative length, as the model shows it.

        The rounding of its numbers; or a tenth of what the gaps of the closures amount to in J_C,
        where `ConstrainedSystem(geometry_accuracy=...)` takes ten times the accuracy for zero.
        `accuracy` says it for each entry.
        """
        size = float(np.linalg.norm(self.J_C))
        of_gaps = 0.1 * self.closure_residual / size if size else 0.0
        return max(of_gaps, written_accuracy(self._model))

    @property
    def error_bound(self) -> float:
        """Bound of the errors of all entries in natural units."""
        return self.structure.error_bound(self.closure_residual)

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
        gaps *= self.closure_residual / of.length * self.constraint_units[:, None]
        return check.read_only(self._of_rounding[1] + gaps / self.velocity_units)

    @cached_property
    def _of_rounding(self) -> tuple[Array, Array]:
        """The sum of what half a unit of the last digit of each number does."""
        errors = np.zeros(self.J_T.shape), np.zeros(self.J_C.shape)
        if self.structure.roundings:
            of, kept = self.structure.copied(), Kept()
            model = of.model
            mujoco.mj_setState(model, data := mujoco.MjData(model), self.place, _PLACE)

            def read() -> tuple[Array, Array]:
                bring_up_to_date(model, data)
                return rows_at(of, data, kept)

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
        mujoco.mj_setState(self._model, data := mujoco.MjData(self._model), self.place, _PLACE)
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
        self._tolerance = closure_tolerance
        if not (isinstance(closure_tolerance, float) and closure_tolerance == np.inf):
            self._tolerance = check.number("closure_tolerance", closure_tolerance, 0.0)
        self._variables = variables_of(model, active)
        ends = np.cumsum([0, *(len(located.angular) for located in self._tasks.values())]).tolist()
        self._rows = dict(zip(self._tasks, map(slice, ends, ends[1:]), strict=True))
        self._known = dict[tuple[object, ...], Structure]()
        self._viewed, self._kept = Kept(), Kept()

    def __getstate__(self) -> dict[str, Any]:
        """Without what is found again: matrices and their views would be copied apart."""
        return vars(self) | {"_known": {}, "_viewed": {}, "_kept": {}}

    def read(self, data: mujoco.MjData) -> JacobianViews:
        """Views of the Jacobians, for the tick of a loop; the next reading overwrites them.

        One reader serves one thread so, and any number by :meth:`at`. Arguments and errors are
        those of :meth:`at`.
        """
        now, residual = self._known_at(data)
        J_T, J_C = rows_at(now, data, self._viewed, copied=False)
        return JacobianViews(J_T, J_C, now.active, residual, now.error_bound(residual))

    def at(self, data: mujoco.MjData) -> Jacobians:
        """The Jacobians at the present `data.qpos`, as :func:`jacobians` returns them."""
        return check.unchecked_record(Jacobians, **self.fields_at(data))

    def fields_at(self, data: mujoco.MjData) -> dict[str, Any]:
        """Fields of :meth:`at`, for a record that has more."""
        now, residual = self._known_at(data)
        J_T, J_C = rows_at(now, data, self._kept)
        place = np.empty(mujoco.mj_stateSize(self._model, _PLACE))
        mujoco.mj_getState(self._model, data, place, _PLACE)
        return {
            "J_T": J_T,
            "J_C": J_C,
            "active": now.active,
            "gear": now.gear,
            "rows": self._rows.copy(),
            "closure_residual": residual,
            "structure": now,
            "place": check.read_only(place),
        }

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
        residual = closed.check_closed(model, data, self._tolerance)
        if known is None:
            known = self._known[key] = self._found(data, closed)
        return known, residual

    def _found(self, data: mujoco.MjData, closed: Closures) -> Structure:
        """What no pose changes, where something active moves each task."""
        model, tasks, pins = self._model, self._tasks, self._pins
        frames = [frame for located in tasks.values() for frame in located.frames]
        beside = left_out(model, data, [*frames, *(pin.frame for pin in pins)])
        velocities = active_velocities(model, self._variables)
        now = Structure(model, tasks, pins, self._stuck, closed, beside, *velocities)
        # Rows of what is stretched are zero here, and elsewhere are not.
        if self._resting(now, data) and (resting := self._resting(now, _elsewhere(model, data))):
            raise ModelError(
                f"no actuator moves {check.short_repr(resting[0])}: name another task, what its "
                "mechanism stands on in pinned=, or joints that are variables in active="
            )
        return now

    def _resting(self, now: Structure, data: mujoco.MjData) -> list[Task]:
        """Tasks of which no active velocity moves anything, through whatever closures."""
        J_T, J_C = (np.abs(A) > _ZERO * np.abs(A).max(initial=1.0) for A in rows_at(now, data, {}))
        part = connected_components(J_C.T @ J_C, directed=False)[1]  # velocities tied by closures
        moves = J_T & np.isin(part, part[now.active])
        return [task for task, own in self._rows.items() if not moves[own].any()]


def _elsewhere(model: mujoco.MjModel, data: mujoco.MjData) -> mujoco.MjData:
    """A state near by where no entry of a Jacobian vanishes that does not at every pose."""
    there, size = copy(data), np.where(turning(model), 0.3, 0.1 * model.stat.extent)
    motion = size * np.random.default_rng(0).uniform(0.5, 1.5, size=model.nv)
    mujoco.mj_integratePos(model, there.qpos, motion, 1.0)
    bring_up_to_date(model, there)
    return there
