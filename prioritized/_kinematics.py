"""A mechanism seen from its surviving active joints, and the mappings through them."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

import argument_checks as check
from argument_checks import Array
from prioritized._force import ForceMapping, force_mapping
from prioritized._manipulability import Manipulability, classify
from prioritized._reduced import Reduced
from prioritized._task import task_selection
from prioritized._velocity import VelocityMapping, velocity_mapping


@dataclass(frozen=True, eq=False)
class Kinematics(Reduced):
    """A mechanism seen from its surviving active joints, eqs. (10) to (17).

    Made by :meth:`prioritized.ConstrainedSystem.kinematics`; its arrays J, self_motion,
    internal_force, active_constraint and others are described in :class:`Reduced`.
    """

    def expand(self, rates: ArrayLike) -> Array:
        """Rates or torques of the survivors (..., n - q) to all actuators (..., n), else zero."""
        survivors = check.vector("rates", rates, len(self.actuators))
        everyone = np.zeros((*survivors.shape[:-1], self.actuator_count))
        everyone[..., self.actuators] = survivors
        return everyone

    def passive_rates(self, rates: ArrayLike) -> Array:
        """Rates of the `passive` velocities, eq. (10) with xi = 0, shape (..., N - n + q).

        Under self-motion those of least norm in the passive metric.
        """
        return check.vector("rates", rates, len(self.active)) @ self.passive_gain.T

    def constraint_force(self, f: ArrayLike, torques: ArrayLike | None = None) -> Array:
        """Constraint forces f_C under the task force f, eq. (11), shape (..., c).

        In the sign of eq. (5): the closures push on the joints with -J_C^T f_C.

        Args:
            f: Task force, shape (..., m).
            torques: Of the surviving actuators, shape (..., n - q): eta is then what balances them,
                with the least internal force in the closures where several do. None is eta = 0,
                the least norm of f_C.
        """
        force = check.vector("f", f, self.J.shape[0])
        f_C = force @ self.constraint_gain.T
        if torques is None:
            return f_C
        more = check.vector("torques", torques, len(self.active)) - force @ self.torque_gain.T
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
            _any(self.active_constraint),
            _any(self.task_drift),
            major_metric=major_metric,
            tie_metric=self._of_survivors("tie_metric", tie_metric),
            damping=damping,
            scale=self.scale,
            rank_tolerance=self.rank_tolerance,
        )
        return VelocityMapping(mapping.problem, mapping.damping, foundation=self)

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
        W = weight if check.is_plain(weight) else check.real(name, weight)
        if W.ndim and W.shape[-1] == self.actuator_count > len(self.actuators):
            return W[..., self.actuators]
        return W


def _any(A: Array) -> Array | None:
    """What there is none of need not be checked."""
    return A if A.size else None
