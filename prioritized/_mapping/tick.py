"""The optimum of a hierarchy at one pose after another, where nothing is in doubt."""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

import argument_checks as check
from argument_checks import Array, Indices
from kernels import Struct, ffi, lib, pointer
from prioritized._mapping.asked import Asked
from prioritized._mapping.plan import Plan
from prioritized._mechanism.elimination import Partition
from prioritized._mechanism.from_model import error_bound_of
from prioritized._solver.arrays import ReadOnly
from prioritized._solver.limits import Limits

if TYPE_CHECKING:
    from prioritized._kinematics import Kinematics


class Basis(NamedTuple):
    """All of a mechanism that a tick depends on and no pose changes.

    Attributes:
        joints: Velocities that are driven (n,), and passive ones that move (p,).
        shape: Of J_C.
        rest: Whether loops alone decide on passive velocities, the tolerance of ranks, and whether
            it says how accurate the entries are.
    """

    joints: tuple[Indices, Indices]
    shape: tuple[int, ...]
    rest: tuple[Any, ...]

    @classmethod
    def of(cls, system: Partition) -> "Basis":
        """That of a mechanism at any pose."""
        joints, geometry = system.joints, system.geometry
        is_exact = geometry.accuracy is None
        rest = system.is_rigid, geometry.rank_tolerance, geometry.is_stated, is_exact
        return cls((joints.active, joints.moving), geometry.J_C.shape, rest)

    def is_that_of(self, system: Partition) -> bool:
        """Whether it is of this mechanism, too."""
        joints, *rest = Basis.of(system)
        pairs = zip(self.joints, joints, strict=True)
        return rest == list(self[1:]) and all(a is b or np.array_equal(a, b) for a, b in pairs)


@dataclass(frozen=True, eq=False)
class Tick(ReadOnly):
    """Levels of tasks of one mechanism, solved at any pose.

    Made by :meth:`Hierarchy.tick` and :meth:`VelocityMapping.tick`.

    Attributes:
        plan: What the compiled solution is given.
        basis: What it depends on of the mechanism.
        asked: The levels.
    """

    plan: Plan
    basis: Basis
    asked: Asked

    @classmethod
    def of(cls, asked: Asked, mechanism: "Kinematics") -> "Tick | None":
        """Of a mechanism; see :meth:`Hierarchy.tick`."""
        plan = Plan.of(asked, mechanism)
        return None if plan is None else cls(plan, Basis.of(mechanism.system), asked)

    def at(self, mechanism: "Kinematics") -> "Tick | None":
        """The same of this mechanism at another pose, or after other failures."""
        if self.basis.is_that_of(mechanism.system):
            return self
        return Tick.of(self.asked.at(mechanism), mechanism)

    def __call__(
        self,
        J_T: Array,
        J_C: Array,
        targets: Array,
        velocity_limits: Limits,
        error_bound: float = 0.0,
    ) -> Array | None:
        """Optimal velocities in the order of J_T's columns, shape (N,); None where others decide.

        They are those of :meth:`Hierarchy.solve` at this pose, where limits of passive velocities
        are inequality rows. None is said where a rank may be in doubt, as near singular poses;
        where a joint swings freely that task or loops know; and where limits and loops contradict
        each other.

        Args:
            J_T: Task Jacobian there, shape (m, N).
            J_C: Constraint Jacobian, shape (c, N).
            targets: Of all tasks of all levels, one after the other, shape (t,).
            velocity_limits: Lower and upper limit of each velocity, (N,) each, infinite where there
                is none. Those of stuck joints do not matter.
            error_bound: That of :class:`prioritized._mechanism.geometry.Accuracy` there.

        Raises:
            ValueError: An argument has a wrong shape or number; it is named.
            TypeError: It is of another kind.
        """
        given, is_refused, velocities = (
            (J_T, J_C, targets, velocity_limits, error_bound),
            True,
            None,
        )
        is_pair = type(velocity_limits) is tuple and type(error_bound) is float
        arrays = (J_T, J_C, targets, *velocity_limits) if is_pair else ()
        if is_pair and all(type(A) is np.ndarray for A in arrays):
            is_refused, velocities = self.of_plain(*given)
        return self.of_plain(*self._checked(*given))[1] if is_refused else velocities

    def of_plain(
        self,
        J_T: Array,
        J_C: Array,
        targets: Array,
        velocity_limits: Limits,
        error_bound: float,
        along: Array | None = None,
    ) -> tuple[bool, Array | None]:
        """Whether an argument is wrong or no plain array; and what a call returns.

        With `along`, rates (n,), all levels but the first are asked for the motion of the task that
        these make, beside their targets.
        """
        plan, shapes, room_size = self._prepared
        lower, upper = velocity_limits
        if (J_T.shape, J_C.shape, targets.shape, lower.shape, upper.shape) != shapes:
            return True, None
        velocities = np.empty(self.basis.shape[1])
        room = ffi.NULL if room_size <= lib.TICK_OWN_ROOM else pointer(np.empty(room_size))
        try:  # looking at the types would take longer
            there = pointer(J_T), pointer(J_C), pointer(targets)
            beside = ffi.NULL if along is None else pointer(along)
            within = pointer(lower), pointer(upper), error_bound
            code = lib.tick_solve(plan.pointer, *there, beside, *within, pointer(velocities), room)
        except (KeyError, TypeError, ValueError):  # other numbers; not contiguous
            return True, None
        return code == lib.TICK_REFUSED, velocities if code == lib.TICK_SOLVED else None

    @cached_property
    def _prepared(self) -> tuple[Struct, tuple[tuple[int, ...], ...], int]:
        """The plan for the kernel, shapes of the arrays that it takes, and its room."""
        (c, N), levels = self.basis.shape, self.plan.levels
        plan, m, t = self.plan.for_kernel(c, N), levels.S.shape[1], levels.T.shape[1]
        return plan, ((m, N), (c, N), (t,), (N,), (N,)), lib.tick_room(plan.pointer)

    def at_jacobians(
        self, mechanism: Any, targets: Array, rates: Limits | None, along: Array | None = None
    ) -> Array | None:
        """What a call returns for Jacobians of the mechanism, as of `sim.jacobians`.

        Args:
            mechanism: With J_T and J_C, and their `error_bound` or `accuracy`; without either they
                are exact.
            targets: As of a call.
            rates: Limits of the rates, (n,) each; None is no limits.
            along: As of :meth:`of_plain`.
        """
        _, _, is_stated, _ = self.basis.rest
        bound = 0.0 if is_stated else error_bound_of(mechanism)
        J_T, J_C, limits = mechanism.J_T, mechanism.J_C, self.limits(rates)
        return self.of_plain(J_T, J_C, targets, limits, bound, along)[1]

    def limits(self, rates: Limits | None) -> Limits:
        """Limits of all velocities, (N,) each, of those of the rates; None is no limits."""
        if rates is None:
            return self._no_limits
        (active, _), (lower, upper) = self.basis.joints, (each.copy() for each in self._no_limits)
        lower[active], upper[active] = rates
        return lower, upper

    @cached_property
    def _no_limits(self) -> Limits:
        N = self.basis.shape[1]
        return np.full(N, -np.inf), np.full(N, np.inf)

    def _checked(
        self, J_T: ArrayLike, J_C: ArrayLike, targets: ArrayLike, limits: Any, bound: Any
    ) -> tuple[Array, Array, Array, tuple[Array, Array], float]:
        """The arguments as plain arrays of the right shapes."""
        N, plain = self.basis.shape[1], np.ascontiguousarray
        lower, upper = check.limit_vectors("velocity_limits", limits, N)
        return (
            plain(check.exactly("J_T", J_T, self.plan.levels.S.shape[1], N)),
            plain(check.matrix("J_C", J_C, columns=N)),
            plain(check.exactly("targets", targets, self.plan.levels.T.shape[1])),
            (plain(lower), plain(upper)),
            check.number("error_bound", bound),
        )
