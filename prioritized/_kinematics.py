"""A mechanism seen from its surviving active joints: eqs. (10) to (17)."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from prioritized import _check
from prioritized._arrays import ReadOnly
from prioritized._check import Array, Indices
from prioritized._force import ForceMapping, force_mapping
from prioritized._manipulability import Manipulability, classify
from prioritized._task import task_selection
from prioritized._velocity import VelocityMapping, velocity_mapping


@dataclass(frozen=True, eq=False)
class Kinematics(ReadOnly):
    """A mechanism seen from its surviving active joints.

    Attributes:
        J: Task Jacobian, eq. (14), shape (m, n - q).
        self_motion: Orthonormal basis of the task motion that remains with every active joint
            held (unstable singularity), shape (m, k).
        internal_force: Orthonormal rows spanning the left null space of J_Cp, shape (r, c); c
            counts the rows of J_C and then one for each stuck joint, by velocity index.
        active_constraint: Orthonormal rows; admissible active rates are their null space,
            eq. (17), shape (r', n - q).
        actuators: Surviving actuators in nominal numbering, shape (n - q,).
        active: Their velocity indices; `passive`: those of all other velocities, (N - n + q,).
        actuator_count: Nominal number n of actuators.
        passive_gain: (N - n + q, n - q), eq. (10) without its free part.
        passive_drift: Basis of the passive motion with every active joint held, orthonormal,
            shape (N - n + q, d); zero rows at stuck joints.
        task_drift: Its task motion J_Tp J~_Cp as a fraction of the size of J_T, shape (m, d).
        constraint_gain: (c, m), eq. (11) without its free part; `torque_gain`: (n - q, m), the
            torques that go with it.
        internal_gain: (r, n - q), eta of eq. (11) for what the torques differ from these.
        scale: Size of the terms whose difference is J; its rank is decided against it.
        loop_gap: Gap of the rank of J_Cp; `constraint_gap`: of `active_constraint`; `spring_gap`:
            of what springs hold and the passive metric weighs, infinite without them.
        rank_tolerance: See the rank decision.
    """

    J: Array
    self_motion: Array
    internal_force: Array
    active_constraint: Array
    actuators: Indices
    active: Indices
    passive: Indices
    actuator_count: int
    passive_gain: Array
    passive_drift: Array
    task_drift: Array
    constraint_gain: Array
    torque_gain: Array
    internal_gain: Array
    scale: float
    loop_gap: float
    constraint_gap: float
    spring_gap: float
    rank_tolerance: float

    @property
    def gap(self) -> float:
        """Smallest gap of the rank decisions that J and its constraints rest on."""
        return min(self.loop_gap, self.constraint_gap, self.spring_gap)

    def expand(self, rates: ArrayLike) -> Array:
        """Rates or torques of the survivors (..., n - q) to all actuators (..., n), else zero."""
        survivors = _check.vector("rates", rates, len(self.actuators))
        everyone = np.zeros((*survivors.shape[:-1], self.actuator_count))
        everyone[..., self.actuators] = survivors
        return everyone

    def passive_rates(self, rates: ArrayLike) -> Array:
        """Rates of the `passive` velocities, eq. (10) with xi = 0, shape (..., N - n + q).

        Under self-motion those of least norm in the passive metric.
        """
        return _check.vector("rates", rates, len(self.active)) @ self.passive_gain.T

    def constraint_force(self, f: ArrayLike, torques: ArrayLike | None = None) -> Array:
        """Constraint forces f_C under the task force f, eq. (11), shape (..., c).

        In the sign of eq. (5): the closures push on the joints with -J_C^T f_C.

        Args:
            f: Task force, shape (..., m).
            torques: Of the surviving actuators, shape (..., n - q): eta is then what balances them,
                with the least internal force in the closures where several do. None is eta = 0,
                the least norm of f_C.
        """
        force = _check.vector("f", f, self.J.shape[0])
        f_C = force @ self.constraint_gain.T
        if torques is None:
            return f_C
        more = _check.vector("torques", torques, len(self.active)) - force @ self.torque_gain.T
        return f_C + more @ self.internal_gain.T @ self.internal_force

    def manipulability(self, major: Sequence[int] | ArrayLike) -> Manipulability:
        """The four conditions of section 2.2 for a major task, each with basis, gap and sentence.

        Args:
            major: Task rows of the major task, or a matrix of directions (m1, m).

        Raises:
            ValueError: A row out of range or repeated.
        """
        S_m, _ = task_selection(major, None, len(self.J), self.rank_tolerance)
        return classify(self, S_m)

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
    ) -> VelocityMapping:
        """:func:`prioritized.velocity_mapping` of this mechanism, every constraint passed on.

        A `joint_weight` or `tie_metric` for all n actuators is cut to the survivors; rates, desired
        ones too, are the survivors' alone: `desired[..., kin.actuators]`.
        """
        mapping = velocity_mapping(
            self.J,
            major,
            secondary,
            self._of_survivors("joint_weight", joint_weight),
            secondary_weight,
            self.active_constraint,
            self.task_drift,
            major_metric=major_metric,
            tie_metric=self._of_survivors("tie_metric", tie_metric),
            damping=damping,
            scale=self.scale,
            rank_tolerance=self.rank_tolerance,
        )
        return dataclasses.replace(mapping, gap=np.minimum(mapping.gap, self.gap))

    def force_mapping(
        self,
        major: Sequence[int] | ArrayLike,
        secondary: Sequence[int] | ArrayLike | None = None,
        torque_weight: ArrayLike | None = None,
        secondary_weight: ArrayLike | None = None,
        *,
        major_metric: ArrayLike | None = None,
        tie_metric: ArrayLike | None = None,
    ) -> ForceMapping:
        """:func:`prioritized.force_mapping` of this mechanism, every condition passed on.

        A `torque_weight` or `tie_metric` for all n actuators is cut to the survivors; torques,
        desired ones too, are the survivors' alone.
        """
        mapping = force_mapping(
            self.J,
            major,
            secondary,
            self._of_survivors("torque_weight", torque_weight),
            secondary_weight,
            self.active_constraint,
            self.task_drift,
            major_metric=major_metric,
            tie_metric=self._of_survivors("tie_metric", tie_metric),
            scale=self.scale,
            rank_tolerance=self.rank_tolerance,
        )
        return dataclasses.replace(mapping, gap=np.minimum(mapping.gap, self.gap))

    def _of_survivors(self, name: str, weight: ArrayLike | None) -> Array | None:
        if weight is None:
            return None
        W = _check.real(name, weight)
        if W.ndim and W.shape[-1] == self.actuator_count:
            return W[..., self.actuators]
        return W
