"""Random cases of Problem 1: what every solver is given."""

from dataclasses import dataclass, replace

import numpy as np

from experiments.hexapod.goal import MAJOR, SECONDARY
from sim import Array


@dataclass(frozen=True)
class Problem:
    """Minimize |W1 (rates - joint)|^2 + |W2 (J_s rates - secondary)|^2, J_m rates = major.

    Or a batch of them, with the weights in common.

    Attributes:
        J: Shape (..., 6, n); J_m its rows `MAJOR`, J_s its rows `SECONDARY`.
        joint_weight: Diagonal of W1, (n,).
        secondary_weight: Diagonal of W2, (4,).
        major: (..., 2).
        joint: (..., n).
        secondary: (..., 4).
    """

    J: Array
    joint_weight: Array
    secondary_weight: Array
    major: Array
    joint: Array
    secondary: Array

    def least_squares(self) -> tuple[Array, Array]:
        """A (n + 4, n) and b of the objective |A rates - b|^2."""
        W1, W2 = np.diag(self.joint_weight), self.secondary_weight
        A = np.vstack([W1, W2[:, None] * self.J[SECONDARY]])
        return A, np.concatenate([self.joint_weight * self.joint, W2 * self.secondary])

    def quadratic(self) -> tuple[Array, Array]:
        """H (n, n) and f of the same objective, rates^T H rates / 2 + f^T rates."""
        A, b = self.least_squares()
        return A.T @ A, -b @ A

    def constraint(self) -> tuple[Array, Array]:
        """J_m (2, n) and v_m."""
        return self.J[MAJOR], self.major

    def one(self, k: int) -> "Problem":
        """The k-th of a batch."""
        return replace(
            self, J=self.J[k], major=self.major[k], joint=self.joint[k], secondary=self.secondary[k]
        )

    def with_unit_rows(self) -> "Problem":
        """The same with weights that make every row of A a unit vector."""
        return replace(
            self,
            joint_weight=np.ones_like(self.joint_weight),
            secondary_weight=1 / np.linalg.norm(self.J[SECONDARY], axis=1),
        )


def random_problem(n: int, rng: np.random.Generator, batch: tuple[int, ...] = ()) -> Problem:
    """With n actuators: Gaussian J, which has full rank, and weights from 0.5 to 2."""
    return Problem(
        J=rng.normal(size=(*batch, 6, n)),
        joint_weight=rng.uniform(0.5, 2.0, size=n),
        secondary_weight=rng.uniform(0.5, 2.0, size=len(SECONDARY)),
        major=rng.normal(size=(*batch, len(MAJOR))),
        joint=rng.normal(size=(*batch, n)),
        secondary=rng.normal(size=(*batch, len(SECONDARY))),
    )
