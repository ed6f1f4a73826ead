"""Jacobians of a mechanism in natural units, with their accuracy and admissible motions."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import numpy as np

from argument_checks import Array
from prioritized._solver.arrays import ones
from prioritized._solver.rank import RankedSvd, frobenius, norm, ranked_svd


class Accuracy(Protocol):
    """Accuracy of each entry of J_T and J_C, and natural units of rows and velocities.

    Errors are in the units of the entries. The natural unit of an angle is 1, that of a length is a
    length of the mechanism: results in natural units do not depend on the unit of length.
    `error_bound` bounds all errors in natural units and is cheap; cases that it leaves undecided
    are decided with the errors of the entries.
    """

    @property
    def J_T_error(self) -> Array: ...
    @property
    def J_C_error(self) -> Array: ...
    @property
    def task_units(self) -> Array: ...
    @property
    def constraint_units(self) -> Array: ...
    @property
    def velocity_units(self) -> Array: ...
    @property
    def error_bound(self) -> float: ...


ACCURACY_PARTS = tuple(part for part in vars(Accuracy) if part[0] != "_")


@dataclass(frozen=True, eq=False)
class TransferredAccuracy:
    """Accuracy at another pose of the mechanism: largest error per column and unit of rows.

    Another pose mixes rows of the same unit.

    Attributes:
        first: Accuracy at the pose where it was computed.
        constraints: Number of rows of J_C at the other pose. If it differs from that of the first
            pose, all rows are assumed to have the same error.
    """

    first: Accuracy
    constraints: int

    @classmethod
    def of(cls, accuracy: Accuracy, constraints: int) -> "TransferredAccuracy":
        """Transfer an accuracy, which may be a transferred one already."""
        is_transferred = isinstance(accuracy, TransferredAccuracy)
        return cls(accuracy.first if is_transferred else accuracy, constraints)

    @property
    def error_bound(self) -> float:
        """Bound of all errors in natural units, that of the first pose."""
        return self.first.error_bound

    @property
    def task_units(self) -> Array:
        """Natural units of the task rows, those of the first pose."""
        return self.first.task_units

    @property
    def velocity_units(self) -> Array:
        """Natural units of the velocities, those of the first pose."""
        return self.first.velocity_units

    @property
    def constraint_units(self) -> Array:
        """Natural units of the constraint rows; the largest one if their number changed."""
        units = self.first.constraint_units
        if len(units) == self.constraints:
            return units
        return np.full(self.constraints, units.max(initial=0.0) or 1.0)

    @cached_property
    def J_T_error(self) -> Array:
        """Error bounds of J_T, shape (m, N)."""
        return _spread(self.first.J_T_error, self.task_units)

    @cached_property
    def J_C_error(self) -> Array:
        """Error bounds of J_C, shape (c, N)."""
        error, units = self.first.J_C_error, self.first.constraint_units
        if len(error) == self.constraints:
            return _spread(error, units)
        natural = (error / units[:, None]).max(axis=0, initial=0.0)
        return self.constraint_units[:, None] * natural


def _spread(error: Array, units: Array) -> Array:
    same = units[:, None] == units
    return np.where(same[..., None], error, 0.0).max(axis=1, initial=0.0)


@dataclass(frozen=True, eq=False)
class Geometry:
    """J_T and J_C at one pose, with the rank decisions that do not depend on failures.

    Attributes:
        J_T: Shape (m, N).
        J_C: Shape (c, N).
        rank_tolerance: Fraction of the size of the inputs below which a singular value is zero.
        accuracy: Accuracy of the entries; None is round-off alone, with natural units of 1.
        is_stated: Whether `rank_tolerance` defines the accuracy, so that `accuracy` provides the
            natural units alone.
    """

    J_T: Array
    J_C: Array
    rank_tolerance: float
    accuracy: Accuracy | None
    is_stated: bool

    @property
    def at_other_pose(self) -> "Geometry":
        """Geometry with the errors that these Jacobians may have at another pose."""
        if self.accuracy is None:
            return self
        return replace(self, accuracy=TransferredAccuracy.of(self.accuracy, len(self.J_C)))

    @cached_property
    def error_bound(self) -> float:
        """Bound of the errors of all entries in natural units."""
        return 0.0 if self.accuracy is None or self.is_stated else self.accuracy.error_bound

    @cached_property
    def task_units(self) -> Array:
        """Natural units of the task rows, shape (m,)."""
        return ones(len(self.J_T)) if self.accuracy is None else self.accuracy.task_units

    @cached_property
    def velocity_units(self) -> Array:
        """Natural units of the velocities, shape (N,)."""
        return ones(self.J_T.shape[1]) if self.accuracy is None else self.accuracy.velocity_units

    @cached_property
    def constraint_units(self) -> Array:
        """Natural units of the constraint rows, shape (c,)."""
        return ones(len(self.J_C)) if self.accuracy is None else self.accuracy.constraint_units

    def stiffness(self, K: Array) -> Array:
        """Convert a stiffness or metric of the joints (N, N) to natural units."""
        return self.velocity_units[:, None] * K * self.velocity_units

    @cached_property
    def task(self) -> Array:
        """J_T in natural units, (m, N)."""
        return self._natural(self.J_T, self.task_units)

    @cached_property
    def size(self) -> float:
        """Norm of `task`."""
        return norm(self.task)

    @cached_property
    def closure(self) -> Array:
        """J_C in natural units, (c, N)."""
        return self._natural(self.J_C, self.constraint_units)

    @cached_property
    def task_error(self) -> Array | None:
        """Error bound of each entry of `task`; None if all are exact."""
        if self.accuracy is None or not self.error_bound:
            return None
        return self._natural(self.accuracy.J_T_error, self.task_units)

    @cached_property
    def closure_error(self) -> Array | None:
        """Error bound of each entry of `closure`; None if all are exact."""
        if self.accuracy is None or not self.error_bound:
            return None
        return self._natural(self.accuracy.J_C_error, self.constraint_units)

    @cached_property
    def loops(self) -> RankedSvd:
        """Rank decision on J_C."""
        A, error = self.closure, self.closure_error
        return ranked_svd(A, frobenius(A), self.rank_tolerance, full=True, error=error)

    @cached_property
    def motions(self) -> Array:
        """Orthonormal basis B of the motions that the loops admit, in natural units, (N, d)."""
        return self.loops.Vt[int(self.loops.rank) :].T

    @cached_property
    def closing(self) -> Array:
        """J_C^+ in natural units, (N, c): least-norm motion per error of closure."""
        svd = self.loops
        r = int(svd.rank)
        return (svd.Vt[:r].T / svd.sigma[:r]) @ svd.U[:, :r].T

    def _natural(self, A: Array, rows: Array) -> Array:
        return A if self.accuracy is None else A / rows[:, None] * self.velocity_units
