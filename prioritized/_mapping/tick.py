"""The optimum of a hierarchy at one pose after another, where nothing is in doubt."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

import argument_checks as check
from argument_checks import Array, Indices
from prioritized._mapping.asked import Asked, Mechanism
from prioritized._mapping.plan import Plan, right_sides
from prioritized._solver.arrays import ReadOnly
from prioritized._solver.compiled import regular
from prioritized._solver.packed import Equations, Rows, equations, pack_one, solve
from prioritized._solver.rank import RANK_TOLERANCE


@dataclass(frozen=True, eq=False)
class Tick(ReadOnly):
    """Levels of tasks of one mechanism, solved at any pose; made by :meth:`Hierarchy.tick`.

    Attributes:
        plan: What the compiled solution is given.
        shape: Of J_C.
        active: Velocities of the rates, (n,).
        asked: The levels.
        right: What their rows are to be, per target, (k, t).
    """

    plan: Plan
    shape: tuple[int, int]
    active: Indices
    asked: Asked
    right: Array

    @classmethod
    def of(cls, asked: Asked, mechanism: Mechanism) -> "Tick | None":
        """Of a mechanism; see :meth:`Hierarchy.tick`."""
        plan, active = Plan.of(asked, mechanism), mechanism.system.joints.active
        if plan is None:
            return None
        return cls(plan, mechanism.system.J_C.shape, active, asked, right_sides(asked))

    def __call__(
        self,
        J_T: Array,
        J_C: Array,
        targets: Array,
        velocity_limits: tuple[Array, Array],
        error_bound: float = 0.0,
    ) -> Array | None:
        """Optimal velocities in the order of J_T's columns, shape (N,); None where others decide.

        They are those of :meth:`Hierarchy.solve` at this pose, where limits of passive velocities
        are inequality rows. None is said where a rank may be in doubt, as near singular poses and
        where tasks contradict each other; where a joint swings freely; and where limits and loops
        contradict each other.

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
        given = J_T, J_C, targets, velocity_limits, error_bound
        is_plain = type(velocity_limits) is tuple and type(error_bound) is float
        is_plain = is_plain and all(map(check.is_plain, (J_T, J_C, targets, *velocity_limits)))
        found = self._met(*given) if is_plain else None
        if found is None or found[0] == regular().REFUSED:
            given = self._checked(*given)
            found = self._met(*given)
        if found is None or found[0] in (regular().IN_DOUBT, regular().REFUSED):
            return None
        code, velocities, reduced = found
        if code == regular().MET:
            return velocities
        return self._held_back(velocities, reduced, *given[2:4])

    def _met(
        self, J_T: Array, J_C: Array, targets: Array, limits: tuple[Array, Array], bound: float
    ) -> tuple[int, Array, Array] | None:
        """What the compiled solution returns and writes; None for arrays of another layout."""
        rows = self.shape[0] + self.plan.S.shape[1] + 1
        velocities, reduced = np.empty(self.shape[1]), np.empty((rows, len(self.active)))
        given = J_T, J_C, targets, *limits, bound, *self.plan
        try:
            return regular().meet(*given, velocities, reduced), velocities, reduced
        except TypeError:  # of other axes, or not one row after another
            return None

    def _held_back(
        self, velocities: Array, reduced: Array, targets: Array, limits: tuple[Array, Array]
    ) -> Array | None:
        """The optimum of levels that limits hold back, one after the other."""
        (c, _), p, active, (lower, upper) = self.shape, self.plan.p, self.active, limits
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
        (c, _), p, moving = self.shape, self.plan.p, self.plan.order[: self.plan.p]
        limited = np.isfinite(lower[moving]) | np.isfinite(upper[moving])
        follow, constraint = moving[limited], equations(reduced[p:c])
        rows = Rows(reduced[:p][limited], (lower[follow], upper[follow]))
        return [*([rows] if len(follow) else []), *([constraint] if p < c else [])]

    def _checked(
        self, J_T: ArrayLike, J_C: ArrayLike, targets: ArrayLike, limits: Any, bound: Any
    ) -> tuple[Array, Array, Array, tuple[Array, Array], float]:
        """The arguments as plain arrays of the right shapes."""
        N, plain = self.shape[1], np.ascontiguousarray
        lower, upper = check.limit_vectors("velocity_limits", limits, N)
        return (
            plain(check.exactly("J_T", J_T, self.plan.S.shape[1], N)),
            plain(check.matrix("J_C", J_C, columns=N)),
            plain(check.exactly("targets", targets, self.plan.T.shape[1])),
            (plain(lower), plain(upper)),
            check.number("error_bound", bound),
        )
