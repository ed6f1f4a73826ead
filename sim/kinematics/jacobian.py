"""Task and constraint Jacobians of any MJCF model, for one pose or each tick; their accuracy."""

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
from sim.closing.fixed import Pin, pins_of
from sim.errors import ModelError
from sim.kinematics.structure import Cache, Structure, active_velocities, rows_at, variables_of
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
"""Entries below this fraction of the largest entry of a Jacobian, or of 1, are round-off."""
_POINTS = int(mujoco.mjtEq.mjEQ_CONNECT), int(mujoco.mjtEq.mjEQ_WELD)
_OF_JOINT = int(mujoco.mjtWrap.mjWRAP_JOINT)
_UNLOADED_M = 1e-9
"""Elongation [m] below which a tendon counts as unloaded."""
_ROUND_OFF = 1e-14
"""Differences below this fraction of the largest entry are round-off."""
_STATE = mujoco.mjtState
_PLACE = int(
    _STATE.mjSTATE_QPOS
    | _STATE.mjSTATE_EQ_ACTIVE
    | _STATE.mjSTATE_MOCAP_POS
    | _STATE.mjSTATE_MOCAP_QUAT
)
"""State components that determine the Jacobians of a model."""


class Names(NamedTuple):
    """Names of the velocities and actuators of a mechanism.

    Attributes:
        velocities: Joint, tendon or actuator of each of the N velocities; those of a ball or free
            joint share a name, and a joint without a name has "".
        actuators: Actuators that drive each active velocity; none for a variable without one.
    """

    velocities: tuple[str, ...]
    actuators: tuple[tuple[str, ...], ...]


@dataclass(frozen=True, eq=False)
class Jacobians:
    """Jacobians of a MuJoCo model, v = J_T u and 0 = J_C u, of N generalized velocities u.

    The velocities u are MuJoCo's qvel (nv,), then one for each transmission that is no slide or
    hinge joint. Further properties are computed on first use. Errors are in the unit of the entry;
    the natural unit is 1 rad for angles and the mechanism's length for lengths.

    Attributes:
        J_T: Task Jacobian, shape (m, N); for a frame, the twist [angular; linear] of its origin,
            [rad]/[s] and [m]/[s].
        J_C: Constraint Jacobian, shape (c, N): rows of the active equalities, then of
            transmissions, pins and limits; rows may be redundant.
        active: Velocity index of each active velocity, in actuator order, shape (n,).
        gear: Gear ratio of the first actuator of each, never zero, shape (n,).
        rows: Rows of J_T of each task.
        closure_residual: Largest gap of the closures, [m] or [rad].
        structure: Pose-independent structure of the Jacobians.
        place: State that determines the Jacobians, as returned by `mj_getState`.
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
        """Error bounds and natural units of the entries, which are properties of this object."""
        return self

    @property
    def drives(self) -> tuple[Drive, ...]:
        """Drive of each active velocity, in actuator order."""
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
        """Accuracy of the model's geometry as one number, in rad or relative length.

        It is the rounding of the model's numbers, or a tenth of the effect of the closures' gaps on
        J_C if that is larger: `ConstrainedSystem(geometry_accuracy=...)` treats ten times the
        accuracy as zero. `accuracy` has bounds for each entry.
        """
        size = float(np.linalg.norm(self.J_C))
        of_gaps = 0.1 * self.closure_residual / size if size else 0.0
        return max(of_gaps, written_accuracy(self._model))

    @property
    def error_bound(self) -> float:
        """Bound of the errors of all entries, in natural units."""
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
            if kind in _POINTS:  # rows of couplings do not depend on their gaps
                gaps[rows] = self.J_C[rows].any(axis=0)
        gaps *= self.closure_residual / of.length * self.constraint_units[:, None]
        return check.read_only(self._of_rounding[1] + gaps / self.velocity_units)

    @cached_property
    def _of_rounding(self) -> tuple[Array, Array]:
        """Sums of the changes of J_T and J_C by half a unit of the last digit of each number."""
        errors = np.zeros(self.J_T.shape), np.zeros(self.J_C.shape)
        if self.structure.roundings:
            of, cache = self.structure.copied(), Cache()
            model = of.model
            mujoco.mj_setState(model, data := mujoco.MjData(model), self.place, _PLACE)

            def read() -> tuple[Array, Array]:
                bring_up_to_date(model, data)
                return rows_at(of, data, cache)

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
        """Stiffness matrix of the springs, (N, N); None if one is not linear in the joint motion.

        A loaded spatial tendon is not, since its force rotates with it.
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
        """Least and greatest force along each active velocity, shape (n, 2), [N] or [N m].

        It is zero for variables without an actuator.
        """
        ranges = [drive.force_range for drive in self.drives]
        ranges += [(0.0, 0.0)] * self.structure.variables
        return check.read_only(np.array(ranges).reshape(-1, 2))

    @cached_property
    def one_sided(self) -> Array:
        """Direction 1 or -1 if an active velocity's actuators push only that way, else 0, (n,)."""
        signs = [drive.one_sided for drive in self.drives] + [0] * self.structure.variables
        return check.read_only(np.array(signs, dtype=int))

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """Sentences on effects that the Jacobians leave out."""
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
            f'{limit.kind} "{limit.name}" rests on its limit and is treated as free: '
            f'stuck_at_limits=["{limit.name}"] treats it as stuck'
            for limit in at_limits(self._model, self._data)
            if not stuck or limit.name not in stuck
        ]

    def _contact_warnings(self) -> list[str]:
        model = self._model
        rigid = model.body_weldid  # bodies without a joint between them are one
        pinned = {rigid[pin.frame.body] for pin in self.structure.pins}
        return [
            f'"{name_of(model.body(b))}" touches "{name_of(model.body(a))}" and is treated '
            "as free: pinned= fixes it"
            for a, b in sorted(touching(model, self._data))
            if not {rigid[a], rigid[b]} & pinned
        ]

    def _other_warnings(self) -> list[str]:
        """List warnings of disabled or one-sided actuators, and of dropped site offsets."""
        model = self._model
        at_body = model.site_sameframe == mujoco.mjtSameFrame.mjSAMEFRAME_BODY
        dropped = np.flatnonzero(at_body & model.site_pos.any(axis=1))
        actuators = range(model.nactuator)
        texts: dict[str, list[str]] = {
            "switched off by opt.disableactuator, so not active: ": [
                name_of(model.actuator(k)) for k in actuators if is_disabled(model, k)
            ],
            "actuated in one direction only, which the mappings do not consider: ": [
                drive.name for drive in self.drives if drive.one_sided
            ],
            "placed at the origins of their bodies, because MuJoCo drops site offsets below 1e-6 "
            "length units (state the model in a smaller unit): ": [
                name_of(model.site(k)) for k in dropped
            ],
        }
        return [text + listed(names) for text, names in texts.items() if names]


class JacobianViews(NamedTuple):
    """Read-only views of :class:`Jacobians` for one tick; the next reading overwrites them.

    `active` is the same array as long as the same equalities and actuators are active.
    `error_bound` bounds the errors of all entries, in natural units.
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
    """Compute the Jacobians at the present `data.qpos`; see :class:`JacobianReader` for loops.

    All joints are supported; connect, weld, joint and tendon equalities; actuators on joints,
    tendons, sites and slider-cranks. Dry friction is left out, and so are contacts and limits,
    unless `pinned` or `stuck_at_limits` includes them.

    Args:
        model: Any model.
        data: State, for example from :func:`assemble`; equalities are those of `eq_active`.
            Frames, tendons and rows of equalities in it are brought up to date; contacts and the
            mass matrix are not.
        site: Task: name of a site or, if there is none, of a body; :class:`Body`,
            :class:`CenterOfMass` or :class:`Relative`; or several, whose rows are stacked.
        axes: Site whose axes express velocities; None is the world.
        pinned: Frames that do not move, such as standing feet: names of sites, :class:`Body`, or
            :class:`Pin`.
        stuck_at_limits: Joints and tendons on their limits that count as stuck, in both
            directions: none (False), all (True), or those of these names.
        closure_tolerance: Largest gap of a closure, [m] or [rad]. A gap up to 1 mm changes the
            Jacobians by no more than its own size; infinity accepts any.
        active: Joints without an actuator, by name or number, whose velocities are variables, such
            as the base of a walking robot; True is all. They follow the others in `active`.

    Raises:
        ClosureError: A closure is open farther than the tolerance.
        ModelError: A name does not exist; nothing is active; no active velocity moves a task; an
            actuator or active equality has no velocity; a variable has an actuator; or the model's
            flags switch closures off.
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
    """Reader of one model's Jacobians at successive poses, for control loops.

    Names are looked up on creation. Active equalities and actuators are updated whenever
    `data.eq_active`, `opt.disableactuator` or `opt.disableflags` change; only then it is checked
    that some actuator moves each task. After other changes of the model, create a new reader.
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
        self._structures = dict[tuple[object, ...], Structure]()
        self._view_cache, self._cache = Cache(), Cache()

    def __getstate__(self) -> dict[str, Any]:
        """Return the state without caches: views must refer to the copy's own matrices."""
        return vars(self) | {"_structures": {}, "_view_cache": {}, "_cache": {}}

    def read(self, data: mujoco.MjData) -> JacobianViews:
        """Return views of the Jacobians for one tick; the next reading overwrites them.

        Only one thread may call this, while :meth:`at` is thread-safe. Arguments and errors are
        those of :meth:`at`.
        """
        now, residual = self._structure_at(data)
        J_T, J_C = rows_at(now, data, self._view_cache, copied=False)
        return JacobianViews(J_T, J_C, now.active, residual, now.error_bound(residual))

    def at(self, data: mujoco.MjData) -> Jacobians:
        """Return the Jacobians at the present `data.qpos`, as :func:`jacobians` does."""
        return check.unchecked_record(Jacobians, **self.fields_at(data))

    def fields_at(self, data: mujoco.MjData) -> dict[str, Any]:
        """Return the fields of :class:`Jacobians` at the present `data.qpos`, for subclasses."""
        now, residual = self._structure_at(data)
        J_T, J_C = rows_at(now, data, self._cache)
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

    def _structure_at(self, data: mujoco.MjData) -> tuple[Structure, float]:
        """Bring a state up to date; return its structure and the largest gap of its closures."""
        model = self._model
        check_state(model, data)
        bring_up_to_date(model, data)
        opt, closures = model.opt, b""
        if model.neq:
            closures = data.eq_active.tobytes() + data.efc_id[: data.ne].tobytes()
        key = closures, opt.disableactuator, opt.disableflags
        structure = self._structures.get(key)
        closed = active_closures(model, data) if structure is None else structure.closures
        residual = closed.check_closed(model, data, self._tolerance)
        if structure is None:
            structure = self._structures[key] = self._new_structure(data, closed)
        return structure, residual

    def _new_structure(self, data: mujoco.MjData, closed: Closures) -> Structure:
        """Create the structure for a state, and check that an active velocity moves each task."""
        model, tasks, pins = self._model, self._tasks, self._pins
        frames = [frame for located in tasks.values() for frame in located.frames]
        omitted = left_out(model, data, [*frames, *(pin.frame for pin in pins)])
        velocities = active_velocities(model, self._variables)
        now = Structure(model, tasks, pins, self._stuck, closed, omitted, *velocities)
        # In a singular pose, such as a stretched arm, rows may be zero that are not in general.
        if self._unmoved(now, data) and (still := self._unmoved(now, _generic(model, data))):
            raise ModelError(
                f"no actuator moves {check.short_repr(still[0])}: name another task, what its "
                "mechanism stands on in pinned=, or joints that are variables in active="
            )
        return now

    def _unmoved(self, now: Structure, data: mujoco.MjData) -> list[Task]:
        """List the tasks that no active velocity moves, directly or through closures."""
        J_T, J_C = (np.abs(A) > _ZERO * np.abs(A).max(initial=1.0) for A in rows_at(now, data, {}))
        part = connected_components(J_C.T @ J_C, directed=False)[1]  # velocities tied by closures
        moves = J_T & np.isin(part, part[now.active])
        return [task for task, rows in self._rows.items() if not moves[rows].any()]


def _generic(model: mujoco.MjModel, data: mujoco.MjData) -> mujoco.MjData:
    """Return a nearby state in general position, where only structural zeros vanish."""
    there, size = copy(data), np.where(turning(model), 0.3, 0.1 * model.stat.extent)
    motion = size * np.random.default_rng(0).uniform(0.5, 1.5, size=model.nv)
    mujoco.mj_integratePos(model, there.qpos, motion, 1.0)
    bring_up_to_date(model, there)
    return there
