"""Hierarchies of tasks in any number of levels, under limits."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

import argument_checks as check
from argument_checks import Array
from argument_checks.ties import ACCURACY, exceeds
from prioritized._mapping.amplification import as_sentence
from prioritized._mapping.level_specs import Bounds, LevelSpecs, checked_specs
from prioritized._mapping.levels import Level, damped
from prioritized._mapping.limited import Limiting
from prioritized._mapping.task import Status, status_of
from prioritized._mapping.tasks import Part, Task, targets_of
from prioritized._mapping.tick import Tick
from prioritized._solver.arrays import none, read_only
from prioritized._solver.packed import Equations, Packed, Point, Rows, equations, pack, solved
from prioritized._solver.rank import RANK_TOLERANCE, norm

if TYPE_CHECKING:
    from prioritized._kinematics import Kinematics


CheckedTargets = tuple[tuple[Array, ...], ...]
"""Targets of each task of each level."""


@dataclass(frozen=True, eq=False)
class HierarchySolution:
    """Optimal rates of a hierarchy.

    Attributes:
        hierarchy: Hierarchy that was solved.
        targets: Targets of each task of each level.
        packed: Problem in the form of the solver.
        point: Result of the solver, which can warm-start another solution.
    """

    hierarchy: "Hierarchy"
    targets: CheckedTargets
    packed: Packed
    point: Point

    @cached_property
    def rates(self) -> Array:
        """Rates of the surviving actuators, within the limits exactly, shape (n,)."""
        rates = self.hierarchy.specs.units[1] * self.point.x[0, : self._n]
        return read_only(rates.clip(*self.hierarchy.limiting.box))

    @property
    def active_limits(self) -> NDArray[np.int8]:
        """Limits that the rates are at: -1 the lower, 1 the upper, 0 none, shape (n,)."""
        return self._at_bounds[: self._n]

    @property
    def active_rows(self) -> NDArray[np.int8]:
        """Limits that the inequality rows are at: -1 the lower, 1 the upper, 0 none, (r,)."""
        count = sum(len(rows.G) for rows in self.hierarchy.limiting.rows)
        return self._at_bounds[self._n : self._n + count]

    @cached_property
    def _at_bounds(self) -> NDArray[np.int8]:
        return read_only(self.packed.at_bounds(self.point.x))[0]

    @property
    def gap(self) -> float:
        """Factor by which the rank threshold could change before any rank would."""
        assert self.point.gap is not None  # of the lexicographic solver
        return float(self.point.gap[0])

    @cached_property
    def residuals(self) -> tuple[Array, ...]:
        """Target minus achieved value of each level, its tasks one after the other.

        For an interval, the distance to it.
        """
        J, rates = self.hierarchy.J, self.rates
        residuals = (
            [part.residual(target, J, rates) for part, target in zip(*pair, strict=True)]
            for pair in zip(self.hierarchy.specs.levels, self.targets, strict=True)
        )
        return tuple(read_only(np.concatenate(of_tasks)) for of_tasks in residuals)

    @cached_property
    def damping_errors(self) -> tuple[float, ...]:
        """Norm of the change of each level's achieved value due to damping, without weights."""
        pairs = zip(self.residuals, self._undamped.residuals, strict=True)
        return tuple(float(np.linalg.norm(damped - undamped)) for damped, undamped in pairs)

    @cached_property
    def _undamped(self) -> "HierarchySolution":
        """Solution without damping."""
        return self.hierarchy.undamped(self.targets) if self.hierarchy.is_damped else self

    @cached_property
    def status(self) -> Status:
        """Status of the first level, limits and constraints."""
        hard, undamped = len(self.hierarchy.limiting.rows) + 1, self._undamped
        is_exact = not undamped.packed.is_violated(slice(hard, hard + 1), self.point.x)[0]
        conditions = {
            Status.UNFINISHED: lambda: not self.point.ended[0],
            Status.INFEASIBLE: lambda: self.packed.is_violated(slice(0, hard), self.point.x)[0],
            Status.SELF_MOTION: lambda: not self.hierarchy.is_determined,
            Status.LIMITED: lambda: not is_exact and undamped is self and self._is_limited(hard),
            Status.LEAST_SQUARES: lambda: not is_exact and undamped is self,
            Status.DAMPED: lambda: not is_exact and undamped.status is Status.EXACT,
        }
        undamped_status = Status.EXACT if is_exact or undamped is self else undamped.status
        return status_of(conditions, undamped_status)

    def _is_limited(self, level: int) -> bool:
        """Return whether this level has a smaller residual without limits."""
        box, count = self.packed.box.copy(), self._n + len(self.active_rows)
        box[:, 0, :count], box[:, 1, :count] = -np.inf, np.inf
        points = self.point, solved(self.packed._replace(box=box))
        limited, best = (norm(self.packed.level_residual(level, point.x)) for point in points)
        return bool(limited > (1.0 + ACCURACY) * best)

    def __str__(self) -> str:
        """Describe status, active limits and the errors due to damping; the first level is 1."""
        return self.describe(None)

    def describe(self, at_limits: Sequence[str] | None) -> str:
        """Describe the solution; `at_limits` names what is at a limit, else numbers are given."""
        actuators = self.hierarchy.specs.survivors.actuators.tolist()
        limits = [
            *_at_limits("actuator", actuators, self.active_limits),
            *_at_limits("row", list(range(len(self.active_rows))), self.active_rows),
        ]
        if at_limits is not None:
            limits = [f"At a limit: {', '.join(at_limits)}."] if at_limits else []
        damping = (f"Damping changes level {k} by {error:.2g}." for k, error in self._costs())
        return " ".join([as_sentence(self.status.value), *limits, *damping])

    def _costs(self) -> Iterator[tuple[int, float]]:
        """Yield number, from 1 on, and damping error of each level where it exceeds round-off."""
        terms = zip(self.damping_errors, self.targets, self.residuals, strict=True)
        for k, (error, targets, residual) in enumerate(terms, 1):
            size = norm(residual) + sum(map(norm, targets))
            if exceeds(error, 0.0, zero=ACCURACY * size):
                yield k, error

    @property
    def _n(self) -> int:
        return self.hierarchy.J.shape[1]


def _at_limits(what: str, numbers: list[int], active: NDArray[np.int8]) -> Iterator[str]:
    """Yield sentences on the actuators or rows at each limit."""
    for side, name in ((-1, "lower"), (1, "upper")):
        at_side = [str(k) for k, state in zip(numbers, active, strict=True) if state == side]
        if at_side:
            plural = "s" if len(at_side) > 1 else ""
            yield f"At the {name} limit: {what}{plural} {', '.join(at_side)}."


Targets = Sequence[ArrayLike | Sequence[ArrayLike] | None]
"""Targets of the levels, in their order."""


@dataclass(frozen=True, eq=False)
class Hierarchy:
    """Levels of tasks of one mechanism at one pose; created by :meth:`Kinematics.hierarchy`.

    Attributes:
        specs: Pose-independent levels.
        damping: Damping of each level.
        J: Task Jacobian, (m, n).
        weighted_rows: Weighted rows (k, n) of each level without directions of rank zero, and the
            size of their terms; for rates in natural units, as `constraint`.
        constraint: C, orthonormal rows, shape (r, n).
        limiting: Limits of the rates.
        bounds: Limits of the rates as given.
        is_determined: Whether no self-motion moves the tasks of the first level.
        damping_rows: Further rows (k, n) of each level with target zero, for damping that depends
            on the direction; () for none.
    """

    specs: LevelSpecs
    damping: tuple[float, ...]
    J: Array
    weighted_rows: tuple[tuple[Array, float], ...]
    constraint: Array
    limiting: Limiting
    bounds: Bounds
    is_determined: bool
    damping_rows: tuple[Array, ...] = ()

    @property
    def is_damped(self) -> bool:
        """Return whether any level is damped."""
        return any(self.damping) or any(map(len, self.damping_rows))

    def __call__(self, targets: Targets) -> Array:
        """Return the optimal rates, shape (n,)."""
        return self.solve(targets).rates

    def at(
        self,
        kinematics: "Kinematics",
        *,
        rate_limits: tuple[ArrayLike, ArrayLike] | None = None,
        rate_rows: tuple[ArrayLike, ArrayLike, ArrayLike] | None = None,
    ) -> "Hierarchy":
        """Return the same levels at another pose, or after other failures.

        The levels are not checked again. The result equals :meth:`Kinematics.hierarchy` of that
        mechanism with these arguments.

        Args:
            kinematics: Mechanism at the other pose; after other failures, arguments for all n
                actuators are restricted anew to the survivors.
            rate_limits: New limits, as for :meth:`Kinematics.hierarchy`; None is those of this
                hierarchy.
            rate_rows: New inequality rows; None is those of this hierarchy.
        """
        specs, limiting, bounds = self._specs_of(kinematics), self.limiting, self.bounds
        if rate_limits is not None or rate_rows is not None or specs is not self.specs:
            pairs = zip((rate_limits, rate_rows), bounds, strict=True)
            bounds = Bounds(*(old if new is None else new for new, old in pairs))
            limiting, bounds = bounds.of(kinematics._survivors), bounds.copied()
        return _at(kinematics, specs, limiting, bounds)

    def solve(
        self, targets: Targets, *, start: HierarchySolution | None = None
    ) -> HierarchySolution:
        """Return the rates that minimize the residuals in order, under limits and constraints.

        Args:
            targets: Target of each level, in order: shape (k,), a pair for an interval, or a list
                with one for each task if a level has several. None is zero.
            start: Solution of a similar problem, such as that of the previous tick.

        Raises:
            ValueError: The number of targets is wrong, or one has a wrong shape or is not finite.
        """
        count, levels = len(self.specs.levels), self.specs.levels
        if not isinstance(targets, Sequence | np.ndarray) or len(targets) != count:
            got = check.short_repr(targets)
            raise ValueError(f"targets must be {count}, one for each level, got {got}")
        checked_targets = tuple(
            targets_of(f"targets[{k}]", level, target)
            for k, (level, target) in enumerate(zip(levels, targets, strict=True))
        )
        warm = None if start is None else check.instance("start", start, HierarchySolution).point
        return self._solved(checked_targets, warm)

    def tick(self, kinematics: "Kinematics") -> Tick | None:
        """Return a compiled solver of these levels for successive well-conditioned poses.

        Construct it once for a mechanism and its failures. At poses where the solver returns None,
        use :meth:`at` and :meth:`solve`.

        Args:
            kinematics: Mechanism at any pose.

        Returns:
            The solver; None if the mechanism has springs or a task is an interval.
        """
        return Tick.of(self._specs_of(kinematics), kinematics)

    def undamped(self, targets: CheckedTargets) -> HierarchySolution:
        """Return the solution without damping for checked targets."""
        undamped = replace(self, damping=(0.0,) * len(self.damping), damping_rows=())
        return undamped._solved(targets, None)

    def _solved(self, targets: CheckedTargets, start: Point | None) -> HierarchySolution:
        blocks = map(_block, self.specs.levels, self._rows, targets)
        limited_levels = self.limiting.natural(self.specs.units[1])
        hard = (*limited_levels.rows, equations(self.constraint))
        packed = pack([*hard, *blocks, self.specs.ties], limited_levels.box, RANK_TOLERANCE)
        return HierarchySolution(self, targets, packed, solved(packed, start))

    def _specs_of(self, kinematics: "Kinematics") -> LevelSpecs:
        """Return the level specifications for another mechanism."""
        if not hasattr(kinematics, "hierarchy"):
            raise TypeError(f"kinematics must be a Kinematics, got {check.short_repr(kinematics)}")
        shape = len(self.J), self.specs.survivors.n
        other_shape = len(kinematics.J), kinematics._survivors.n
        if other_shape != shape:
            raise ValueError(
                f"kinematics must have {shape[0]} task rows and {shape[1]} actuators, "
                f"got {other_shape}"
            )
        return self.specs.at(kinematics)

    @cached_property
    def _rows(self) -> list[tuple[Array, float, float]]:
        """Weighted rows and damping rows of each level, their size, and damping."""
        weighted_rows = list(self.weighted_rows)
        if self.damping_rows:
            natural = (B * self.specs.units[1] for B in self.damping_rows)
            pairs = zip(weighted_rows, natural, strict=True)
            weighted_rows = [
                (np.vstack([A, B]), float(np.hypot(size, norm(B)))) for (A, size), B in pairs
            ]
        intervals = [parts[0].interval for parts in self.specs.levels]
        if not any(self.damping) or not (self.limiting.rows or any(intervals)):
            pairs = zip(weighted_rows, self.damping, strict=True)
            return [(*rows, damping) for rows, damping in pairs]
        levels = [Level(self.constraint, none((len(self.constraint), 1)), norm(self.constraint))]
        specs = zip(intervals, weighted_rows, self.damping, strict=True)
        for is_interval, (A, size), damping in specs:
            # An interval inside its limits determines no direction.
            rows = A[:0] if is_interval else A
            levels.append(Level(rows, none((len(rows), 1)), size, damping))
        pairs = zip(weighted_rows, damped(levels, RANK_TOLERANCE)[1:], strict=True)
        return [(level.A if level.A.size else A, size, 0.0) for (A, size), level in pairs]


def hierarchy(
    mechanism: "Kinematics",
    levels: Sequence[Task | Sequence[Task]],
    rate_limits: tuple[ArrayLike, ArrayLike] | None,
    rate_rows: tuple[ArrayLike, ArrayLike, ArrayLike] | None,
    tie_metric: ArrayLike | None,
) -> Hierarchy:
    """Return the hierarchy of a mechanism; see :meth:`Kinematics.hierarchy`."""
    bounds, specs = Bounds(rate_limits, rate_rows), checked_specs(mechanism, levels, tie_metric)
    return _at(mechanism, specs, bounds.of(mechanism._survivors), bounds.copied())


def _at(
    mechanism: "Kinematics", specs: LevelSpecs, limiting: Limiting, bounds: Bounds
) -> Hierarchy:
    rows, is_determined = mechanism._reduced.in_order(specs.level_rows)
    return Hierarchy(
        *(specs, specs.damping, mechanism.J, tuple(rows), mechanism._reduced.constraint),
        *(limiting, bounds, is_determined),
    )


def _block(
    parts: tuple[Part, ...], rows: tuple[Array, float, float], targets: tuple[Array, ...]
) -> Equations | Rows:
    A, size, damping = rows
    if parts[0].interval:
        lower, upper = targets[0]
        return Rows(A, (lower, upper))
    pairs = zip(parts, targets, strict=True)
    weighted = [target if part.W is None else part.W.dot(target) for part, target in pairs]
    target = weighted[0] if len(weighted) == 1 else np.concatenate(weighted)
    if len(target) < len(A):
        target = np.concatenate([target, none((len(A) - len(target),))])
    return Equations(A, target, size, damping)
