"""Compiled solution of a hierarchy at successive poses, for well-conditioned ones."""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import block_diag

import argument_checks as check
from argument_checks import Array, Indices
from argument_checks.ties import ACCURACY
from kernels import Struct, ffi, lib, pointer
from prioritized._mapping.level_specs import LevelSpecs
from prioritized._mechanism.conditioning import well_conditioned_above
from prioritized._mechanism.elimination import Partition
from prioritized._mechanism.from_model import error_bound_of
from prioritized._mechanism.geometry import Geometry
from prioritized._solver.arrays import ReadOnly, none
from prioritized._solver.limits import Limits
from prioritized._solver.rank import ROUND_OFF, largest, norm

if TYPE_CHECKING:
    from prioritized._kinematics import Kinematics


_CLEAR = ROUND_OFF / ACCURACY
"""Fraction of a scale above which a singular value is regular: every method then agrees to 1e-9."""


class TickData(NamedTuple):
    """Pose-independent data of the per-tick solver, ``tick_plan`` in ``kernels.h``.

    Attributes:
        order: Passive velocities that move, then the rates, (p + n,).
        stationary: Passive velocities that stay at rest.
        levels: Rows and targets of the levels.
        errors: Size of the errors of J_C and J_T per bound of them, and the fraction of J_C and of
            J above which a singular value is certainly not zero.
        units: Natural units of the task rows, of the loop rows, and of the velocities.
    """

    order: Indices
    stationary: Indices
    levels: "TickLevels"
    errors: tuple[float, float, float]
    units: tuple[Array, Array, Array]

    @classmethod
    def of(cls, specs: LevelSpecs, mechanism: "Kinematics") -> "TickData | None":
        """Return the data of a mechanism at any pose; None for springs or intervals."""
        system = mechanism.system
        active, is_interval = system.joints.active, any(level[0].interval for level in specs.levels)
        if is_interval or not system.is_rigid or not len(active):
            return None
        moving, stationary = _widest_last(system)
        order = np.concatenate([moving, active])
        of = system.geometry
        units = of.task_units, of.constraint_units, of.velocity_units
        return cls(order, stationary, TickLevels.of(specs), _errors(of), units)

    def for_kernel(self, c: int, N: int) -> Struct:
        """Return the data as a struct for :data:`kernels.lib` and J_C (c, N)."""
        _, _, of, (error_C, error_T, threshold), (rows_T, rows_C, velocities) = self
        m, (k, n), t = of.S.shape[1], of.R.shape, of.T.shape[1]
        return Struct(
            "tick_plan",
            m=m,
            c=c,
            N=N,
            t=t,
            p=len(self.order) - n,
            n=n,
            k=k,
            d=len(of.D),
            levels=len(of.ends),
            e=of.norm_rows,
            idles=len(self.stationary),
            order=self.order,
            idle=self.stationary,
            S=of.S,
            R=of.R if of.R.any() else None,
            D=of.D,
            T=of.T,
            weight=of.weight,
            damping=of.damping if of.damping.any() else None,
            sizes=of.sizes,
            on_rates=of.on_rates,
            ends=of.ends,
            error_C=error_C,
            error_T=error_T,
            doubt=threshold,
            task_units=rows_T,
            loop_units=rows_C,
            velocity_units=velocities,
        )


class TickLevels(NamedTuple):
    """Rows S J + R of all levels, and a weighted norm of the rates in or after the last one.

    Attributes:
        S: Shape (k, m).
        R: Shape (k, n).
        T: Targets of the rows and then, if they have weights, of the rates, per target: (., t).
        ends: End of each level, (levels,).
        damping: Damping of each level, (levels,).
        weight: Weights of the rates, (n,); None is |rates|.
        norm_rows: Number of rows of the last level that are added to the weighted norm.
        D: Directions of the task in the rows added to the norm, (d, m).
        sizes: 2-norm of S of each level, then of all directions of the task, (levels + 1,).
        on_rates: Magnitude up to which entries of R of each level are zero, (levels,).
    """

    S: Array
    R: Array
    T: Array
    ends: NDArray[np.int32]
    damping: Array
    weight: Array | None
    norm_rows: int
    D: Array
    sizes: Array
    on_rates: Array

    @classmethod
    def of(cls, specs: LevelSpecs) -> "TickLevels":
        """Convert the specification of the levels."""
        level_rows, levels, ties = specs.level_rows, specs.levels, specs.ties.A
        targets = block_diag(*(part.matrix for level in levels for part in level))
        S, R, T = map(level_rows.split, (level_rows.on_task, level_rows.on_rates, targets))
        damping, weight, rate_targets, D, norm_rows = list(specs.damping), None, [], [], 0
        none_of_task, is_norm = none((len(ties), S[0].shape[1])), R[-1].any(axis=1)
        diagonal = _diagonal(R[-1][is_norm]) if level_rows.rates_last and not damping[-1] else None
        if diagonal is not None and (diagonal.all() or (diagonal.any() and not len(ties))):
            weight, ties = diagonal, ties[:0]
            square = np.where(diagonal > 0.0, diagonal, 1.0)[:, None] ** 2
            rate_targets = [R[-1][is_norm].T @ T[-1][is_norm] / square]
            of_task = [part.S for part in levels[-1] if part.S is not None and part.matrix.any()]
            D = [directions * specs.units[0] for directions in of_task]
            S[-1], R[-1], T[-1] = S[-1][~is_norm], R[-1][~is_norm], T[-1][~is_norm]
            norm_rows = len(S[-1])
        if len(ties):
            diagonal = None if any(rows.any() for rows in R) else _diagonal(ties)
            zeros = none((len(ties), T[0].shape[1]))
            if diagonal is not None and diagonal.all():
                weight, rate_targets = diagonal, [none((len(diagonal), T[0].shape[1]))]
            else:
                S, R, T = [*S, none_of_task], [*R, ties], [*T, zeros]
                damping.append(0.0)
        ends = np.cumsum([*map(len, S)]).astype(np.int32)
        directions = [*S[: len(S) - bool(norm_rows)], *D]
        return cls(
            S=np.concatenate(S),
            R=np.concatenate(R),
            T=np.concatenate([*T, *rate_targets]),
            ends=ends,
            damping=np.array(damping),
            weight=weight,
            norm_rows=norm_rows,
            D=np.concatenate([S[0][:0], *D]),
            sizes=np.array([*map(largest, S), largest(np.concatenate(directions))]),
            on_rates=np.array([_CLEAR * norm(rows) for rows in R]),
        )


def _diagonal(rows: Array) -> Array | None:
    """Return weights w (n,) for which |rows rates| = |w rates|; None if there are none."""
    squares = rows.T @ rows
    weight = np.sqrt(squares.diagonal())
    return None if (squares != np.diag(squares.diagonal())).any() else weight


def _widest_last(system: Partition) -> tuple[Indices, Indices]:
    """Return the passive velocities that move, and those without effect on loops and task.

    Velocities of a single loop come first, which preserves zeros in the elimination.
    """
    moving = system.joints.moving
    J_T, J_C = system.geometry.J_T, system.J_C
    is_stationary = ~(J_C[:, moving].any(axis=0) | J_T[:, moving].any(axis=0))
    moving, stationary = moving[~is_stationary], moving[is_stationary]
    rows = [np.flatnonzero(column) for column in system.J_C[:, moving].T]
    widths = [int(np.ptp(indices)) if len(indices) else 0 for indices in rows]
    order = np.argsort(widths, kind="stable")  # noqa: TID251 - whole numbers
    return moving[order], stationary


def _errors(geometry: Geometry) -> tuple[float, float, float]:
    """Return the errors of J_C and J_T per bound, and the threshold of singular values."""
    clear = max(_CLEAR, well_conditioned_above(geometry.rank_tolerance))
    if geometry.accuracy is None or geometry.is_stated:
        return 0.0, 0.0, clear
    loops, task = np.sqrt(geometry.J_C.size), np.sqrt(geometry.J_T.size)
    if not len(geometry.J_C) and 0.0 < geometry.error_bound < np.inf:
        error = geometry.at_other_pose.task_error
        task = task if error is None else norm(error) / geometry.error_bound
    return float(loops), float(task), clear


class Basis(NamedTuple):
    """Properties of a mechanism that a tick depends on and that do not depend on the pose.

    Attributes:
        joints: Driven velocities (n,), and passive ones that move (p,).
        shape: Shape of J_C.
        settings: Whether loops alone determine passive velocities, the rank tolerance, whether it
            defines the accuracy, and whether the entries are exact.
    """

    joints: tuple[Indices, Indices]
    shape: tuple[int, ...]
    settings: tuple[Any, ...]

    @classmethod
    def of(cls, system: Partition) -> "Basis":
        """Return the properties of a mechanism at any pose."""
        joints, geometry = system.joints, system.geometry
        is_exact = geometry.accuracy is None
        settings = system.is_rigid, geometry.rank_tolerance, geometry.is_stated, is_exact
        return cls((joints.active, joints.moving), geometry.J_C.shape, settings)

    def matches(self, system: Partition) -> bool:
        """Return whether another mechanism has the same properties."""
        joints, *settings = Basis.of(system)
        pairs = zip(self.joints, joints, strict=True)
        return settings == list(self[1:]) and all(a is b or np.array_equal(a, b) for a, b in pairs)


@dataclass(frozen=True, eq=False)
class Tick(ReadOnly):
    """Levels of tasks of one mechanism, solved at any pose by one compiled call.

    Created by :meth:`Hierarchy.tick` and :meth:`VelocityMapping.tick`.

    Attributes:
        data: Data of the compiled solver.
        basis: Properties of the mechanism, independent of its pose, that the data depend on.
        specs: Specification of the levels.
    """

    data: TickData
    basis: Basis
    specs: LevelSpecs

    @classmethod
    def of(cls, specs: LevelSpecs, mechanism: "Kinematics") -> "Tick | None":
        """Return the tick of a mechanism; see :meth:`Hierarchy.tick`."""
        data = TickData.of(specs, mechanism)
        return None if data is None else cls(data, Basis.of(mechanism.system), specs)

    def at(self, mechanism: "Kinematics") -> "Tick | None":
        """Return the tick for this mechanism at another pose, or after other failures."""
        if self.basis.matches(mechanism.system):
            return self
        return Tick.of(self.specs.at(mechanism), mechanism)

    def __call__(
        self,
        J_T: Array,
        J_C: Array,
        targets: Array,
        velocity_limits: Limits,
        error_bound: float = 0.0,
    ) -> Array | None:
        """Return optimal velocities in the order of J_T's columns, (N,); None if ill-conditioned.

        They are those of :meth:`Hierarchy.solve` at this pose, where limits of passive velocities
        are inequality rows. None is returned if a rank may be deficient, as near singular poses; if
        a joint that affects task or loops swings freely; and if limits and loops contradict each
        other.

        Args:
            J_T: Task Jacobian at this pose, shape (m, N).
            J_C: Constraint Jacobian, shape (c, N).
            targets: Targets of all tasks of all levels, one after the other, shape (t,).
            velocity_limits: Lower and upper limit of each velocity, (N,) each, infinite if there is
                none. Those of stuck joints have no effect.
            error_bound: Bound of the errors of J_T and J_C, as of
                :class:`prioritized._mechanism.geometry.Accuracy`.
        """
        arguments = J_T, J_C, targets, velocity_limits, error_bound
        is_invalid, velocities = True, None
        is_pair = type(velocity_limits) is tuple and type(error_bound) is float
        arrays = (J_T, J_C, targets, *velocity_limits) if is_pair else ()
        if is_pair and all(type(A) is np.ndarray for A in arrays):
            is_invalid, velocities = self.of_plain(*arguments)
        return self.of_plain(*self._checked(*arguments))[1] if is_invalid else velocities

    def of_plain(
        self,
        J_T: Array,
        J_C: Array,
        targets: Array,
        velocity_limits: Limits,
        error_bound: float,
        along: Array | None = None,
    ) -> tuple[bool, Array | None]:
        """Return whether arguments need checks, and the result of a call with plain arrays.

        The task motion of the rates `along` (n,) is added to the targets of all levels but the
        first.
        """
        data, shapes, size = self._prepared
        lower, upper = velocity_limits
        if (J_T.shape, J_C.shape, targets.shape, lower.shape, upper.shape) != shapes:
            return True, None
        velocities = np.empty(self.basis.shape[1])
        workspace = ffi.NULL if size <= lib.TICK_OWN_ROOM else pointer(np.empty(size))
        try:  # checking the types would take longer
            inputs = pointer(J_T), pointer(J_C), pointer(targets)
            desired = ffi.NULL if along is None else pointer(along)
            limits = pointer(lower), pointer(upper), error_bound
            outputs = pointer(velocities), workspace
            code = lib.tick_solve(data.pointer, *inputs, desired, *limits, *outputs)
        except (KeyError, TypeError, ValueError):  # other numbers; not contiguous
            return True, None
        return code == lib.TICK_REFUSED, velocities if code == lib.TICK_SOLVED else None

    @cached_property
    def _prepared(self) -> tuple[Struct, tuple[tuple[int, ...], ...], int]:
        """Kernel struct, shapes of the arrays that it takes, and its workspace size."""
        (c, N), levels = self.basis.shape, self.data.levels
        data, m, t = self.data.for_kernel(c, N), levels.S.shape[1], levels.T.shape[1]
        return data, ((m, N), (c, N), (t,), (N,), (N,)), lib.tick_room(data.pointer)

    def at_jacobians(
        self, mechanism: Any, targets: Array, rates: Limits | None, along: Array | None = None
    ) -> Array | None:
        """Return the result of a call for Jacobians of the mechanism, as of `sim.jacobians`.

        Args:
            mechanism: Object with J_T and J_C, and their `error_bound` or `accuracy`; without
                either they are exact.
            targets: Targets as of a call.
            rates: Limits of the rates, (n,) each; None is no limits.
            along: Rates as in :meth:`of_plain`.
        """
        _, _, is_stated, _ = self.basis.settings
        bound = 0.0 if is_stated else error_bound_of(mechanism)
        J_T, J_C, limits = mechanism.J_T, mechanism.J_C, self.limits(rates)
        return self.of_plain(J_T, J_C, targets, limits, bound, along)[1]

    def limits(self, rates: Limits | None) -> Limits:
        """Return limits of all velocities, (N,) each, from those of the rates; None is no limit."""
        if rates is None:
            return self._no_limits
        (active, _), (lower, upper) = self.basis.joints, (side.copy() for side in self._no_limits)
        lower[active], upper[active] = rates
        return lower, upper

    @cached_property
    def _no_limits(self) -> Limits:
        N = self.basis.shape[1]
        return np.full(N, -np.inf), np.full(N, np.inf)

    def _checked(
        self, J_T: ArrayLike, J_C: ArrayLike, targets: ArrayLike, limits: Any, bound: Any
    ) -> tuple[Array, Array, Array, tuple[Array, Array], float]:
        """Return the arguments as plain arrays of the right shapes."""
        N, plain = self.basis.shape[1], np.ascontiguousarray
        lower, upper = check.limits("velocity_limits", limits, N)
        return (
            plain(check.array("J_T", J_T, self.data.levels.S.shape[1], N)),
            plain(check.array("J_C", J_C, None, N)),
            plain(check.array("targets", targets, self.data.levels.T.shape[1])),
            (plain(lower), plain(upper)),
            check.number("error_bound", bound, 0.0),
        )
