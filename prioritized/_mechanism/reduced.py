"""Reduction of a mechanism to its surviving active joints, in natural units."""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from argument_checks import Array
from prioritized._mechanism.conditioning import task_threshold
from prioritized._mechanism.decisions import MajorTask
from prioritized._mechanism.elimination import (
    Partition,
    PassiveMotion,
    passive_motion,
    regular_motion,
)
from prioritized._mechanism.measure import Measure, is_uniform, units_of
from prioritized._mechanism.ordered import LevelRows, in_order
from prioritized._mechanism.statics import constraint_gain, internal_rows
from prioritized._mechanism.task_motion import TaskMotion
from prioritized._solver.arrays import none, read_only
from prioritized._solver.canonical import canonical
from prioritized._solver.rank import whole_svd


class ActiveConstraint(NamedTuple):
    """Constraint matrix J~_Cp^T J_Ca, eq. (17), with its decided rank r', in natural units.

    Attributes:
        rows: Orthonormal rows; admissible rates are their null space, shape (r', n - q).
        inverse: Pseudo-inverse of J~_Cp^T J_Ca, shape (n - q, r).
    """

    rows: Array
    inverse: Array


def active_constraint(system: Partition, left_null: Array) -> ActiveConstraint:
    """Return the constraints on the active rates for J~_Cp^T (r, c)."""
    active = system.joints.active
    n = len(active)
    if not len(left_null):
        return ActiveConstraint(none((0, n)), none((n, 0)))
    rates = system.rigid.rates
    rows = rates.U[:, int(rates.rank) :].T
    U, sigma, Vt = whole_svd((left_null @ system.J_C.take(active, 1) @ rows.T) @ rows)
    rank = len(rows)
    inverse = (Vt[:rank].T / sigma[:rank]) @ U[:, :rank].T
    return ActiveConstraint(canonical(Vt[:rank].T).T, inverse)


@dataclass(frozen=True, eq=False)
class Reduced:
    """Mechanism reduced to its active joints, eqs. (6) to (17), in natural units.

    Mappings and classification use it, so that no rank and no least norm depends on the unit of
    length. Properties are computed when first used.

    Attributes:
        system: The mechanism with its joints partitioned by their role.
    """

    system: Partition

    @property
    def J(self) -> Array:
        """Task Jacobian, eq. (14), shape (m, n - q)."""
        return self._jacobian[0]

    @property
    def scale(self) -> float:
        """Size of the terms whose sum is J, against which ranks are decided."""
        return self._jacobian[1]

    @cached_property
    def _jacobian(self) -> tuple[Array, float]:
        return self.system.reduced(self.motion.gain)

    @cached_property
    def motion(self) -> PassiveMotion:
        """Motion of the passive joints per active rate."""
        return passive_motion(self.system)

    @cached_property
    def task_motion(self) -> TaskMotion:
        """Motion of the whole task per active rate, with the rank decisions on it."""
        system, motion = self.system, self.motion
        if self.is_tied or motion.free.shape[1] or not system.is_rigid:
            return TaskMotion.of(system.motions, system.joints.active)
        return regular_motion(system, motion)

    @property
    def self_motion(self) -> Array:
        """Orthonormal basis of the task motion with every active joint locked, shape (m, k)."""
        if not self.motion.free.shape[1]:  # the common case, at every tick
            return none((self.system.shape[0], 0))
        moved = self.task_motion.moved
        return moved.U[:, : int(moved.rank)]

    @property
    def is_tied(self) -> bool:
        """Return whether the loops may constrain the active rates."""
        return len(self.motion.left_null) > 0

    @property
    def constraint(self) -> Array:
        """Constraints of the active rates, orthonormal rows (r', n - q)."""
        rates = len(self.system.joints.active)
        return self.active_constraint.rows if self.is_tied else none((0, rates))

    @cached_property
    def active_constraint(self) -> ActiveConstraint:
        """Constraints of the active rates, with the pseudo-inverse."""
        return active_constraint(self.system, self.motion.left_null)

    @cached_property
    def internal_force(self) -> Array:
        """Orthonormal basis of the internal forces, shape (c + s, r)."""
        rows, stuck = internal_rows(self.system, self.motion), self.system.joints.stuck
        return np.linalg.qr(rows.T)[0] if stuck.size else rows.T

    @cached_property
    def constraint_gain(self) -> Array:
        """Least-norm constraint forces per task force, eq. (11), shape (c + s, m)."""
        return constraint_gain(self.system, self.motion, self.internal_force.T)

    @cached_property
    def closure_condition(self) -> float:
        """Condition number of the closure J_Cp on its rank, 1 without loops."""
        geometry, moving = self.system.geometry, self.system.joints.moving
        rank = len(moving) - int(self.system.rigid.freedom)
        if not rank:
            return 1.0
        sigma = np.linalg.svd(geometry.closure.take(moving, 1), compute_uv=False)
        return float(sigma[0] / sigma[rank - 1])

    def major(self, S_m: Array, S_s: Array | None = None) -> MajorTask:
        """Return the rank decisions on the task S_m v, and on S_s v with S_m v = 0."""
        return MajorTask(self.task_motion, S_m, S_m[:0] if S_s is None else S_s)

    def in_order(self, levels: LevelRows) -> tuple[list[tuple[Array, float]], bool]:
        """Return rows (k, n) and sizes of levels, with their ranks decided one after the other.

        The second result is whether no self-motion moves the first level.
        """
        rows = levels.at(self.J, self.scale)
        is_determined = self.determines(levels.first / self.task_units)
        if not len(self.system.joints.active):
            return rows, is_determined
        return in_order(self.task_motion, levels, rows), is_determined

    @property
    def measured(self) -> tuple[Array, float]:
        """J and its size, with rows in natural units, and with rates if these are of two kinds."""
        return self._in_rates(self.J, self.scale)

    def truncated_jacobian(
        self, S_m: Array, S_s: Array, metric: Array | None = None
    ) -> tuple[Array, float]:
        """Return J without components of decided rank zero for S_m v and S_s v, and its scale.

        The units are those of `measured`. With this scale :data:`RANK_TOLERANCE` reproduces the
        decisions, for v_m measured with a metric (k, m1).
        """
        J, scale = self.major(S_m, S_s).truncated(self.J, self.scale, self.constraint, metric)
        return self._in_rates(J, float(scale))

    def _in_rates(self, J: Array, scale: float) -> tuple[Array, float]:
        unit = self.common_unit
        return (J, scale) if unit == 1.0 else (read_only(J / unit), scale / unit)

    def determines(self, S_m: Array) -> bool:
        """Return whether locked actuators determine the task S_m v: no self-motion moves it."""
        return not self.motion.free.shape[1] or not self.major(S_m).moved.rank

    @property
    def threshold(self) -> float:
        """Fraction of `scale` above which a singular value of J is certainly not zero."""
        geometry, motion = self.system.geometry, self.motion
        return task_threshold(geometry, self.scale, motion.gain, motion.closing)

    def measure(self, S_m: Array) -> Measure:
        """Return the natural units of v_m = S_m v and of the rates."""
        return Measure(units_of(S_m, self.task_units), self.rate_units)

    @property
    def task_units(self) -> Array:
        """Natural unit of each task velocity, shape (m,)."""
        return self.system.geometry.task_units

    @property
    def rate_units(self) -> Array:
        """Natural unit of each rate, shape (n - q,)."""
        return self.system.geometry.velocity_units[self.system.joints.active]

    @property
    def force_units(self) -> Array:
        """Natural units of the velocities dual to the constraint forces, (c + s,)."""
        geometry = self.system.geometry
        stuck = geometry.velocity_units[self.system.joints.stuck]
        return np.append(geometry.constraint_units, stuck)

    @property
    def moving_units(self) -> Array:
        """Natural units of the passive joints that move, (p, 1)."""
        return self.system.geometry.velocity_units[self.system.joints.moving, None]

    @property
    def mixed_units(self) -> Array | None:
        """Natural units of the rates if these are of two kinds, (n - q,); otherwise None."""
        units = self.rate_units
        return None if is_uniform(units) else units

    @property
    def common_unit(self) -> float:
        """Natural unit of all rates; 1 if they are of two kinds."""
        units = self.rate_units
        return float(units[0]) if len(units) and self.mixed_units is None else 1.0
