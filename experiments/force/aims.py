"""Problem 6: the forces that are asked for, and what is to be least."""

from dataclasses import dataclass

import numpy as np

from experiments.rig.hexapod.columns import MAJOR, SECONDARY
from sim import Array


@dataclass(frozen=True)
class ForceGoal:
    """One of the three cases of Problem 6, by the theorem that solves it without failures."""

    theorem: int
    torque_weight: tuple[float, ...] | None  # W3, diagonal over the struts, [1]/[N]; None is zero
    secondary_weight: tuple[float, ...] | None  # W4, of [f_x, f_y, f_z, m_z], [1]/[N], [1]/[N m]

    def __str__(self) -> str:
        return f"theorem {self.theorem}"


SPARING = (2.0, 1.0, 2.0, 1.0, 2.0, 1.0)
"""W3: struts 1, 3 and 5 are hot, as under the paper's W_b. With W3 = I nothing would be traded: in
the orthogonal hexapod the least torque exerts no secondary force at all."""

LEVERED = (1.0, 1.0, 1.0, 3.0)
"""W4: a moment counts as the force that makes it at the nodes, 0.33 m from the axis."""

LEAST_TORQUE, PRESCRIBED = ForceGoal(8, SPARING, None), ForceGoal(9, None, LEVERED)
GOALS = (ForceGoal(7, SPARING, LEVERED), LEAST_TORQUE, PRESCRIBED)


@dataclass(frozen=True)
class Aims:
    """Forces asked for, one a row."""

    major: Array  # moments about x_b and y_b, (D, 2), [N m]
    secondary: Array  # [f_x, f_y, f_z, m_z], (D, 4), [N] and [N m]

    @property
    def wrench(self) -> Array:
        """All of it as [moment; force], shape (D, 6)."""
        return as_wrench(self.major, self.secondary)


def as_wrench(major: Array, secondary: Array) -> Array:
    """[moment; force] (D, 6) of its major and secondary parts."""
    wrench = np.empty((len(major), 6))
    wrench[:, MAJOR], wrench[:, SECONDARY] = major, secondary
    return wrench


MAJOR_N_M, FORCE_N, TWIST_N_M = 3.0, 20.0, 2.0
"""Sizes of the major moment, the secondary force, and (at most) the moment about z_b: together they
ask for up to some 20 N of a coil, which has 80."""


def draw_aims(rng: np.random.Generator, count: int) -> Aims:
    """Random directions."""
    angle = rng.uniform(0, 2 * np.pi, count)
    force = rng.normal(size=(count, 3))
    force *= FORCE_N / np.linalg.norm(force, axis=1, keepdims=True)
    twist = rng.uniform(-TWIST_N_M, TWIST_N_M, (count, 1))
    major = MAJOR_N_M * np.column_stack([np.cos(angle), np.sin(angle)])
    return Aims(major=major, secondary=np.hstack([force, twist]))
