"""Kinematics of a mechanism in terms of its surviving active joints, and mappings based on it."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
from numpy.typing import ArrayLike

import argument_checks as check
from argument_checks import Array, Indices
from prioritized._analysis.attainable import Attainable, attainable
from prioritized._analysis.major_maps import of_rates, of_torques, unweighted
from prioritized._analysis.manipulability import Manipulability
from prioritized._mapping.force import ForceLimits, ForceMapping, force_mapping_of
from prioritized._mapping.hierarchy import Hierarchy, hierarchy
from prioritized._mapping.level_specs import Survivors
from prioritized._mapping.limited import WhenLimited
from prioritized._mapping.problem import Problem
from prioritized._mapping.task import task_selection
from prioritized._mapping.tasks import Task
from prioritized._mapping.velocity import VelocityMapping
from prioritized._mapping.velocity_arguments import velocity_mapping
from prioritized._mechanism.decisions import respanned
from prioritized._mechanism.elimination import Partition
from prioritized._mechanism.names import Aliases, Names, actuator_aliases, velocity_aliases
from prioritized._mechanism.reduced import Reduced
from prioritized._mechanism.statics import internal_rows, torque_gain
from prioritized._solver.arrays import read_only
from prioritized._solver.canonical import canonical
from prioritized._solver.limits import limits
from prioritized._solver.rank import RANK_TOLERANCE


@dataclass(frozen=True, eq=False)
class Kinematics:
    """Kinematics of a mechanism in terms of its surviving active joints, eqs. (6) to (17).

    Created by :meth:`prioritized.ConstrainedSystem.kinematics`. Arrays are read-only, computed when
    first used, and in the units of J_T and J_C; internally lengths are in units of the mechanism's
    length, so that no rank and no least norm depends on the unit. Of N velocities n have actuators,
    q of which failed; s joints are stuck.

    Attributes:
        system: The mechanism with its joints partitioned by their role.
        names: Names of joints and actuators, or None.
    """

    system: Partition
    names: Names | None = None

    def __repr__(self) -> str:
        """Return a one-line summary for interactive use."""
        alias = actuator_aliases(self.names, self.system.joints.actuated)
        survivors = ", ".join(next(iter(alias[k]), f"actuator {k}") for k in self.actuators)
        return f"<Kinematics of {survivors or 'no actuator'}>"

    @property
    def actuators(self) -> Indices:
        """Surviving actuators in nominal numbering, shape (n - q,)."""
        return self.system.joints.actuators

    @property
    def active(self) -> Indices:
        """Velocity indices of the surviving actuators, shape (n - q,)."""
        return self.system.joints.active

    @property
    def passive(self) -> Indices:
        """Velocity indices of all other joints, including failed actuators, shape (N - n + q,)."""
        return self.system.joints.passive

    @cached_property
    def _reduced(self) -> Reduced:
        """Mechanism reduced to its active joints, in natural units, for the mappings."""
        return Reduced(self.system)

    @cached_property
    def J(self) -> Array:
        """Task Jacobian, eq. (14), shape (m, n - q)."""
        reduced = self._reduced
        if self.system.geometry.accuracy is None:
            return reduced.J
        return read_only(reduced.task_units[:, None] * reduced.J / reduced.rate_units)

    @cached_property
    def self_motion(self) -> Array:
        """Orthonormal basis of the task motion with every active joint locked, shape (m, k)."""
        return read_only(canonical(respanned(self._reduced.self_motion, self._reduced.task_units)))

    @cached_property
    def internal_force(self) -> Array:
        """Orthonormal rows spanning the left null space of J_Cp, eq. (13), shape (r, c + s).

        Columns: the c rows of J_C, then the s stuck joints by velocity index.
        """
        reduced = self._reduced
        return read_only(canonical(respanned(reduced.internal_force, 1.0 / reduced.force_units)).T)

    @cached_property
    def active_constraint(self) -> Array:
        """Orthonormal rows whose null space is the admissible rates, eq. (17), (r', n - q)."""
        reduced = self._reduced
        return read_only(canonical(respanned(reduced.constraint.T, 1.0 / reduced.rate_units)).T)

    @cached_property
    def passive_gain(self) -> Array:
        """Passive rates per active rate, eq. (10), shape (N - n + q, n - q)."""
        reduced = self._reduced
        gain = reduced.moving_units * reduced.motion.gain / reduced.rate_units
        return read_only(self.system.joints.among_passive(gain))

    @cached_property
    def passive_self_motion(self) -> Array:
        """Orthonormal basis of the passive motion, active joints locked, shape (N - n + q, d)."""
        reduced = self._reduced
        free = canonical(respanned(reduced.motion.free, reduced.moving_units[:, 0]))
        return read_only(self.system.joints.among_passive(free))

    @cached_property
    def _constraint_gain(self) -> Array:
        """Least-norm constraint forces per task force, eq. (11), shape (c + s, m)."""
        reduced = self._reduced
        return reduced.constraint_gain / reduced.force_units[:, None] * reduced.task_units

    @property
    def gap(self) -> float:
        """Smallest gap of the rank decisions that determine J and its constraints."""
        return float(self.system.motions.gap)

    @property
    def closure_condition(self) -> float:
        """Condition number of J_Cp, the passive columns of J_C, on its rank; 1 without loops.

        It bounds the amplification of geometric errors in the passive rates. Unless the mechanism
        defines natural units, it depends on the units of J_C.
        """
        return self._reduced.closure_condition

    @cached_property
    def _torque_gain(self) -> Array:
        """Torques in equilibrium with a task force and its constraint forces, shape (n - q, m)."""
        reduced = self._reduced
        gain = torque_gain(self.system, reduced.motion, reduced.constraint_gain)
        return gain / reduced.rate_units[:, None] * reduced.task_units

    @cached_property
    def _internal_gain(self) -> Array:
        """Constraint forces per torque imbalance, shape (c + s, n - q)."""
        reduced = self._reduced
        gain = internal_rows(self.system, reduced.motion).T @ reduced.active_constraint.inverse.T
        return gain / reduced.force_units[:, None] * reduced.rate_units

    def expand(self, rates: ArrayLike) -> Array:
        """Expand rates or torques of the survivors (..., n - q) with zeros to (..., n)."""
        survivors = check.array("rates", rates, ..., len(self.actuators))
        expanded = np.zeros((*survivors.shape[:-1], len(self.system.joints.actuated)))
        expanded[..., self.actuators] = survivors
        return expanded

    def passive_rates(self, rates: ArrayLike) -> Array:
        """Return the rates of `passive` velocities, eq. (10) with xi = 0, shape (..., N - n + q).

        Under self-motion these have the least norm in the passive metric.
        """
        return check.array("rates", rates, ..., len(self.active)) @ self.passive_gain.T

    def velocities(self, rates: ArrayLike) -> Array:
        """Return all velocities in the order of J_T's columns, shape (..., N).

        The passive ones are those of :meth:`passive_rates`; velocities of stuck joints are zero.

        Args:
            rates: Rates of the survivors, shape (..., n - q). The loops stay closed for admissible
                rates, see :attr:`active_constraint`.
        """
        return self.system.joints.together(rates, self.passive_rates(rates))

    def constraint_force(self, f: ArrayLike, torques: ArrayLike | None = None) -> Array:
        """Return the constraint forces f_C under the task force f, eq. (11), shape (..., c + s).

        The sign is that of eq. (5): the closures act on the joints with -J_C^T f_C.

        Args:
            f: Task force, shape (..., m).
            torques: Torques of the surviving actuators, shape (..., n - q); they determine the
                internal force, with the least norm where several internal forces balance them. None
                is eta = 0.
        """
        force = check.array("f", f, ..., self.J.shape[0])
        f_C = force @ self._constraint_gain.T
        if torques is None:
            return f_C
        tau = check.array("torques", torques, ..., len(self.active)) - force @ self._torque_gain.T
        return f_C + tau @ self._internal_gain.T

    def manipulability(self, major: Sequence[int] | ArrayLike) -> Manipulability:
        """Evaluate the conditions of section 2.2 of the paper for a major task.

        Args:
            major: Task rows of the major task, or a matrix of directions (m1, m).

        Raises:
            ValueError: A row is out of range or repeated.
        """
        S_m, S_s = task_selection(major, None, len(self.J))
        aliases = {
            "unobservable": partial(self._aliases, self.passive),
            "constrained_active": partial(self._aliases, self.active),
        }
        return Manipulability(self._reduced.major(S_m, S_s), partial(getattr, self), aliases)

    def _aliases(self, velocities: Indices) -> Aliases:
        """Return the names of these velocities in the system."""
        aliases = list(velocity_aliases(self.names, self.system.J_T.shape[1]))
        actuated = self.system.joints.actuated
        for i, names in zip(actuated, actuator_aliases(self.names, actuated), strict=True):
            aliases[i] = names
        return tuple(aliases[i] for i in velocities)

    def velocity_mapping(
        self,
        major: Sequence[int] | ArrayLike,
        secondary: Sequence[int] | ArrayLike | None = None,
        joint_weight: ArrayLike | None = None,
        secondary_weight: ArrayLike | None = None,
        *,
        major_metric: ArrayLike | None = None,
        tie_metric: ArrayLike | None = None,
        damping: float = 0.0,
        rate_limits: tuple[ArrayLike, ArrayLike] | None = None,
        rate_rows: tuple[ArrayLike, ArrayLike, ArrayLike] | None = None,
        when_limited: WhenLimited = "least_squares",
    ) -> VelocityMapping:
        """Return :func:`prioritized.velocity_mapping` for J and all constraints of this mechanism.

        A `joint_weight`, `tie_metric`, `rate_limits` or `rate_rows` for all n actuators is
        restricted to the survivors; all rates, including desired ones, are those of the survivors:
        `desired[..., kin.actuators]`.
        """
        survivors = self._survivors
        return velocity_mapping(
            self.J,
            major,
            secondary,
            survivors.matrix("joint_weight", joint_weight),
            secondary_weight,
            major_metric=major_metric,
            tie_metric=survivors.matrix("tie_metric", tie_metric),
            damping=damping,
            rate_limits=survivors.pair(rate_limits),
            rate_rows=survivors.rows("rate_rows", rate_rows),
            when_limited=when_limited,
        )._of_mechanism(self)

    def hierarchy(
        self,
        levels: Sequence[Task | Sequence[Task]],
        *,
        rate_limits: tuple[ArrayLike, ArrayLike] | None = None,
        rate_rows: tuple[ArrayLike, ArrayLike, ArrayLike] | None = None,
        tie_metric: ArrayLike | None = None,
    ) -> Hierarchy:
        """Return the hierarchy that solves levels of tasks in lexicographic order under limits.

        1. rate_limits hold, exactly
        2. rate_rows and the constraints of the mechanism, eq. (17), hold
        3. |W (S J rates - target)| of each level smallest, a sum of squares over its tasks
        4. |T rates|, then |rates| smallest   (ties)

        Args:
            levels: A :class:`Task`, or a list of them, for each level.
            rate_limits: Limits of the rates, as for :func:`prioritized.velocity_mapping`;
                restricted to the survivors, as are `rate_rows`, `tie_metric` and weights of rates.
            rate_rows: Inequality rows of the rates.
            tie_metric: T; None is zero.
        """
        return hierarchy(self, levels, rate_limits, rate_rows, tie_metric)

    def force_mapping(
        self,
        major: Sequence[int] | ArrayLike,
        secondary: Sequence[int] | ArrayLike | None = None,
        torque_weight: ArrayLike | None = None,
        secondary_weight: ArrayLike | None = None,
        *,
        major_metric: ArrayLike | None = None,
        tie_metric: ArrayLike | None = None,
        torque_limits: tuple[ArrayLike, ArrayLike] | None = None,
        torque_rows: tuple[ArrayLike, ArrayLike, ArrayLike] | None = None,
        force_rows: tuple[ArrayLike, ArrayLike, ArrayLike] | None = None,
        when_limited: WhenLimited = "least_squares",
    ) -> ForceMapping:
        """Return :func:`prioritized.force_mapping` for J and all conditions of this mechanism.

        A `torque_weight`, `tie_metric`, `torque_limits` or `torque_rows` for all n actuators is
        restricted to the survivors; all torques, including desired ones, are those of the
        survivors.
        """
        W3 = self._survivors.matrix("torque_weight", torque_weight)
        T = self._survivors.matrix("tie_metric", tie_metric)
        box = self._survivors.pair(torque_limits)
        rows = self._survivors.rows("torque_rows", torque_rows)
        limits = ForceLimits(box, rows, force_rows, when_limited)
        weights, metrics = (W3, secondary_weight), (major_metric, T)
        return force_mapping_of(self, major, secondary, weights, metrics, limits)

    @property
    def _survivors(self) -> Survivors:
        """Restriction of arguments for all n actuators to the surviving ones."""
        return Survivors.of(self.system.joints)

    def attainable(
        self,
        major: Sequence[int] | ArrayLike,
        rate_limits: tuple[ArrayLike, ArrayLike] | None = None,
    ) -> Attainable:
        """Return the set of major velocities {J_m rates : C rates = 0, lower <= rates <= upper}.

        C is :attr:`active_constraint`. The radius is the remaining major speed in the worst
        direction.

        Args:
            major: Task rows of the major task, or a matrix of directions (m1, m).
            rate_limits: Lower and upper limits of the rates: numbers, or one for each actuator (n,)
                or survivor (n - q,). They may be infinite, or equal; None is no limits.

        Raises:
            ValueError: Invalid rows or limits, or too many facets to be enumerated.
        """
        box, units = self._limits("rate_limits", rate_limits), self._reduced.mixed_units
        moves = not self._reduced.determines(task_selection(major, None, len(self.J))[0])
        scaled = box if units is None else box / units
        return attainable(of_rates(self._task(major)), scaled, RANK_TOLERANCE, self_motion=moves)

    def attainable_force(
        self,
        major: Sequence[int] | ArrayLike,
        torque_limits: tuple[ArrayLike, ArrayLike] | None = None,
    ) -> Attainable:
        """Return the set of major forces that torques within limits balance, for any f_s.

        These are {f_m : torques = J^T f + C^T eta within the limits, Q^T f = 0} for some f_s and
        eta, with f as in :func:`prioritized.force_mapping` and Q = :attr:`self_motion`. Forces that
        the structure bears without torque, as with a locked strut, make the set unbounded.

        Args:
            major: Task rows of the major task, or a matrix of directions (m1, m).
            torque_limits: Limits of the torques, in the form of `rate_limits` of
                :meth:`attainable`.

        Raises:
            ValueError: Invalid rows or limits, or too many facets to be enumerated.
        """
        box, units = self._limits("torque_limits", torque_limits), self._reduced.mixed_units
        scaled = box if units is None else box * units
        return attainable(of_torques(self._task(major)), scaled, RANK_TOLERANCE)

    def _task(self, major: Sequence[int] | ArrayLike) -> Problem:
        """Return the unweighted problem of a major task."""
        reduced = self._reduced
        J, scale = reduced.truncated_jacobian(*task_selection(major, None, len(self.J)))
        problem = unweighted(J, major, reduced.constraint, reduced.self_motion, scale)
        return problem.natural(reduced.task_units, 1.0)

    def _limits(self, name: str, value: tuple[ArrayLike, ArrayLike] | None) -> Array:
        return limits(name, self._survivors.pair(value), len(self.actuators))
