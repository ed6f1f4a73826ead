"""Elimination of the passive joints: eqs. (10) to (17)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from prioritized import _check
from prioritized._check import Array, Indices
from prioritized._rank import frobenius, ranked_svd
from prioritized._velocity import VelocityMapping, velocity_mapping


@dataclass(frozen=True)
class Kinematics:
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
        active: Their velocity indices; `passive`: those of all other velocities.
        actuator_count: Nominal number n of actuators.
        passive_gain: (N - n + q, n - q), eq. (10) without its free part.
        constraint_gain: (c, m), eq. (11) without its free part.
        scale: Size of the terms whose difference is J; its rank is decided against it.
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
    constraint_gain: Array
    scale: float
    rank_tolerance: float

    def expand(self, rates: ArrayLike) -> Array:
        """Rates of the survivors (..., n - q) to all actuators (..., n), zero where failed."""
        survivors = _check.vector("rates", rates, len(self.actuators))
        everyone = np.zeros((*survivors.shape[:-1], self.actuator_count))
        everyone[..., self.actuators] = survivors
        return everyone

    def passive_rates(self, rates: ArrayLike) -> Array:
        """Least-norm rates of the `passive` velocities, eq. (10) with xi = 0."""
        return _check.vector("rates", rates, len(self.active)) @ self.passive_gain.T

    def constraint_force(self, f: ArrayLike) -> Array:
        """Least-norm constraint forces under the task force f, eq. (11) with eta = 0."""
        return _check.vector("f", f, self.J.shape[0]) @ self.constraint_gain.T

    def velocity_mapping(
        self,
        major: Sequence[int] | ArrayLike,
        secondary: Sequence[int] | ArrayLike | None = None,
        joint_weight: ArrayLike | None = None,
        secondary_weight: ArrayLike | None = None,
    ) -> VelocityMapping:
        """:func:`prioritized.velocity_mapping` of this mechanism, every constraint passed on.

        A `joint_weight` for all n actuators is cut to the survivors.
        """
        return velocity_mapping(
            self.J,
            major,
            secondary,
            self._survivors_weight(joint_weight),
            secondary_weight,
            active_constraint=self.active_constraint,
            scale=self.scale,
            rank_tolerance=self.rank_tolerance,
        )

    def _survivors_weight(self, weight: ArrayLike | None) -> Array | None:
        if weight is None:
            return None
        W = _check.real("joint_weight", weight)
        if W.ndim and W.shape[-1] == self.actuator_count:
            return W[..., self.actuators]
        return W


def reduce_to_active(
    J_T: Array,
    J_C: Array,
    *,
    actuators: Indices,
    active: Indices,
    stuck: Indices,
    actuator_count: int,
    rank_tolerance: float,
) -> Kinematics:
    """Eliminate all but the `active` velocities from v = J_T theta_dot, J_C theta_dot = 0.

    The `stuck` ones are zero. The paper adds a unit row E to J_C for each (section 2.3.2); here
    they are left out of the decomposition and E's share is put back afterwards, which is the same
    and does not weigh a unit row against the units of J_C.
    """
    passive = np.setdiff1d(np.arange(J_T.shape[1]), active, assume_unique=True)
    moving = np.setdiff1d(passive, stuck, assume_unique=True)
    J_Ca, J_Cs, J_Cp = J_C[:, active], J_C[:, stuck], J_C[:, moving]
    J_Ts, J_Tp = J_T[:, stuck], J_T[:, moving]
    constraint_scale, task_scale = float(frobenius(J_C)), float(frobenius(J_T))

    loops = ranked_svd(J_Cp, constraint_scale, rank_tolerance, full=True)
    r = int(loops.rank)
    J_Cp_pinv = (loops.Vt[:r].T / loops.sigma[:r]) @ loops.U[:, :r].T
    free_motion, left_null = loops.Vt[r:].T, loops.U[:, r:].T
    moving_gain = -J_Cp_pinv @ J_Ca
    moved = ranked_svd(J_Tp @ free_motion, task_scale, rank_tolerance)
    bound = ranked_svd(left_null @ J_Ca, constraint_scale, rank_tolerance)

    # Rows of [J_C; E]: a stuck joint's reaction balances what f and f_C put on it, eq. (9).
    internal_force = np.linalg.qr(np.hstack([left_null, -left_null @ J_Cs]).T)[0].T
    f_C = -J_Cp_pinv.T @ J_Tp.T
    constraint_gain = np.vstack([f_C, -J_Ts.T - J_Cs.T @ f_C])
    constraint_gain -= internal_force.T @ (internal_force @ constraint_gain)  # least norm
    passive_gain = np.zeros((len(passive), len(active)))
    passive_gain[np.searchsorted(passive, moving)] = moving_gain
    return Kinematics(
        J=J_T[:, active] + J_Tp @ moving_gain,
        self_motion=moved.U[:, : int(moved.rank)],
        internal_force=internal_force,
        active_constraint=bound.Vt[: int(bound.rank)],
        actuators=actuators,
        active=active,
        passive=passive,
        actuator_count=actuator_count,
        passive_gain=passive_gain,
        constraint_gain=constraint_gain,
        scale=task_scale * (1.0 + float(frobenius(moving_gain))),
        rank_tolerance=rank_tolerance,
    )
