"""The conventional approach: a weighted pseudo-inverse over all rows, no task before another."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from experiments.hexapod.choices import JacobianChoice
from experiments.hexapod.goal import MAJOR, SECONDARY, Goal
from experiments.hexapod.mapping import Reconfigured, StrutMapping
from prioritized import Status, VelocityMapping, velocity_mapping
from sim import Array, Hexapod


@dataclass(frozen=True)
class WeightedPseudoInverse:
    """Rates that compromise between all tasks; made by :func:`weighted_pseudo_inverse`.

    Attributes:
        equals: The mapping with nothing major; its secondary task is [v_s; v_m].
        secondary_count: Rows of v_s.
    """

    equals: VelocityMapping
    secondary_count: int

    @property
    def major(self) -> Array:
        """Gain of the major velocity, shape (n, m1)."""
        return self.equals.secondary[:, self.secondary_count :]

    @property
    def status(self) -> Status:
        """Never exact: the major task is one wish among others."""
        return Status.DAMPED

    def __call__(
        self,
        v_major: ArrayLike,
        joint_velocity: ArrayLike | None = None,
        secondary_velocity: ArrayLike | None = None,
    ) -> Array:
        """Active joint rates, shape (n,); what is None counts as zero."""
        v_s = np.zeros(self.secondary_count) if secondary_velocity is None else secondary_velocity
        return self.equals([], joint_velocity, np.concatenate([v_s, v_major]))


def weighted_pseudo_inverse(
    J: Array,
    major: Sequence[int],
    secondary: Sequence[int],
    major_weight: float,
    joint_weight: ArrayLike | None = None,
    secondary_weight: ArrayLike | None = None,
) -> WeightedPseudoInverse:
    """Minimize |w (v_m - v_md)|^2 + |W1 (rates - rates_d)|^2 + |W2 (v_s - v_sd)|^2, all at once.

    The sum of eq. (24) with the major task as one more term instead of a constraint, eq. (23). It
    is the library's own mapping, told that nothing is major: its answer compromises the major
    task "in accordance with the weight" (section 3).

    Args:
        J: Task Jacobian, shape (m, n).
        major: Rows of v_m.
        secondary: Rows of v_s.
        major_weight: w.
        joint_weight: W1, diagonal (n,); None is zero.
        secondary_weight: W2, diagonal (m2,); None is zero.

    Raises:
        ValueError: As :func:`prioritized.velocity_mapping`.
    """
    m2 = len(secondary)
    W2 = np.zeros(m2) if secondary_weight is None else np.asarray(secondary_weight)
    weights = np.concatenate([W2, np.full(len(major), major_weight)])
    equals = velocity_mapping(J, [], [*secondary, *major], joint_weight, weights)
    return WeightedPseudoInverse(equals, m2)


class PseudoInverseMapping(StrutMapping):
    """The strut mapping with a weighted pseudo-inverse in the place of eqs. (28) and (30)."""

    def __init__(
        self, geometry: Hexapod, goal: Goal, jacobian: JacobianChoice, major_weight: float
    ) -> None:
        """As the strut mapping; `major_weight` weighs [rad] of pointing."""
        self.major_weight = major_weight
        super().__init__(geometry, goal, jacobian)

    def at(self, A: Array) -> Reconfigured:
        """The mapping where l_dot = A x_dot."""
        now = super().at(A)
        W1 = self.goal.joint_weight
        mapping = weighted_pseudo_inverse(
            now.J,
            MAJOR,
            SECONDARY,
            self.major_weight,
            joint_weight=None if W1 is None else now.expand.T @ np.array(W1),
            secondary_weight=self.goal.secondary_weight,
        )
        return replace(now, mapping=mapping)
