"""Velocity mapping: Problem 1 of the paper for all weights."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

import argument_checks as check
from argument_checks import Array, Indices
from prioritized._arrays import apply, on_axes, respond
from prioritized._gains import lexicographic_gains
from prioritized._levels import smallest_gap
from prioritized._problem import Problem, checked
from prioritized._rank import RANK_TOLERANCE, RankedSvd, basis_scale, frobenius, ranked_svd
from prioritized._rates import optimal_rates
from prioritized._reduced import Reduced
from prioritized._side_by_side import rates_side_by_side
from prioritized._task import Status


@dataclass(frozen=True, eq=False)
class VelocityMapping:
    """The optimal active joint rates; made by :func:`velocity_mapping`.

    rates = major @ v_m + joint @ rates_desired + secondary @ v_s_desired

    A call solves for the rates alone, without a singular value decomposition where no rank is in
    doubt. The gains, and the ranks with their gaps, are worked out when they are first asked for.

    Attributes:
        problem: What was asked for.
        damping: Of the major task.
        foundation: Whose decisions J rests on; None for a J as given.
    """

    problem: Problem
    damping: float
    foundation: Reduced | None = None

    def __call__(
        self,
        v_major: ArrayLike,
        joint_velocity: ArrayLike | None = None,
        secondary_velocity: ArrayLike | None = None,
    ) -> Array:
        """Optimal active joint rates, shape (..., n); what is None counts as zero."""
        if not self.damping and self.problem.is_unconstrained:
            solve = rates_side_by_side if self.problem.lead else optimal_rates
            rates = solve(self.problem, v_major, joint_velocity, secondary_velocity)
            if rates is not None:
                return rates
        return respond(
            (self.major, self.joint, self.secondary),
            "v_major",
            v_major=v_major,
            joint_velocity=joint_velocity,
            secondary_velocity=secondary_velocity,
        )

    def at(self, kinematics: Reduced) -> "VelocityMapping":
        """The same task, weights and metrics at another pose: no more than J is looked at anew.

        Raises:
            TypeError: `kinematics` is no :class:`prioritized.Kinematics`.
            ValueError: Another number of task rows or surviving actuators.
        """
        check.instance("kinematics", kinematics, Reduced)
        problem = self.problem
        if kinematics.J.shape != problem.J.shape:
            raise ValueError(
                f"kinematics must have a J of shape {problem.J.shape}, got {kinematics.J.shape}"
            )
        there = problem._replace(
            J=kinematics.J,
            scale=np.asarray(kinematics.scale),
            active_constraint=kinematics.active_constraint,
            self_motion=kinematics.task_drift,
        )
        return VelocityMapping(there, self.damping, kinematics)

    def residual(self, v_major: ArrayLike) -> Array:
        """Part of the major velocity that the rates leave out, shape (..., m1)."""
        wanted = check.vector("v_major", v_major, self.achieved.shape[-1])
        return wanted - apply(self.achieved, "v_major", wanted)

    @property
    def major(self) -> Array:
        """Gain of the major velocity, shape (..., n, m1)."""
        return self._gains[0]

    @property
    def joint(self) -> Array:
        """Gain of the desired rates, shape (..., n, n)."""
        return self._gains[1]

    @property
    def secondary(self) -> Array:
        """Gain of the desired secondary velocity, shape (..., n, m2)."""
        return self._gains[2]

    @cached_property
    def achieved(self) -> Array:
        """Major velocity reached per major velocity asked for, shape (..., m1, m1)."""
        return check.frozen(on_axes(self.problem.major_jacobian @ self.major, self.problem.lead))

    @property
    def rank(self) -> Indices:
        """Rank of the major task on the admissible rates, shape (...)."""
        return np.broadcast_to(self._decisions[1].rank, self.problem.lead)

    @cached_property
    def gap(self) -> Array:
        """Factor by which the rank threshold could move before the rank of any level changed."""
        gap = smallest_gap(self._decisions)
        if self.foundation is not None:
            gap = np.minimum(gap, self.foundation.gap)
        return np.broadcast_to(gap, self.problem.lead)

    @property
    def status(self) -> Status:
        """The worst of the batch."""
        S_m, Q, tolerance = self.problem.S_m, self.problem.self_motion, self.problem.tolerance
        drift = ranked_svd(S_m @ Q, frobenius(S_m) * basis_scale(Q), tolerance)
        if np.any(drift.rank > 0):
            return Status.SELF_MOTION
        if not np.all(self.rank == len(S_m)):
            return Status.LEAST_SQUARES
        return Status.DAMPED if self.damping else Status.EXACT

    @property
    def _gains(self) -> tuple[Array, Array, Array]:
        return self._solution[0]

    @property
    def _decisions(self) -> list[RankedSvd]:
        return self._solution[1]

    @cached_property
    def _solution(self) -> tuple[tuple[Array, Array, Array], list[RankedSvd]]:
        X, decisions = lexicographic_gains(self.problem, self.damping)
        X, m1, n = check.frozen(X), len(self.problem.S_m), X.shape[-2]
        return (X[..., :m1], X[..., m1 : m1 + n], X[..., m1 + n :]), decisions


def velocity_mapping(
    J: ArrayLike,
    major: Sequence[int] | ArrayLike,
    secondary: Sequence[int] | ArrayLike | None = None,
    joint_weight: ArrayLike | None = None,
    secondary_weight: ArrayLike | None = None,
    active_constraint: ArrayLike | None = None,
    self_motion: ArrayLike | None = None,
    *,
    major_metric: ArrayLike | None = None,
    tie_metric: ArrayLike | None = None,
    damping: float = 0.0,
    scale: ArrayLike | None = None,
    rank_tolerance: float = RANK_TOLERANCE,
) -> VelocityMapping:
    """Minimize |W1 (rates - rates_d)|^2 + |W2 (v_s - v_sd)|^2 without touching the major task.

    Four levels, each inside what the one before leaves free:

    1. C rates = 0                          (constrained active joints, eq. 17)
    2. |M (J_m rates - v_m)|   smallest     (zero where reachable, eq. 23)
    3. the weighted sum above  smallest     (eq. 24)
    4. |T rates|, then |rates| smallest     (ties)

    Theorems 3, 4 and 5 of Chen, McInroy, Yi (2003) are the cases of W1, W2 both nonsingular,
    W2 = 0, and W1 = 0; here the weights may be anything.

    Args:
        J: Task Jacobian, eq. (14), shape (..., m, n).
        major: Task rows of the major task, or a matrix of directions (m1, m).
        secondary: Task rows, or directions (m2, m), of the secondary task; by default the
            remaining rows in ascending order (for directions: their orthogonal complement).
        joint_weight: W1, diagonal (n,) or matrix (..., k, n); None is zero.
        secondary_weight: W2, diagonal (m2,) or matrix (..., k, m2); None is zero.
        active_constraint: C, shape (..., r, n).
        self_motion: Basis of the task motion that no actuator holds, shape (..., m, k), columns of
            unit size; it only decides the status.
        major_metric: M, diagonal (m1,) or matrix (..., k, m1). It matters where the major task is
            out of reach or damped, and its rows mix units.
        tie_metric: T, diagonal (n,) or matrix (..., k, n). It matters where the weights leave
            rates undecided, and joints mix units.
        damping: Tikhonov damping of level 2, in units of the singular values of M J_m: the part of
            the rates that serves the major task stays below |M v_m| / (2 damping), and the major
            task is not exact. The secondary goal is not damped: give it a joint_weight.
        scale: Size of J that ranks are decided against, shape (...); by default its norm. A J that
            is a difference of large terms has theirs.
        rank_tolerance: Singular values below this fraction of the scale count as zero, those of
            the stacked weights too: one goal cannot be weighed 1e10 times another.

    Raises:
        ValueError: Wrong shape, index or non-finite input, naming the argument.
    """
    args = checked(
        J,
        major,
        secondary,
        weight_name="joint_weight",
        weight=joint_weight,
        secondary_weight=secondary_weight,
        active_constraint=active_constraint,
        self_motion=self_motion,
        major_metric=major_metric,
        tie_metric=tie_metric,
        scale=scale,
        rank_tolerance=rank_tolerance,
    )
    return VelocityMapping(args, check.number("damping", damping))
