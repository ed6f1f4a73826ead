"""The optimum of a hierarchy at one pose after another, where nothing is in doubt."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

import argument_checks as check
from argument_checks import Array, Indices
from kernels import lib, pointer
from prioritized._mapping.asked import Asked, Mechanism
from prioritized._mapping.plan import Plan, right_sides
from prioritized._mechanism.elimination import Partition
from prioritized._solver.arrays import ReadOnly
from prioritized._solver.limits import Limits
from prioritized._solver.packed import Equations, Rows, equations, pack_one, solve
from prioritized._solver.rank import RANK_TOLERANCE


class Basis(NamedTuple):
    """All of a mechanism that a tick depends on and no pose changes.

    Attributes:
        joints: Velocities that are driven (n,), and passive ones that move (p,).
        shape: Of J_C.
        rest: Whether loops alone decide on passive velocities, and what is said of the accuracy.
    """

    joints: tuple[Indices, Indices]
    shape: tuple[int, ...]
    rest: tuple[Any, ...]

    @classmethod
    def of(cls, system: Partition) -> "Basis":
        """That of a mechanism at any pose."""
        joints, geometry, accuracy = system.joints, system.geometry, system.geometry.accuracy
        extremes = None if accuracy is None else accuracy.extremes
        rest = system.is_rigid, geometry.rank_tolerance, geometry.is_stated, extremes
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
        right: What their rows are to be, per target, (k, t).
    """

    plan: Plan
    basis: Basis
    asked: Asked
    right: Array

    @classmethod
    def of(cls, asked: Asked, mechanism: Mechanism) -> "Tick | None":
        """Of a mechanism; see :meth:`Hierarchy.tick`."""
        plan = Plan.of(asked, mechanism)
        if plan is None:
            return None
        return cls(plan, Basis.of(mechanism.system), asked, right_sides(asked))

    def at(self, mechanism: Mechanism) -> "Tick | None":
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
        are inequality rows. None is said where a rank may be in doubt, as near singular poses and
        where tasks contradict each other; where a joint swings freely that task or loops know; and
        where limits and loops contradict each other.

        Args:
            J_T: Task Jacobian there, shape (m, N).
            J_C: Constraint Jacobian, shape (c, N).
            targets: Of all tasks of all levels, one after the other, shape (t,).
            velocity_limits: Lower and upper limit of each velocity, (N,) each, infinite where there
                is none. Those of stuck joints do not matter.
            error_bound: That of :class:`prioritized.Accuracy` there.

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
    ) -> tuple[bool, Array | None]:
        """Whether an argument is wrong or no plain array; and what a call returns."""
        plan, shapes, room_size, reduced = self._prepared
        lower, upper = velocity_limits
        if (J_T.shape, J_C.shape, targets.shape, lower.shape, upper.shape) != shapes:
            return True, None
        velocities, room = np.empty(self.basis.shape[1]), np.empty(room_size)
        try:  # looking at the types would take longer
            there = pointer(J_T), pointer(J_C), pointer(targets), pointer(lower), pointer(upper)
            made = pointer(velocities), pointer(room)
            code = lib.regular_meet(plan, *there, error_bound, *made)
        except (KeyError, TypeError, ValueError):  # other numbers; not contiguous
            return True, None
        if code == lib.REGULAR_LIMITED:
            order = self.plan.order
            if lower[order].max() >= check.LARGEST or upper[order].min() <= -check.LARGEST:
                return True, None
            rows = room[: reduced[0] * reduced[1]].reshape(reduced)
            return False, self._held_back(velocities, rows, targets, velocity_limits)
        return code == lib.REGULAR_REFUSED, velocities if code == lib.REGULAR_MET else None

    @cached_property
    def _prepared(self) -> tuple[Any, tuple[tuple[int, ...], ...], int, tuple[int, int]]:
        """The plan for the kernel, shapes of the arrays that it takes, its room, and what it says.

        The last is the shape of what it writes where limits forbid all.
        """
        (c, N), m, n = self.basis.shape, self.plan.S.shape[1], len(self.plan.place)
        plan, t = self.plan.for_kernel(c, N), self.plan.T.shape[1]
        return plan, ((m, N), (c, N), (t,), (N,), (N,)), lib.regular_room(plan), (c + m + 1, n)

    def __getstate__(self) -> dict[str, Any]:
        """All but what is prepared: pointers cannot be copied."""
        return {name: value for name, value in vars(self).items() if name != "_prepared"}

    def limits(self, rates: Limits | None) -> Limits:
        """Limits of all velocities, (N,) each, of those of the rates; None is no limits."""
        N, (active, _) = self.basis.shape[1], self.basis.joints
        lower, upper = np.full(N, -np.inf), np.full(N, np.inf)
        if rates is not None:
            lower[active], upper[active] = rates
        return lower, upper

    def _held_back(
        self, velocities: Array, reduced: Array, targets: Array, limits: Limits
    ) -> Array | None:
        """The optimum of levels that limits hold back, one after the other."""
        (c, _), p, (lower, upper) = self.basis.shape, self.plan.p, limits
        active, _ = self.basis.joints
        hard, stacked = self._hard(reduced, *limits) if c else [], self.asked.stacked
        rights = stacked.split(self.right.dot(targets))
        rows = stacked.at(reduced[c:-1], reduced[-1, 0])
        levels = [Equations(A, b, size) for (A, size), b in zip(rows, rights, strict=True)]
        box = lower[active], upper[active]
        packed = pack_one([*hard, *levels, *self.asked.ties], box, RANK_TOLERANCE)
        is_box = packed.A.shape[2] == len(active)
        point = solve(packed, velocities[active] if is_box else None)
        if not point.ended[0] or (hard and packed.unmet(slice(0, len(hard)), point.x)[0]):
            return None
        velocities[active] = rates = point.x[0, : len(active)]
        if p:
            velocities[self.plan.order[:p]] = reduced[:p].dot(rates)
        return velocities

    def _hard(self, reduced: Array, lower: Array, upper: Array) -> list[Rows | Equations]:
        """Limits of passive velocities, and constraints of the rates."""
        (c, _), p, moving = self.basis.shape, self.plan.p, self.plan.order[: self.plan.p]
        limited = np.isfinite(lower[moving]) | np.isfinite(upper[moving])
        follow, constraint = moving[limited], equations(reduced[p:c])
        rows = Rows(reduced[:p][limited], (lower[follow], upper[follow]))
        return [*([rows] if len(follow) else []), *([constraint] if p < c else [])]

    def _checked(
        self, J_T: ArrayLike, J_C: ArrayLike, targets: ArrayLike, limits: Any, bound: Any
    ) -> tuple[Array, Array, Array, tuple[Array, Array], float]:
        """The arguments as plain arrays of the right shapes."""
        N, plain = self.basis.shape[1], np.ascontiguousarray
        lower, upper = check.limit_vectors("velocity_limits", limits, N)
        return (
            plain(check.exactly("J_T", J_T, self.plan.S.shape[1], N)),
            plain(check.matrix("J_C", J_C, columns=N)),
            plain(check.exactly("targets", targets, self.plan.T.shape[1])),
            (plain(lower), plain(upper)),
            check.number("error_bound", bound),
        )
