"""Conventional weighted pseudo-inverse over all task rows, without priorities, as a baseline."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ftc import Goal
from prioritized import Kinematics, Status, VelocityMapping, VelocitySolution, velocity_mapping
from sim import Array


@dataclass(frozen=True)
class Compromise:
    """Mapping whose rates are a weighted compromise of all tasks."""

    equals: VelocityMapping
    """Mapping without major rows; its secondary task is [v_s; v_m]."""
    secondary_count: int
    """Number of secondary rows v_s."""

    @property
    def major(self) -> Array:
        """Gain of the major velocity, shape (n, m1)."""
        return self.equals.secondary[:, self.secondary_count :]

    @property
    def status(self) -> Status:
        """Status DAMPED, never exact: the weights trade the major task for the others."""
        return Status.DAMPED

    def __call__(
        self,
        v_major: ArrayLike,
        joint_velocity: ArrayLike | None = None,
        secondary_velocity: ArrayLike | None = None,
    ) -> Array:
        """Return the rates of the active joints, shape (n,); references of None are zero."""
        return self.equals([], joint_velocity, self._reference(v_major, secondary_velocity))

    def solve(
        self,
        v_major: ArrayLike,
        joint_velocity: ArrayLike | None = None,
        secondary_velocity: ArrayLike | None = None,
    ) -> VelocitySolution:
        """Return the rates with their status, as :meth:`prioritized.VelocityMapping.solve`."""
        return self.equals.solve([], joint_velocity, self._reference(v_major, secondary_velocity))

    def _reference(self, v_major: ArrayLike, secondary_velocity: ArrayLike | None) -> Array:
        v_s = np.zeros(self.secondary_count) if secondary_velocity is None else secondary_velocity
        return np.concatenate([v_s, v_major])


def weighted_pseudo_inverse(
    J: Array,
    major: Sequence[int],
    secondary: Sequence[int],
    major_weight: float,
    joint_weight: ArrayLike | None = None,
    secondary_weight: ArrayLike | None = None,
) -> Compromise:
    """Return the mapping with the least weighted sum of squared errors of all tasks.

    The sum is |w (v_m - v_md)|^2 + |W1 (rates - rates_d)|^2 + |W2 (v_s - v_sd)|^2: that of eq. (24)
    and, instead of the constraint (23), the major task with weight w, `major_weight`. This task is
    satisfied only "in accordance with the weight" (section 3).

    `major` and `secondary` are rows of the task Jacobian J (m, n); the weights W1 (n,) and W2 (m2,)
    are diagonals, None is zero.

    Raises:
        ValueError: An argument is invalid; see :func:`prioritized.velocity_mapping`.
    """
    m2 = len(secondary)
    W2 = np.zeros(m2) if secondary_weight is None else np.asarray(secondary_weight)
    weights = np.concatenate([W2, np.full(len(major), major_weight)])
    equals = velocity_mapping(J, [], [*secondary, *major], joint_weight, weights)
    return Compromise(equals, m2)


def compromising(
    goal: Goal, major: Sequence[int], secondary: Sequence[int], major_weight: float
) -> Callable[[Kinematics], Compromise]:
    """Return an `allocate` of :class:`ftc.PrioritizedMapping`: a weighted pseudo-inverse.

    At each posture it maps the remaining actuators with the goal's weights. The other arguments are
    those of :func:`weighted_pseudo_inverse`.
    """

    def allocate(kinematics: Kinematics) -> Compromise:
        W1, W2 = goal.joint_weight, goal.secondary_weight
        remaining = None if W1 is None else np.array(W1)[kinematics.actuators]
        weights = major_weight, remaining, W2
        return weighted_pseudo_inverse(kinematics.J, major, secondary, *weights)

    return allocate
