"""What a hierarchy of tasks answers."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from argument_checks import Array
from argument_checks.ties import ACCURACY, exceeds
from prioritized._mapping.amplification import as_sentence
from prioritized._mapping.task import Status
from prioritized._solver.arrays import read_only
from prioritized._solver.packed import Packed, Point, solve
from prioritized._solver.rank import norm

if TYPE_CHECKING:
    from prioritized._mapping.hierarchy import Hierarchy

Targets = tuple[tuple[Array, ...], ...]
"""Of each task of each level."""


@dataclass(frozen=True, eq=False)
class HierarchySolution:
    """The optimal rates of a hierarchy.

    Attributes:
        hierarchy: That gave it.
        targets: Of each task of each level.
        packed: The problem as it was solved.
        point: Where the solver ended, from which it can start again.
    """

    hierarchy: "Hierarchy"
    targets: Targets
    packed: Packed
    point: Point

    @property
    def rates(self) -> Array:
        """Of the surviving actuators, within the limits exactly, shape (n,)."""
        return self._rates

    @cached_property
    def _rates(self) -> Array:
        own = self.hierarchy.asked.units[1] * self.point.x[0, : self._n]
        return read_only(own.clip(*self.hierarchy.limiting.box))

    @property
    def active_limits(self) -> NDArray[np.int8]:
        """Limits that the rates are at: -1 the lower, 1 the upper, 0 none, shape (n,)."""
        return self._at_bounds[: self._n]

    @property
    def active_rows(self) -> NDArray[np.int8]:
        """The same for the inequality rows, (r,)."""
        count = sum(len(each.G) for each in self.hierarchy.limiting.rows)
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
        """Target less what is achieved, of each level; its tasks one after the other.

        For an interval, what is lacking to lie in it.
        """
        J, rates = self.hierarchy.J, self.rates
        return tuple(
            read_only(
                np.concatenate(
                    [part.lacking(one, J, rates) for part, one in zip(*each, strict=True)]
                )
            )
            for each in zip(self.hierarchy.asked.levels, self.targets, strict=True)
        )

    @cached_property
    def damping_errors(self) -> tuple[float, ...]:
        """What damping costs each level: norm of what is achieved without any less that with it.

        In the rows of the level, without its weights, as its residual.
        """
        pairs = zip(self.residuals, self._undamped.residuals, strict=True)
        return tuple(float(np.linalg.norm(now - without)) for now, without in pairs)

    @cached_property
    def _undamped(self) -> "HierarchySolution":
        """The solution without any damping."""
        return self.hierarchy.undamped(self.targets) if self.hierarchy.is_damped else self

    @cached_property
    def status(self) -> Status:
        """How the first level is met, and whether limits and constraints are."""
        hard = len(self.hierarchy.limiting.rows) + 1
        if self.packed.unmet(slice(0, hard), self.point.x)[0]:
            return Status.INFEASIBLE
        if not self.point.ended[0]:
            return Status.UNFINISHED
        if not self.hierarchy.is_held:
            return Status.SELF_MOTION
        without = self._undamped
        if not without.packed.unmet(slice(hard, hard + 1), self.point.x)[0]:
            return Status.EXACT
        if without is not self:
            return Status.DAMPED if without.status is Status.EXACT else without.status
        box, count = self.packed.box.copy(), self._n + len(self.active_rows)
        box[:, 0, :count], box[:, 1, :count] = -np.inf, np.inf
        unlimited = self.packed._replace(box=box)
        x = solve(unlimited).x
        now, before = (norm(self.packed.level(hard, each)) for each in (self.point.x, x))
        return Status.LIMITED if now > (1.0 + ACCURACY) * before else Status.LEAST_SQUARES

    def __str__(self) -> str:
        """Status, active limits, and what damping costs each level, the first being level 1."""
        return self.in_words(None)

    def in_words(self, at_limits: Sequence[str] | None) -> str:
        """The same with these names of what is at a limit; None is numbers."""
        actuators = self.hierarchy.asked.survivors.actuators.tolist()
        rows = range(len(self.active_rows))
        limits = [
            *_at_limits("actuator", actuators, self.active_limits),
            *_at_limits("row", list(rows), self.active_rows),
        ]
        if at_limits is not None:
            limits = [f"At a limit: {', '.join(at_limits)}."] if at_limits else []
        damping = (f"Damping costs level {k} {error:.2g}." for k, error in self._costs())
        return " ".join([as_sentence(self.status.value), *limits, *damping])

    def _costs(self) -> Iterator[tuple[int, float]]:
        """Levels, from 1 on, that damping costs more than round-off, and how much."""
        terms = zip(self.damping_errors, self.targets, self.residuals, strict=True)
        for k, (error, targets, residual) in enumerate(terms, 1):
            size = norm(residual) + sum(map(norm, targets))
            if exceeds(error, 0.0, zero=ACCURACY * size):
                yield k, error

    @property
    def _n(self) -> int:
        return self.hierarchy.J.shape[1]


def _at_limits(what: str, numbers: list[int], active: NDArray[np.int8]) -> Iterator[str]:
    """Which actuators or rows are at which limit."""
    for side, name in ((-1, "lower"), (1, "upper")):
        there = [str(k) for k, each in zip(numbers, active, strict=True) if each == side]
        if there:
            plural = "s" if len(there) > 1 else ""
            yield f"At the {name} limit: {what}{plural} {', '.join(there)}."
